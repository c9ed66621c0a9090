"""Detectors: networks in ONNX files, and code of others, that find things in single pictures."""

from __future__ import annotations

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
