"""From a picture to its foreground mask and detections (EVENTS 2, SHELLS 2.1, PARTS 2)."""

from __future__ import annotations

from recorders.segmentation.density import DensitySegmenter
from recorders.segmentation.motion import MotionSegmenter
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.segmenter import (
    Segmented,
    Segmenter,
    SegmenterFactory,
    SegmenterInParts,
    SegmenterInTwoLooks,
    SegmenterThatWatches,
)
from recorders.segmentation.threshold import ThresholdSegmenter

SEGMENTERS: dict[str, SegmenterFactory] = {
    "motion": MotionSegmenter,
    "threshold": ThresholdSegmenter,
    "density": DensitySegmenter,
}

__all__ = [
    "SEGMENTERS",
    "SegmentationParameters",
    "Segmented",
    "Segmenter",
    "SegmenterFactory",
    "SegmenterInParts",
    "SegmenterInTwoLooks",
    "SegmenterThatWatches",
]
