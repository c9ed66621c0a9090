"""How large a body stands at a place of the picture: learnt from the recording's own isolated blobs.

For bodies on one ground plane seen by a level camera, the height in the picture is linear in the height of the foot:
h = slope * y_foot + intercept; the width is a share of the height. Blobs of several bodies, of parts of bodies and of
shadows are outliers, so the fit looks for the line that most blobs agree with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MIN_BLOBS = 24
"""Fewer blobs than this teach nothing."""
TOLERANCE = 0.15
"""A blob agrees with the line within this share of the height."""
MIN_AGREEING = 0.4
"""Share of blobs that have to agree."""
MAX_ASPECT = 0.9
"""Bodies are upright: width over height below this."""
TRUNK = 0.83
"""Width of a body's trunk, of its box."""
HYPOTHESES = 1500


@dataclass(frozen=True)
class SizeModel:
    """The size of a body by the place of its foot.

    Attributes:
        slope: growth of the height in px per px of y_foot.
        intercept: height at y_foot = 0, px.
        aspect: width over height.
        low: height of the smallest body that it was learnt from, px; half of it is the smallest that it expects.
        high: height of the largest, px; one and a half of it is the largest that it expects.
    """

    slope: float
    intercept: float
    aspect: float
    low: float
    high: float

    def heights(self, y_foot: Floats) -> Floats:
        """Heights in px of bodies whose feet are at ``y_foot`` (px, any shape)."""
        return np.clip(self.slope * y_foot + self.intercept, 0.5 * self.low, 1.5 * self.high)

    def first_foot(self) -> float:
        """The smallest y_foot in px where a body is expected: where the smallest expected one stands."""
        if self.slope * 4 * self.high <= self.low:
            return 2.0
        return max(2.0, (0.5 * self.low - self.intercept) / self.slope)

    def boxes(self, x_foot: Floats, y_foot: Floats) -> Floats:
        """Boxes (N, 4) x, y, w, h in px of bodies standing at the feet (N,), (N,)."""
        h = self.heights(y_foot)
        w = self.aspect * h
        return np.stack([x_foot - w / 2, y_foot - h, w, h], axis=-1)

    def as_list(self) -> list[float]:
        """The five numbers, in the order of the fields."""
        return [self.slope, self.intercept, self.aspect, self.low, self.high]

    @classmethod
    def from_list(cls, numbers: Sequence[float]) -> SizeModel | None:
        """The model of `as_list`'s numbers; None for an empty list (nothing was learnt)."""
        return cls(*numbers) if len(numbers) == 5 else None


def learn(boxes: Floats, width: int, height: int, minor_axes: Floats | None = None) -> SizeModel | None:
    """Fit the size model to blobs.

    Args:
        boxes: (N, 4) x, y, w, h in px of blobs from many frames.
        width: the picture's width, px.
        height: the picture's height, px.
        minor_axes: (N,) minor axes of the blobs' ellipses, px: the width of the trunk, on which arms and striding legs
            weigh little; without, a usual share of the boxes' widths.

    Returns:
        The model, or None where the blobs do not agree on one (few of them, other kinds of bodies).
    """
    inside = (boxes[:, 0] > 1) & (boxes[:, 1] > 1)
    inside &= (boxes[:, 0] + boxes[:, 2] < width - 1) & (boxes[:, 1] + boxes[:, 3] < height - 1)
    upright = inside & (boxes[:, 2] < MAX_ASPECT * boxes[:, 3])
    b = boxes[upright]
    trunk = TRUNK * b[:, 2] if minor_axes is None else minor_axes[upright]
    if len(b) < MIN_BLOBS or len(b) < MIN_AGREEING * np.count_nonzero(inside):
        return None
    foot, h = b[:, 1] + b[:, 3], b[:, 3]
    slope, intercept = _line(foot, h, 0.1 * height)
    agree = np.abs(h - (slope * foot + intercept)) <= TOLERANCE * (slope * foot + intercept)
    if np.count_nonzero(agree) < max(MIN_BLOBS / 2, MIN_AGREEING * len(b)):
        return None
    aspect, spread = _shortest_half(trunk[agree] / h[agree])
    if spread > 0.5 * aspect:
        return None
    heights = np.sort(slope * foot[agree] + intercept)
    few = len(heights) // 50
    return SizeModel(slope, intercept, aspect, float(heights[few]), float(heights[-1 - few]))


def _line(x: Floats, y: Floats, min_gap: float) -> tuple[float, float]:
    """The line that most points lie near, relative to its own value; never falling."""
    n = len(x)
    k = np.arange(HYPOTHESES)
    i, j = k * 7919 % n, (k * 7919 // n + k * 104729 + 1) % n
    far = np.abs(x[i] - x[j]) >= min_gap
    i, j = i[far], j[far]
    slopes = np.concatenate([np.zeros(n), (y[i] - y[j]) / (x[i] - x[j])])
    intercepts = np.concatenate([y, y[i] - (y[i] - y[j]) / (x[i] - x[j]) * x[i]])
    rising = (slopes >= 0) & (slopes <= 1.5)
    slopes, intercepts = slopes[rising], intercepts[rising]
    best = int(np.argmax(_support(slopes[:, None], intercepts[:, None], x, y).sum(axis=1)))
    slope, intercept = float(slopes[best]), float(intercepts[best])
    for _ in range(5):
        weight = _support(slope, intercept, x, y)
        total = weight.sum()
        mx, my = (weight * x).sum() / total, (weight * y).sum() / total
        sxx = (weight * (x - mx) ** 2).sum()
        slope = max(0.0, float((weight * (x - mx) * (y - my)).sum() / sxx)) if sxx > 0 else 0.0
        intercept = float(my - slope * mx)
    return slope, intercept


def _support(slope: Floats | float, intercept: Floats | float, x: Floats, y: Floats) -> Floats:
    """Epanechnikov weight of each point's distance from the line, relative to the line's value."""
    line = np.maximum(slope * x + intercept, 1.0)
    return np.maximum(0.0, 1 - ((y - line) / (TOLERANCE * line)) ** 2)


def _shortest_half(values: Floats) -> tuple[float, float]:
    """Centre and width of the shortest interval that holds half of the values."""
    s = np.sort(values)
    m = max(1, len(s) // 2)
    widths = s[m:] - s[:-m] if len(s) > m else np.zeros(1)
    k = int(np.argmin(widths))
    return float((s[k] + s[min(k + m, len(s) - 1)]) / 2), float(widths[k])
