"""Density: foreground and background by kernel densities (SHELLS 2.1, after Sheikh and Shah, PAMI
2005).

Background: samples of the past (or, in hindsight, of the whole recording) vote for a pixel with a
kernel over the distance of its colour from the sample's colours in a small neighbourhood, so that
what sways a little is background. Foreground: the last frame's foreground votes in the same way
in a larger neighbourhood, mixed with a uniform density. The logarithm of their ratio is the
evidence, and in place of the original's MAP-MRF a weighted median labels each pixel, as SHELLS
has it.

Deviations: the kernel over position is the neighbourhood's range of colours, channel by channel,
and everything is integer (tables over 256 levels), so that the answer is the same on every
machine; shadows are removed as for motion.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.background import MIN_SAMPLES, Samples, most_common
from recorders.segmentation.blobs import components
from recorders.segmentation.bodies import FoundBodies
from recorders.segmentation.evidence import NEUTRAL, Shadows, weighted_median, window_of
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.recurring import weigh
from recorders.segmentation.segmenter import Segmented, as_image
from recorders.vision import cv2

DENSITY_SAMPLES = 20
LIVE_WINDOW_S = 60.0
BACKGROUND_REACH = 1
"""Neighbourhood of a background sample's pixel, px to each side."""
FOREGROUND_REACH = 0.012
"""Neighbourhood of the last foreground, of the picture's height: how far bodies move between
frames.
"""
UNIFORM = 0.12
"""The uniform density of the foreground, of the kernel's peak."""
FOREGROUND_SHARE = 0.5
"""Weight of the last foreground against the uniform density."""
LOG_STEP = 24.0
"""Evidence per factor e."""


class _Range:
    """The range of colours around each pixel of a picture."""

    def __init__(self, picture: Image, reach: int, within: Image | None = None) -> None:
        kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
        low, high = picture, picture
        if within is not None:
            # Where nothing is within, the range is empty, and every colour is far from it.
            low, high = np.full_like(picture, 255), np.zeros_like(picture)
            cv2.copyTo(picture, within, low)
            cv2.copyTo(picture, within, high)
        self.low = as_image(cv2.erode(low, kernel))
        self.high = as_image(cv2.dilate(high, kernel))

    def distance(self, picture: Image) -> Image:
        """How far each pixel's colour is outside the range, weighed as `weigh` does, (H, W)
        uint8.
        """
        return weigh(
            as_image(
                cv2.add(cv2.subtract(self.low, picture), cv2.subtract(picture, self.high))
            )
        )


class DensitySegmenter:
    """Kernel density foreground and background with a weighted median."""

    def __init__(
        self, parameters: SegmentationParameters, width: int, height: int, fps: float
    ) -> None:
        self._min_area = parameters.min_area * width * height
        self._window = window_of(parameters, height)
        self._shadows = Shadows(parameters, width, height)
        fps = fps if fps > 0 else 25.0
        self._bodies = FoundBodies(parameters.size_model, width, height, fps)
        self._past: Samples | None = Samples(
            most=DENSITY_SAMPLES,
            max_stride=max(1, round(LIVE_WINDOW_S * fps / DENSITY_SAMPLES)),
        )
        self._observe_every = max(1, round(fps / 2))
        self._steps = 0
        self._ranges: list[_Range] = []
        self._behind: Image | None = None
        self._last: _Range | None = None
        self._reach = max(1, round(FOREGROUND_REACH * height))
        self._kernel = _kernel(parameters.threshold_levels)
        uniform = round(255 * UNIFORM)
        mixed = np.rint(
            FOREGROUND_SHARE * self._kernel + (1 - FOREGROUND_SHARE) * uniform
        ).astype(np.uint8)
        self._near = np.maximum(mixed, np.uint8(uniform))
        self._log = np.array(
            [round(LOG_STEP * math.log((v + 1) / 256)) for v in range(256)], np.int16
        )

    def prepare(self, frames: Iterable[Image]) -> None:
        """Take samples of the background, and the bodies' size, from the whole recording."""
        samples = Samples(most=DENSITY_SAMPLES)
        looks = Samples()
        for frame in frames:
            looks.add(frame)
            if samples.wants_next():
                samples.add(as_image(cv2.cvtColor(frame, cv2.COLOR_BGR2YCrCb)))
            else:
                samples.skip()
        if len(samples.kept) < MIN_SAMPLES:
            return
        self._past = None
        self._learn(samples.kept)
        for frame in looks.kept:
            mask = self._foreground(as_image(cv2.cvtColor(frame, cv2.COLOR_BGR2YCrCb)))
            self._bodies.observe(components(mask, self._min_area)[2])
        self._bodies.learn()

    def segment(self, index: int, image: Image) -> Segmented:
        """Segment the next frame."""
        picture = as_image(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))
        if self._past is not None and self._past.add(picture):
            self._learn(self._past.kept)
        mask, labels, blobs = components(self._foreground(picture), self._min_area)
        self._last = _Range(picture, self._reach, mask) if blobs else None
        self._steps += 1
        if self._past is not None and self._steps % self._observe_every == 0:
            self._bodies.observe(blobs)
            self._bodies.learn_when_due()
        return Segmented(mask, self._bodies.detect(index, mask, labels, blobs))

    def _learn(self, stack: list[Image]) -> None:
        self._ranges = [_Range(picture, BACKGROUND_REACH) for picture in stack]
        self._behind = most_common(stack)[0]

    def _foreground(self, picture: Image) -> Image:
        assert self._behind is not None
        votes = np.zeros(picture.shape[:2], np.uint16)
        for sample in self._ranges:
            votes += as_image(cv2.LUT(sample.distance(picture), self._kernel))
        background = (votes // len(self._ranges)).astype(np.uint8)
        foreground = np.full_like(background, self._near[255])
        if self._last is not None:
            foreground = as_image(cv2.LUT(self._last.distance(picture), self._near))
        ratio = self._log[foreground] - self._log[background]
        evidence = np.clip(ratio + NEUTRAL, 0, 255).astype(np.uint8)
        _, dr, db = cv2.split(cv2.absdiff(picture, self._behind))
        shadow = self._shadows.find(picture, self._behind, as_image(cv2.add(dr, db)))
        against = np.full_like(evidence, NEUTRAL - 30)
        cv2.copyTo(as_image(cv2.min(evidence, against)), shadow, evidence)
        return weighted_median(evidence, self._window)


def _kernel(width_levels: float) -> NDArray[np.uint8]:
    """A Gaussian over the distance of colours, by level, as a table of 0 to 255."""
    sigma = width_levels / 2
    return np.array(
        [round(255 * math.exp(-0.5 * (d / sigma) ** 2)) for d in range(256)], np.uint8
    )
