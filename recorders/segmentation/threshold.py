"""Threshold: objects brighter or darker than a smooth ground, for animals that hardly move.

The ground is the picture's own large median: what is small against it stands out, moving or not.
Two levels: the lower one outlines the objects, the higher one (Otsu 1979, over the whole
recording or the past) finds their cores.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob, Detections
from recorders.pictures import Image
from recorders.segmentation.background import Samples
from recorders.segmentation.blobs import Labels, components
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.segmenter import Segmented, as_image
from recorders.segmentation.touching import divide, pixels_of, single_areas, within
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
CERTAIN, DOUBTFUL = 1.0, 0.6


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
        differences = [self._difference(grey) for grey in samples.kept]
        for difference in differences:
            self._count(difference)
        for difference in differences:
            core, _, labels, blobs = self._levels(difference)
            self._observe(core, labels, blobs)
        self._prepared = bool(differences)
        self._body_area = self._median_area()

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
        bodies = divide(
            [blob for blob in blobs if blob.area >= least], labels, core, self._body_area
        )
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
