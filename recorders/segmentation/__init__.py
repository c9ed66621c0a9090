"""From a picture to its foreground mask and detections (EVENTS 2, SHELLS 2.1, PARTS 2)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorders.lazy import lazily

if TYPE_CHECKING:
    from recorders.segmentation.catalogue import SEGMENTERS
    from recorders.segmentation.parameters import SegmentationParameters
    from recorders.segmentation.segmenter import (
        Segmented,
        Segmenter,
        SegmenterFactory,
        SegmenterInParts,
        SegmenterInTwoLooks,
        SegmenterThatWatches,
    )

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

_PLACES = {
    "recorders.segmentation.catalogue": "SEGMENTERS",
    "recorders.segmentation.parameters": "SegmentationParameters",
    "recorders.segmentation.segmenter": "Segmented Segmenter SegmenterFactory SegmenterInParts"
    " SegmenterInTwoLooks SegmenterThatWatches",
}
__getattr__ = lazily(_PLACES)
