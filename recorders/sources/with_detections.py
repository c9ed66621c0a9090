"""Pictures from one source with the detections of a MOTChallenge file beside them."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from recorders.files import sha256
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Box
from recorders.sources.mot import FrameRows, MotText
from recorders.sources.source import Image, Source, SourceFrame, detections_of


class WithDetections:
    """A source of pictures whose frame k has the detections of the file's frame k + 1.

    Args:
        pictures: the pictures.
        detections: the MOTChallenge file.
        size: the picture size that the file was made for, its boxes are scaled from it; None: the
            pictures' own.
        limits: what a source may make us allocate.

    Raises:
        SourceError, LimitError: as `MotText`; or boxes lie beyond the pictures.
    """

    has_images = True
    has_detections = True

    def __init__(
        self,
        pictures: Source,
        detections: Path,
        size: tuple[int, int] | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self._pictures = pictures
        self._text = MotText(detections, limits)
        self.path = pictures.path
        self.name = f"{pictures.name} with MOTChallenge text"
        self.stills = pictures.stills
        self.width, self.height = pictures.width, pictures.height
        self.frame_ns, self.frame_count = pictures.frame_ns, pictures.frame_count
        self.notes = [*pictures.notes, *self._text.notes()]
        self.losses: list[str] = []
        made_for = size or (self.width, self.height)
        self._scale = self.width / made_for[0], self.height / made_for[1]
        what = f"pictures are {self.width}x{self.height}"
        if size is not None:
            what = f"size given is {size[0]}x{size[1]} and the {what}"
        self._text.check_inside(*made_for, what)

    def _scaled(self, box: Box) -> Box:
        x, y, w, h = box
        across, down = self._scale
        return x * across, y * down, w * across, h * down

    def frames(self) -> Iterator[SourceFrame]:
        """All pictures, each with its detections, if only none."""
        self.losses.clear()
        self.notes[:] = self._pictures.notes + self._text.notes()
        rows = self._text.by_frame()
        ahead = next(rows, None)
        for frame in self._pictures.frames():
            mine: FrameRows | None = None
            if ahead is not None and ahead.number == frame.index + 1:
                mine, ahead = ahead, next(rows, None)
            boxes = [self._scaled(box) for box in mine.boxes] if mine else []
            frame.detections = detections_of(
                frame.index, self.width, self.height, boxes, mine.scores if mine else []
            )
            yield frame
        self._sum_up([] if ahead is None else chain([ahead], rows))

    def _sum_up(self, after: Iterator[FrameRows] | list[FrameRows]) -> None:
        count = first = 0
        for rows in after:
            first = first or rows.number
            count += len(rows.boxes)
        self.notes[:] = self._pictures.notes + self._text.notes()
        self.losses += self._pictures.losses + self._text.losses()
        self.frame_count = self._pictures.frame_count
        if count:
            last = self.frame_count
            self.losses.append(
                f"{self._text.path.name}: {count} detections from frame {first} on come"
                f" after the last picture ({last} pictures) and were left out"
            )

    def sample(self, count: int) -> Iterator[Image]:
        """As the pictures' own source."""
        return self._pictures.sample(count)

    def digests(self) -> list[tuple[str, str]]:
        """Of the pictures, then of the detections' file."""
        return [*self._pictures.digests(), (self._text.path.name, sha256(self._text.path))]
