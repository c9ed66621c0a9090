"""A frozen picture: what moved stands still at once, and nothing changes any more."""

from __future__ import annotations

import numpy as np

from recorders.segmentation.segmenter import Image, as_image
from recorders.vision import cv2

CHANGES_LEVELS = 6
"""A pixel stands still while it changes by less than this, levels."""
MOVES_LEVELS, MOVES_SHARE = 15, 0.002
"""Something moves where so many levels change in this share of the picture."""
FROZEN_S = 3.0
"""A picture is frozen when it has stood still for so long since something moved."""


class Standstill:
    """Compares each picture with the one before.

    Attributes:
        frames: how long the picture has stood still, if something moved in the frame before; else
            0.
    """

    def __init__(self) -> None:
        self._before: Image | None = None
        self._moved = False
        self.frames = 0

    def step(self, picture: Image) -> None:
        """Take the next picture, (H, W, 3) uint8 in Y, Cr, Cb."""
        step = max(1, min(picture.shape[:2]) // 64)
        luma = picture[::step, ::step, 0].copy()
        before, self._before = self._before, luma
        if before is None:
            return
        change = as_image(cv2.absdiff(luma, before))
        if int(change.max()) >= CHANGES_LEVELS:
            moving = int(np.count_nonzero(change >= MOVES_LEVELS))
            self._moved = moving >= MOVES_SHARE * change.size
            self.frames = 0
        elif self.frames or self._moved:
            self.frames += 1
