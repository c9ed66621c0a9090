"""Motion: whatever differs from the background, without its shadow (EVENTS 2, SHELLS 2.1, PARTS 2).

Each pixel's difference from the background is evidence for or against foreground; a weighted
median over a small window decides (SHELLS 2.1: the weighted median reconnects the parts of an
object). The weighted median of two labels is the label with the larger sum of weights: the sign
of the blurred signed evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from recorders.messages import Detections
from recorders.quality import QualityMeasure
from recorders.segmentation.background import MIN_SAMPLES, Background, Samples
from recorders.segmentation.bodies import FoundBodies
from recorders.segmentation.evidence import NEUTRAL, Shadows, weighted_median, window_of
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.quality import measures
from recorders.segmentation.segmenter import Image, Segmented, as_image, neighbours
from recorders.vision import cv2

LIVE_SAMPLES = 40
LIVE_WINDOW_S = 400.0
RELEARN = 8
"""Live, the background is learnt anew when this share, one in so many, of the samples is new."""
GRAIN_PX = 3
"""A camera's noise is that of single pixels, whatever the picture's size."""
SLOW_FOREGROUND = 10
"""The background follows what is held to be foreground this many times slower: a wrong background
heals.
"""


def without_grain(picture: Image) -> Image:
    """A picture of a noisy camera without the noise of single pixels."""
    return as_image(cv2.GaussianBlur(picture, (GRAIN_PX, GRAIN_PX), 0))


class MotionSegmenter:
    """Background subtraction against a background in hindsight, or without `prepare` one learnt
    on the way.
    """

    def __init__(
        self, parameters: SegmentationParameters, width: int, height: int, fps: float
    ) -> None:
        self._p = parameters
        self._min_area = parameters.min_area * width * height
        self._window = window_of(parameters, height)
        fps = fps if fps > 0 else 25.0
        self._follow_every = max(1, round(parameters.adaptation_s * fps))
        self._observe_every = max(1, round(fps / 2))
        self._steps = 0
        self._before: Image | None = None
        self._new_samples = 0
        self._background: Background | None = None
        self._grainy = False
        self._past: Samples | None = Samples(
            most=LIVE_SAMPLES, max_stride=max(1, round(LIVE_WINDOW_S * fps / LIVE_SAMPLES))
        )
        self._shadows = Shadows(parameters, width, height)
        self._neutral = np.full((height, width), NEUTRAL, np.uint8)
        self._bodies = FoundBodies(parameters.size_model, width, height)
        self.quality: list[QualityMeasure] = []

    def prepare(self, frames: Iterable[Image]) -> None:
        """Learn the background and the bodies' size from pictures spread over the whole
        recording.
        """
        self.prepare_twice(neighbours(frames))

    def prepare_twice(self, pairs: Iterable[tuple[Image, Image]]) -> None:
        """The same from pairs of pictures, a moment apart, spread over the whole recording."""
        samples = Samples()
        for pair in pairs:
            if samples.wants_next():
                samples.add(
                    np.stack([as_image(cv2.cvtColor(p, cv2.COLOR_BGR2YCrCb)) for p in pair])
                )
            else:
                samples.skip()
        if len(samples.kept) < MIN_SAMPLES:
            return
        self._past = None
        self._background = background = self._learn([pair[0] for pair in samples.kept])
        masks = [
            (
                self._foreground(self._cleaned(now), background),
                self._foreground(self._cleaned(later), background),
            )
            for now, later in samples.kept
        ]
        self._bodies.learn_usual_of(masks)
        for now, _ in masks:
            self._bodies.observe(self._bodies.measured_in(now, self._min_area))
        self._bodies.learn()
        shares = [int(np.count_nonzero(now)) / max(1, now.size) for now, _ in masks]
        self.quality = measures(
            sum(shares) / len(shares),
            self._bodies.sightings,
            self._bodies.usual is not None,
            self._bodies.model is not None,
            self._grainy,
        )

    def _learn(self, pictures: list[Image]) -> Background:
        """The background; where noise alone decides what is foreground, that of pictures without
        their grain.
        """
        background = Background.learn(
            pictures, self._p.threshold_levels, self._p.spread_weight
        )
        self._grainy = background.noisy
        if not self._grainy:
            return background
        pictures = [without_grain(picture) for picture in pictures]
        return Background.learn(pictures, self._p.threshold_levels, self._p.spread_weight)

    def _cleaned(self, picture: Image) -> Image:
        return without_grain(picture) if self._grainy else picture

    def segment(self, index: int, image: Image) -> Segmented:
        """Segment the next frame."""
        mask, detect = self.begin(index, image)
        return Segmented(mask, detect())

    def begin(self, index: int, image: Image) -> tuple[Image, Callable[[], Detections]]:
        """The next frame's foreground, and what detects the bodies in it: that alone learns and
        asks their sizes.
        """
        picture = as_image(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))
        background = self._background_at(picture)
        picture = self._cleaned(picture)
        mask, labels, blobs = self._bodies.found_in(
            self._foreground(picture, background), self._min_area, self._before
        )
        self._before = mask
        self._steps += 1
        if self._steps % self._follow_every == 0:
            everywhere = self._steps % (self._follow_every * SLOW_FOREGROUND) == 0
            background.follow(
                picture,
                np.full_like(mask, 255) if everywhere else as_image(cv2.bitwise_not(mask)),
            )
        learn = self._past is not None and self._steps % self._observe_every == 0

        def detect() -> Detections:
            if learn:
                self._bodies.observe(blobs)
                self._bodies.learn_when_due()
            return self._bodies.detect(index, mask, labels, blobs)

        return mask, detect

    def _background_at(self, picture: Image) -> Background:
        if self._past is not None and self._past.add(picture):
            self._new_samples += 1
            if self._background is None or RELEARN * self._new_samples > len(
                self._past.kept
            ):
                self._new_samples = 0
                self._background = self._learn(self._past.kept)
        assert self._background is not None
        return self._background

    def _foreground(self, picture: Image, background: Background) -> Image:
        """The weighted median of the evidence, (H, W) uint8, 0 or 255."""
        behind = background.in_light_of(picture)
        dy, dr, db = cv2.split(cv2.absdiff(picture, behind))
        chroma = cv2.add(dr, db)
        difference = cv2.add(dy, cv2.add(chroma, chroma))
        difference = cv2.subtract(
            difference,
            self._shadows.find(picture, behind, as_image(chroma), background.coloured),
        )
        level = background.level
        evidence = cv2.min(difference, cv2.add(level, level))
        evidence = cv2.subtract(cv2.add(evidence, self._neutral), level)
        return weighted_median(as_image(evidence), self._window)
