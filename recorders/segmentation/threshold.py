"""Threshold: objects brighter or darker than a smooth ground, for animals that hardly move.

The ground is the picture's own large median: what is small against it stands out, moving or not.
Where something stands out that never moves and was never seen to arrive (a dish's rim, bedding, a
lamp), and that does not look like the bodies that do move, it is ground, too.
Two levels: the lower one outlines the objects, the higher one (Otsu 1979, over the whole
recording or the past) finds their cores.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob, Detections
from recorders.pictures import Image
from recorders.segmentation.background import Samples, most_common
from recorders.segmentation.blobs import Labels, components
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.segmenter import Segmented, as_image
from recorders.segmentation.touching import (
    compact,
    divide,
    pixels_of,
    single_areas,
    within,
)
from recorders.segmentation.usual import median
from recorders.vision import cv2

GROUND_SIDE = 128
"""The ground is found in a picture of about this many pixels a side."""
GROUND_WINDOW = 0.3
"""Window of the ground's median, of the picture's shorter side."""
LOW_LEVEL = 0.45
"""The lower level, of the higher."""
MAX_AREAS = 2000
LEAST = 0.25
"""A blob under this share of one body's core is none: bedding, dirt."""
THIN = 0.1
"""What is thinner than this, of the side of a square of one body's area, is no part of a body: tails,
legs, bedding.
"""
CERTAIN, DOUBTFUL = 1.0, 0.6
MIN_PIXELS = 9.0
"""Less than this is no body."""
FEW, PART = 4.0, 0.2
"""A part of a body that shifts lies in a blob of at most so many bodies, and is this share of it."""
FIXED = 0.9
"""What stands out in this share of the pictures never moves."""
FEWEST = 5
"""Fewer pictures do not tell what moves."""
RESTLESS = 0.3
"""A blob of which this share does not stand out all the time moves."""
ALIKE = (0.5, 2.0)
"""What never moves is a body that rests if it is compact, and its area within these of those that
move, in most of the pictures.
"""


