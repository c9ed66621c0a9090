"""How much further apart two people are in depth than the picture shows, from their sizes alone.

A camera that looks down from above shows all ways alike, and people everywhere of one size. One
that looks along the ground draws who is further off higher up and smaller, and shortens the ways
in depth. On flat ground a height h grows linearly with the place y of the feet, and its slope
k = dh/dy is the body's height over the camera's. A body at distance z has h = f H / z pixels, so
that a step down the picture is z / camera height = k f / h times as long on the ground as the
same step across. The focal length f is taken to be the picture's width (a view of 53 degrees);
where the slope cannot be told, or the view is from above, ways in depth are taken as they look.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from reasoning.encounters.pair import Floats, History

_BINS = 8
_LEAST_BOXES = 50
_LEAST_SPREAD = 0.3
_MOST_STRETCH = 3.0
_MOST_BOXES = 20_000


class GroundSlope:
    """What a recording's boxes tell of the ground.

    Attributes:
        slope: dh/dy, pixels of height per pixel down the picture; 0 if unknown.
        focal: assumed focal length, pixels.
    """

    def __init__(self, slope: float = 0.0, focal: float = 0.0) -> None:
        self.slope = slope
        self.focal = focal

    def stretch(self, heights: Floats) -> Floats:
        """(N,) by how much ways in depth are longer than they look, beside bodies of these
        heights in pixels: from 1 to 3.
        """
        seen: Floats = self.slope * self.focal / np.maximum(heights, 1.0)
        return np.clip(seen, 1.0, _MOST_STRETCH)


def ground_of(histories: Mapping[int, History], width: float | None = None) -> GroundSlope:
    """The ground under some targets.

    Args:
        histories: boxes over time of each target, by id.
        width: the picture's, pixels; None: as far as the boxes reach.
    """
    sights = [histories[history].sights().boxes for history in sorted(histories)]
    boxes = np.concatenate(sights) if sights else np.zeros((0, 4))
    if len(boxes) < _LEAST_BOXES:
        return GroundSlope()
    reach = float(np.max(boxes[:, 0] + boxes[:, 2])) if width is None else width
    boxes = boxes[:: 1 + len(boxes) // _MOST_BOXES]
    feet, heights = boxes[:, 1] + boxes[:, 3], boxes[:, 3]
    order = np.argsort(feet, kind="stable")
    bins = np.array_split(order, _BINS)
    at = [float(np.median(feet[b])) for b in bins]
    tall = [float(np.median(heights[b])) for b in bins]
    if at[-1] - at[0] < _LEAST_SPREAD * float(np.median(heights)):
        return GroundSlope()
    return GroundSlope(max(0.0, _slope(at, tall)), reach)


def _slope(at: Sequence[float], tall: Sequence[float]) -> float:
    """Median slope between all pairs (Theil and Sen)."""
    found = [
        (tall[j] - tall[i]) / (at[j] - at[i])
        for i in range(len(at))
        for j in range(i + 1, len(at))
        if at[j] > at[i]
    ]
    return float(np.median(found)) if found else 0.0
