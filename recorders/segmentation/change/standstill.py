"""A frozen picture: what moved stands still at once, and nothing changes any more."""

from __future__ import annotations

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

CHANGES_LEVELS = 5
"""A picture stands still while no pixel of it changes by this, levels: a camera's noise would."""
MOVES_LEVELS, MOVES_SHARE = 15, 0.0005
"""Something moves where so many levels change in this share of the picture."""
FROZEN_S = 3.0
"""A picture is frozen when it has stood still for so long since something moved."""


class Standstill:
    """Compares each picture with the one before.

    Attributes:
        frames: how long the picture has stood still with bodies in it that moved in the frame
            before; else 0.
    """

    def __init__(self) -> None:
        self._before: Image | None = None
        self._moved = False
        self.frames = 0

    def step(self, picture: Image, bodies: bool) -> None:
        """Take the next picture, (H, W, 3) uint8 in Y, Cr, Cb, and whether bodies are seen in it."""
        before, self._before = self._before, picture
        if before is None or not bodies:
            self.frames, self._moved = 0, False
            return
        step = max(1, min(picture.shape[:2]) // 64)
        change = as_image(
            cv2.absdiff(picture[::step, ::step, 0].copy(), before[::step, ::step, 0].copy())
        )
        if int(change.max()) < CHANGES_LEVELS and (self.frames or self._moved):
            whole = cv2.absdiff(picture, before)
            if int(cv2.extractChannel(whole, 0).max()) < CHANGES_LEVELS:
                self.frames += 1
                return
        self.frames = 0
        moving = int(np.count_nonzero(change >= MOVES_LEVELS))
        self._moved = moving >= MOVES_SHARE * change.size
