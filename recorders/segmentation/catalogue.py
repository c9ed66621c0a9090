"""The segmentation methods by name."""

from __future__ import annotations

from recorders.segmentation.density import DensitySegmenter
from recorders.segmentation.motion import MotionSegmenter
from recorders.segmentation.segmenter import SegmenterFactory
from recorders.segmentation.threshold import ThresholdSegmenter

SEGMENTERS: dict[str, SegmenterFactory] = {
    "motion": MotionSegmenter,
    "threshold": ThresholdSegmenter,
    "density": DensitySegmenter,
}
