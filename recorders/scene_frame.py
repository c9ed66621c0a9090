"""What is known of a scene, and one frame of it: detections at once, pictures and masks only when
somebody asks for them.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from recorders.log import Message
from recorders.masks import Labels, label_blobs
from recorders.messages import Detections, Regions, SceneChange
from recorders.pictures import Image
from recorders.scene_pictures import stamp_of
from recorders.vision import cv2


@dataclass(frozen=True)
class SceneInfo:
    """What is known of a recording before its first frame.

    Attributes:
        width, height: the picture's size in pixels.
        frame_ns: the nominal (median) time between frames in ns.
        has_images: there are pictures; without, a tracker works on boxes alone.
        has_masks: there are foreground masks that say where bodies are (fused detections say it
            better).
        pieces: regions of the mask for each body, as the recording measured it; 1 where it did not.
    """

    width: int
    height: int
    frame_ns: int
    has_images: bool
    has_masks: bool
    pieces: float = 1.0


class Frame:
    """One recorded frame. Picture and mask are decoded when first asked for, once.

    In a second reading the detections are, too.

    Attributes:
        index: from 0.
        time_ns: log time.
        regions: the latest recorded regions, or None.
        messages: everything that was recorded for this frame, in the log's order, since the frame
            before.
        changes: how the picture changed as a whole, as it was recorded since the frame before.
    """

    def __init__(
        self,
        index: int,
        time_ns: int,
        detections: Detections | Callable[[], Detections],
        regions: Regions | None = None,
        load_image: Callable[[], Image | None] | None = None,
        load_mask: Callable[[], Image] | None = None,
        messages: tuple[Message, ...] = (),
        *,
        load_labels: Callable[[], Labels] | None = None,
        changes: tuple[SceneChange, ...] = (),
    ) -> None:
        self.index = index
        self.time_ns = time_ns
        self._detections = detections
        self.regions = regions
        self.changes = changes
        self.messages = messages
        self._load_image = load_image
        self._picture: Message | None = None
        self._load_mask = load_mask
        self._load_labels = load_labels
        self._ahead: list[str] = []

    def prefetch(
        self, submit: Callable[[Callable[[], Image]], Future[Image]], like: Frame
    ) -> None:
        """Have picture and mask decoded by an executor, as far as they were asked for in the
        frame ``like``.
        """
        if self._load_image is None and self._load_mask is None:
            return
        for name, wanted in (("_load_image", "image"), ("_load_mask", "mask")):
            load = getattr(self, name)
            if (
                load is not None
                and wanted in like.__dict__
                and wanted not in self.__dict__
                and name not in self._ahead
            ):
                setattr(self, name, submit(load).result)
                self._ahead.append(name)

    def give_picture(self, message: Message, load: Callable[[], Image | None]) -> None:
        """The picture that belongs to this frame: its message, and what decodes it."""
        self._picture, self._load_image = message, load

    @property
    def has_picture(self) -> bool:
        """Whether there is a picture, decoded or not."""
        return self._load_image is not None

    @cached_property
    def stamp_ns(self) -> int:
        """When the picture says that it was taken, which is what viewers match drawings by; the
        frame's time without a picture.
        """
        return self.time_ns if self._picture is None else stamp_of(self._picture)

    @cached_property
    def detections(self) -> Detections:
        """The recorded detections."""
        return (
            self._detections
            if isinstance(self._detections, Detections)
            else self._detections()
        )

    @cached_property
    def image(self) -> Image | None:
        """The picture, (height, width, 3) uint8 BGR, or None. Never write into it."""
        return None if self._load_image is None else self._load_image()

    @cached_property
    def evenly_lit(self) -> Image | None:
        """The picture as it would be in its background's light, as far as the recording says by
        how much it differs: who is the same looks the same.
        """
        factors = self.detections.light
        if not factors or self.image is None:
            return self.image
        levels = np.arange(256.0)[:, None] / np.array(factors)
        table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)[:, None]
        return np.asarray(cv2.LUT(self.image, table))

    @cached_property
    def mask(self) -> Image | None:
        """The foreground mask, (height, width) uint8, 0 or 255, or None. Never write into it."""
        return None if self._load_mask is None else self._load_mask()

    @cached_property
    def labels(self) -> Labels | None:
        """The mask's blobs, (height, width) uint16, component k of the detections as k + 1; None
        without a mask.

        Never write into it.
        """
        if self.mask is None:
            return None
        return (
            label_blobs(self.mask)[1] if self._load_labels is None else self._load_labels()
        )

    @cached_property
    def boxes(self) -> NDArray[np.float64]:
        """The detections' boxes, (N, 4) float64: x, y, w, h in pixels."""
        return np.array(self.detections.boxes, np.float64).reshape(-1, 4)
