"""The parameter sections of `record`; they load none of the methods that read them."""

from __future__ import annotations

from recorders.detectors.parameters import DetectorParameters
from recorders.fusion.parameters import FusionParameters
from recorders.parameters import Parameters
from recorders.segmentation.parameters import SegmentationParameters

SECTIONS: dict[str, type[Parameters]] = {
    "segmentation": SegmentationParameters,
    "detector": DetectorParameters,
    "fusion": FusionParameters,
}