class ThresholdSegmenter:
    """Objects that differ from a smooth ground; touching ones are told apart by their cores and
    areas.
    """

    def __init__(
        self, parameters: SegmentationParameters, width: int, height: int, fps: float
    ) -> None:
        del fps
        self._p = parameters
        self._width, self._height = width, height
        self._min_area = parameters.min_area * width * height
        self._window = 2 * int(parameters.smoothing * min(width, height) / 4 + 0.5) + 1
        self._scale = max(1, min(width, height) // GROUND_SIDE)
        self._counts = np.zeros(256, np.int64)
        self._areas: list[int] = []
        self._prepared = False
        self._body_area = 0.0
        self._fixed: tuple[Image, Image] | None = None

    def prepare(self, frames: Iterable[Image]) -> None:
        """Learn the levels and the area of one body from pictures spread over the whole
        recording.
        """
        samples = Samples(most=30)
        for frame in frames:
            if samples.wants_next():
                samples.add(as_image(cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY)))
            else:
                samples.skip()
        if not samples.kept:
            return
        self._min_area = min(self._min_area, max(MIN_PIXELS, self._window**2 / 4))
        self._learn_fixed(samples.kept)
        self._counts[:] = 0
        differences = [self._difference(grey) for grey in samples.kept]
        for difference in differences:
            self._count(difference)
        for difference in differences:
            core, _, labels, blobs = self._levels(difference)
            self._observe(core, labels, blobs)
        self._prepared = True
        self._body_area = self._median_area()
        self._min_area = max(self._min_area, LEAST * self._body_area)

    def _learn_fixed(self, pictures: list[Image]) -> None:
        """Find what stands out in place for the whole recording, and what it looks like."""
        for grey in pictures:
            self._count(self._difference(grey))
        masks = [self._levels(self._difference(grey))[1] for grey in pictures]
        often = np.zeros(pictures[0].shape, np.uint8)
        for mask in masks:
            often += mask & np.uint8(1)
        fixed = (often >= FIXED * len(masks)).astype(np.uint8) * np.uint8(255)
        seen = [components(mask, self._min_area) for mask in masks]
        areas = np.array(
            [
                blob.area
                for _, labels, blobs in seen
                for blob in blobs
                if _moves(blob, labels, fixed)
            ],
            np.float64,
        )
        if len(masks) < FEWEST or not len(areas):
            return  # nothing is seen to move: whatever stands out may be a body
        usual = median(areas, areas)
        whole, parts, found = components(fixed, MIN_PIXELS)
        for part in found:
            own = pixels_of(part, parts)
            if _rests(part, own, seen, usual, whole):
                within(part, fixed)[own > 0] = 0
        if fixed.any():
            usually, _ = most_common(pictures)
            kernel = np.ones((3, 3), np.uint8)
            self._fixed = as_image(cv2.dilate(fixed, kernel)), usually

    def segment(self, index: int, image: Image) -> Segmented:
        """Segment the next frame."""
        difference = self._difference(as_image(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)))
        if not self._prepared:
            self._count(difference)
        core, mask, labels, blobs = self._levels(difference)
        if not self._prepared:
            self._observe(core, labels, blobs)
            self._body_area = self._median_area()
        return Segmented(mask, self._detect(index, core, labels, blobs))

    def _difference(self, grey: Image) -> Image:
        """Smoothed absolute difference from the ground, (H, W) uint8."""
        size = (max(1, self._width // self._scale), max(1, self._height // self._scale))
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        window = min(127, 2 * int(GROUND_WINDOW * min(size) / 2) + 1)
        ground = cv2.medianBlur(small, window) if window > 1 else small
        ground = cv2.resize(
            ground, (self._width, self._height), interpolation=cv2.INTER_LINEAR
        )
        if self._fixed is not None:
            ground = ground.copy()
            cv2.copyTo(self._fixed[1], self._fixed[0], ground)
        difference = cv2.absdiff(grey, ground)
        if self._window > 1:
            difference = cv2.GaussianBlur(difference, (self._window, self._window), 0)
        return as_image(difference)

    def _count(self, difference: Image) -> None:
        self._counts += (
            cv2.calcHist([difference], [0], None, [256], [0.0, 256.0])
            .ravel()
            .astype(np.int64)
        )

    def _levels(self, difference: Image) -> tuple[Image, Image, Labels, list[Blob]]:
        """The cores, and mask, labels and blobs of the lower level; a blob without a core is
        none.
        """
        high = max(self._p.threshold_levels, float(otsu(self._counts)))
        low = max(1.0, min(self._p.threshold_levels, LOW_LEVEL * high))
        mask = as_image(cv2.threshold(difference, int(low), 255, cv2.THRESH_BINARY)[1])
        core = as_image(cv2.threshold(difference, int(high), 255, cv2.THRESH_BINARY)[1])
        side = round(THIN * self._body_area**0.5)
        if side > 1:
            kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
            mask = as_image(cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel))
        mask, labels, blobs = components(mask, self._min_area)
        bright = np.bincount(labels[core > 0], minlength=len(blobs) + 1)
        if any(not bright[blob.id] for blob in blobs):
            lit = (bright > 0).astype(np.uint8) * np.uint8(255)
            lit[0] = 0
            mask, labels, blobs = components(lit[labels], self._min_area)
        return core, mask, labels, blobs

    def _observe(self, core: Image, labels: Labels, blobs: list[Blob]) -> None:
        """Take in the areas of one frame's cores."""
        for blob in blobs:
            inner = pixels_of(blob, labels) & within(blob, core)
            self._areas += single_areas(components(inner, 0.1 * self._min_area)[2])
        del self._areas[:-MAX_AREAS]

    def _median_area(self) -> float:
        """The median of the single bodies' areas, each weighing its area, 0 without any: specks
        outnumber bodies.
        """
        areas = np.array(self._areas, np.float64)
        return median(areas, areas) if len(areas) else 0.0

    def _detect(
        self, index: int, core: Image, labels: Labels, blobs: list[Blob]
    ) -> Detections:
        least = LEAST * self._body_area
        large = [b for b in blobs if b.area >= least]
        bodies = divide(large, labels, core, self._body_area)
        return Detections(
            frame=index,
            width=self._width,
            height=self._height,
            boxes=[body.box for body in bodies],
            scores=[CERTAIN if body.among == 1 else DOUBTFUL for body in bodies],
            labels=["object"] * len(bodies),
            ellipses=[body.ellipse for body in bodies],
            blobs=[body.blob for body in bodies],
            components=blobs,
        )


def _rests(
    part: Blob,
    own: Image,
    seen: Sequence[tuple[Image, Labels, list[Blob]]],
    usual: float,
    fixed: Image,
) -> bool:
    """Whether what never moves is a body, or a part of one that shifts: by the blobs that it lies in.

    Args:
        part: what never moves.
        own: its pixels in its box, (h, w) uint8, 0 or 255.
        seen: mask, labels and blobs of pictures from all over the recording.
        usual: area of those that move, px.
        fixed: (H, W) uint8, 255 where something stands out all the time.
    """
    bodies = 0
    y, x = (int(v[0]) for v in np.nonzero(own))
    for _, labels, blobs in seen:
        there = int(labels[int(part.box[1]) + y, int(part.box[0]) + x])
        if there:
            blob = blobs[there - 1]
            alike = ALIKE[0] * usual <= blob.area <= ALIKE[1] * usual
            few = blob.area <= FEW * usual and part.area >= PART * blob.area
            bodies += (alike and compact(blob)) or (few and _moves(blob, labels, fixed))
    return 2 * bodies >= len(seen)


def _moves(blob: Blob, labels: Labels, fixed: Image) -> bool:
    """Whether so much of a blob does not stand out all the time."""
    still = np.count_nonzero(within(blob, fixed)[pixels_of(blob, labels) > 0])
    return bool(still <= (1 - RESTLESS) * blob.area)


def otsu(counts: NDArray[np.int64]) -> int:
    """The level that divides a histogram best (N. Otsu 1979): the largest variance between the
    classes.

    Args:
        counts: (256,) how often each level occurs.

    Returns:
        The largest level of the lower class; the first of equals, 0 for an empty histogram.
    """
    total = counts.sum()
    if total == 0:
        return 0
    levels = np.arange(256)
    below = np.cumsum(counts).astype(np.float64)
    moment = np.cumsum(counts * levels).astype(np.float64)
    above = total - below
    with np.errstate(divide="ignore", invalid="ignore"):
        between = (moment[-1] * below / total - moment) ** 2 / (below * above)
    return int(np.argmax(np.where((below > 0) & (above > 0), between, 0.0)))
