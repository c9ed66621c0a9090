"""Detectors: networks in ONNX files, and code of others, that find things in single pictures."""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorders.lazy import lazily

if TYPE_CHECKING:
    from recorders.detectors.detector import Detector, Sighting, as_detections, cut
    from recorders.detectors.onnx import ModelOptions, OnnxDetector
    from recorders.detectors.parameters import DetectorParameters

__all__ = [
    "Detector",
    "DetectorParameters",
    "ModelOptions",
    "OnnxDetector",
    "Sighting",
    "as_detections",
    "cut",
]

_PLACES = {
    "recorders.detectors.detector": "Detector Sighting as_detections cut",
    "recorders.detectors.onnx": "ModelOptions OnnxDetector",
    "recorders.detectors.parameters": "DetectorParameters",
}
__getattr__ = lazily(_PLACES)
