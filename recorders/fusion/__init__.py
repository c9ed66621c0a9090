"""Detector and masks together: one set of detections, each source believed as far as it proves
reliable in this recording.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from recorders.lazy import lazily

if TYPE_CHECKING:
    from recorders.fusion.frames import FusedFrames
    from recorders.fusion.fusion import Fusion
    from recorders.fusion.holding import masks_hold
    from recorders.fusion.parameters import FusionParameters

__all__ = [
    "FusedFrames",
    "Fusion",
    "FusionParameters",
    "masks_hold",
]

_PLACES = {
    "recorders.fusion.frames": "FusedFrames",
    "recorders.fusion.fusion": "Fusion",
    "recorders.fusion.holding": "masks_hold",
    "recorders.fusion.parameters": "FusionParameters",
}
__getattr__ = lazily(_PLACES)
