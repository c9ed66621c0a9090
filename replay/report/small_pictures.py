"""Small pictures of a log for a page, as texts that stand in it."""

from __future__ import annotations

import base64
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from recorders.annotated.reader import AnnotatedLog
from recorders.pictures import Image, encode_small_jpeg
from recorders.scene import SceneLog
from recorders.vision import cv2

_WAITING = 8
_SPARSE = 500
"""To look for a frame takes as long as to read over so many."""


class SmallPictures:
    """Pictures with nothing drawn into them.

    Args:
        log: the log.
        frames: the numbers of its frames, in order.
        width: most pixels of a picture's width.
        quality: of JPEG.
    """

    def __init__(
        self, log: AnnotatedLog, frames: Sequence[int], width: int, quality: int
    ) -> None:
        self._log = log
        self._width = width
        self._quality = quality
        self._frames = frames if log.has_pictures else []
        self._stamps = (
            {f.index: f.time_ns for f in log.frames(("tracks",))} if self._frames else {}
        )

    def sample(self, most: int) -> list[Image]:
        """A few pictures, evenly over the recording."""
        last = len(self._frames) - 1
        chosen = sorted({round(k * last / max(1, most - 1)) for k in range(most)})
        wanted = [self._frames[k] for k in chosen] if self._frames else []
        return [image for _, image in self._pictures(wanted)]

    def median(self, sample: Sequence[Image]) -> str:
        """The scene without those who move, for paths to lie on; empty without pictures."""
        if not sample:
            return ""
        return self.encoded(np.median(np.stack(sample), axis=0).astype(np.uint8))

    def of(self, wanted: Sequence[int]) -> list[list[int | str]]:
        """Number and picture of frames, in order."""
        # Pictures are decoded by one and encoded by others; no more wait than that.
        with ThreadPoolExecutor(max_workers=2, thread_name_prefix="jpeg") as pool:
            waiting: deque[tuple[int, Future[str]]] = deque()
            out: list[list[int | str]] = []
            for frame, image in self._pictures(wanted):
                waiting.append((frame, pool.submit(self.encoded, image)))
                if len(waiting) > _WAITING:
                    done, made = waiting.popleft()
                    out.append([done, made.result()])
            return out + [[done, made.result()] for done, made in waiting]

    def encoded(self, image: Image) -> str:
        """A picture as an address that is the picture itself."""
        height, width = image.shape[:2]
        if width > self._width:
            size = self._width, max(1, round(height * self._width / width))
            resized = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
            image = np.asarray(resized, np.uint8)
        data = encode_small_jpeg(image, self._quality)
        return "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")

    def _pictures(self, wanted: Sequence[int]) -> Iterator[tuple[int, Image]]:
        """The pictures of frames, in order: in one reading, or each by itself where few."""
        at = {self._stamps[f]: f for f in wanted if f in self._stamps}
        if len(at) * _SPARSE < len(self._stamps):
            with SceneLog(self._log.path, self._log.camera, self._log.limits) as scene:
                for time_ns, index in at.items():
                    frame = next(scene.frames(time_ns, index), None)
                    if frame is not None and frame.image is not None:
                        yield index, frame.image
            return
        for time_ns, load in self._log.pictures() if at else ():
            if time_ns in at:
                yield at.pop(time_ns), load()
            if not at:
                return
