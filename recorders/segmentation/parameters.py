"""The parameters of the segmentation: few, and relative to the picture's size and to time."""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param


@dataclass(frozen=True)
class SegmentationParameters(Parameters):
    """How a picture becomes foreground and detections (EVENTS 2, SHELLS 2.1, PARTS 2)."""

    threshold_levels: float = param(
        30.0,
        "smallest difference from the background that is foreground",
        unit="of 255 levels",
        low=1,
        high=255,
    )
    spread_weight: float = param(
        2.0,
        "foreground differs by this many times the background's own spread",
        unit="interquartile ranges",
        low=0,
        high=20,
    )
    shadow_darkest: float = param(
        0.6,
        "a shadow keeps at least this share of the background's brightness; 1 keeps shadows",
        low=0.05,
        high=1,
    )
    shadow_darkest_grey: float = param(
        0.7,
        "a shadow in a recording without colours, where it looks like dark clothes, keeps at least"
        " this share of the background's brightness, or less where bodies take most of the light; 1"
        " keeps shadows",
        low=0.05,
        high=1,
    )
    shadow_colour_levels: float = param(
        5.0,
        "a shadow changes the chroma (Cr and Cb together) by at most this",
        unit="of 255 levels",
        low=0,
        high=255,
    )
    smoothing: float = param(
        0.012,
        "window of the weighted median",
        unit="of the picture's height",
        low=0,
        high=0.2,
        source="SHELLS 2.1",
    )
    min_area: float = param(
        0.0004,
        "smallest component that is kept where the recording does not teach how large bodies"
        " usually are",
        unit="of the picture's area",
        low=0,
        high=1,
        source="SHELLS 2.1",
    )
    adaptation_s: float = param(
        2.0,
        "time in which the background follows the light by one level of 255",
        unit="s",
        low=0.01,
        high=1e6,
    )
    size_model: bool = param(
        True,
        "learn the size of bodies from the recording, and find bodies in merged blobs by it",
    )
