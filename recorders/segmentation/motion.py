"""Motion: whatever differs from the background, without its shadow (EVENTS 2, SHELLS 2.1, PARTS 2).

Each pixel's difference from the background is evidence for or against foreground; a weighted median over a small
window decides (SHELLS 2.1: the weighted median reconnects the parts of an object). The weighted median of two labels
is the label with the larger sum of weights, that is the sign of the blurred signed evidence.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from recorders.messages import Blob, Detections
from recorders.segmentation.background import most_common, sample
from recorders.segmentation.blobs import components
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.segmenter import Image, Segmented
from recorders.vision import cv2

NEUTRAL = 128


class MotionSegmenter:
    """Background subtraction against a background in hindsight, or one learnt on the way without `prepare`."""

    def __init__(self, parameters: SegmentationParameters, width: int, height: int, fps: float) -> None:
        self._p = parameters
        self._width, self._height = width, height
        self._min_area = parameters.min_area * width * height
        self._window = 2 * int(parameters.smoothing * height / 2 + 0.5) + 1
        self._adapt_every = max(1, round(parameters.adaptation_s * fps)) if fps > 0 else 50
        self._background: Image | None = None
        self._spread: Image | None = None
        self._live = cv2.createBackgroundSubtractorMOG2(history=max(20, int(20 * fps)), detectShadows=True)
        self._live.setShadowThreshold(parameters.shadow_darkest)
        self._lowest = np.array([int(v * parameters.shadow_darkest) for v in range(256)], np.uint8)

    def prepare(self, frames: Iterable[Image]) -> None:
        """Learn the background from pictures spread over the whole recording."""
        stack = [cv2.cvtColor(f, cv2.COLOR_BGR2YCrCb) for f in sample(frames)]
        if len(stack) >= 3:
            self._background, self._spread = most_common(stack)

    def segment(self, index: int, image: Image) -> Segmented:
        """Segment the next frame."""
        evidence = self._evidence(image)
        if self._window > 1:
            evidence = cv2.GaussianBlur(evidence, (self._window, self._window), 0)
        mask = cv2.compare(evidence, NEUTRAL, cv2.CMP_GT)
        clean, _, blobs = components(mask, self._min_area)
        return Segmented(clean, describe(index, self._width, self._height, blobs))

    def _evidence(self, image: Image) -> Image:
        """Signed evidence for foreground, (H, W) uint8 around `NEUTRAL`."""
        if self._background is None:
            live = self._live.apply(image)
            return np.where(live == 255, np.uint8(255), np.uint8(0))
        now = cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb)
        difference = cv2.absdiff(now, self._background)
        dy, dr, db = cv2.split(difference)
        chroma = cv2.add(dr, db)
        total = cv2.add(dy, cv2.add(chroma, chroma))
        y, background_y = now[..., 0], self._background[..., 0]
        shadow = cv2.compare(y, background_y, cv2.CMP_LT)
        shadow &= cv2.compare(y, cv2.LUT(background_y, self._lowest), cv2.CMP_GE)
        shadow &= cv2.compare(chroma, self._p.shadow_colour_levels, cv2.CMP_LE)
        total[shadow > 0] = 0
        level = int(self._p.threshold_levels)
        return cv2.subtract(cv2.add(cv2.min(total, 2 * level), NEUTRAL), level)


def describe(index: int, width: int, height: int, blobs: list[Blob]) -> Detections:
    """Every component as one detection."""
    return Detections(
        frame=index,
        width=width,
        height=height,
        boxes=[b.box for b in blobs],
        scores=[1.0] * len(blobs),
        labels=["object"] * len(blobs),
        ellipses=[b.ellipse for b in blobs],
        blobs=[b.id for b in blobs],
        components=blobs,
    )
