"""How large a body stands at a place of the picture: learnt from the recording's own isolated
blobs.

For bodies on one ground plane seen by a level camera, the height in the picture is linear in the
height of the foot: h = slope * y_foot + intercept; the width is a share of the height. Blobs of
several bodies, of parts of bodies and of shadows are outliers, so the fit looks for the line that
most blobs agree with.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

MIN_BLOBS = 16
"""Fewer blobs than this teach nothing."""
TOLERANCE = 0.15
"""A blob agrees with the line within this share of the height."""
MIN_AGREEING = 0.3
"""Share of blobs that have to agree."""
MAX_ASPECT = 0.9
"""Bodies are upright: width over height below this."""
MIN_UPRIGHT = 0.6
"""Share of blobs that are upright: fish and flies turn every way."""
TRUNK = 0.88
"""A body's width, of that of its blob: blobs are wider by striding legs, swinging arms and
shadow.
"""
STEEPNESS = 0.5
"""A slope is the bodies' height over the camera's; cameras hang high, so support is divided by 1
+ this * slope^2.
"""
MAX_SLOPE = 1.6
HYPOTHESES = 1500
PART_OVERLAP = 0.5
"""Parts of a body lie one above the other over at least this share of the narrower one's width."""
PART_GAP = 0.1
"""Between them lies at most this share of their common height."""


@dataclass(frozen=True)
class SizeModel:
    """The size of a body by the place of its foot.

    Attributes:
        slope: growth of the height in px per px of y_foot.
        intercept: height at y_foot = 0, px.
        aspect: width over height.
        low: first decile of the heights that it was learnt from, px; half of it is the smallest
            that it expects.
        high: last decile, px; one and a half of it is the largest that it expects.
    """

    slope: float
    intercept: float
    aspect: float
    low: float
    high: float

    def heights(self, y_foot: Floats) -> Floats:
        """Heights in px of bodies whose feet are at ``y_foot`` (px, any shape)."""
        return np.clip(
            self.slope * y_foot + self.intercept, 0.5 * self.low, 1.5 * self.high
        )

    def first_foot(self) -> float:
        """The smallest y_foot in px where a body is expected: where the smallest expected one
        stands.
        """
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


def learn(boxes: Floats, width: int, height: int) -> SizeModel | None:
    """Fit the size model to blobs.

    Args:
        boxes: (N, 4) x, y, w, h in px of blobs from many frames.
        width: the picture's width, px.
        height: the picture's height, px.

    Returns:
        The model, or None where the blobs do not agree on one (few of them, other kinds of bodies).
    """
    inside = (boxes[:, 0] > 1) & (boxes[:, 1] > 1)
    inside &= (boxes[:, 0] + boxes[:, 2] < width - 1) & (
        boxes[:, 1] + boxes[:, 3] < height - 1
    )
    upright = inside & (boxes[:, 2] < MAX_ASPECT * boxes[:, 3])
    b = boxes[upright][_distinct(boxes[upright])]
    if len(b) < MIN_BLOBS or np.count_nonzero(upright) < MIN_UPRIGHT * np.count_nonzero(
        inside
    ):
        return None
    foot, h = b[:, 1] + b[:, 3], b[:, 3]
    slope, intercept = _line(foot, h, 0.1 * height)
    agree = np.abs(h - (slope * foot + intercept)) <= TOLERANCE * (slope * foot + intercept)
    if np.count_nonzero(agree) < max(MIN_BLOBS / 2, MIN_AGREEING * len(b)):
        return None
    aspect = TRUNK * float(np.sort(b[agree, 2] / h[agree])[np.count_nonzero(agree) // 2])
    heights = np.sort(slope * foot[agree] + intercept)
    few = len(heights) // 10
    return SizeModel(
        slope, intercept, aspect, float(heights[few]), float(heights[-1 - few])
    )


def regrouped(boxes: Floats) -> Floats:
    """Bodies that a frame's blobs are the parts of: blobs one above the other, nearly touching,
    are taken together.

    Where a body has the background's colours at the waist, its blobs are an upper and a lower
    half, and none of them has a body's size.

    Args:
        boxes: (N, 4) x, y, w, h in px of one frame's blobs.

    Returns:
        (M, 4), M <= N.
    """
    found = [(x, y, x + w, y + h) for x, y, w, h in boxes.tolist()]
    found.sort(key=lambda b: (b[1], b[0]))
    k = 0
    while k < len(found):
        one = found[k]
        other = next(
            (i for i in range(k + 1, len(found)) if _one_above_other(one, found[i])), None
        )
        if other is None:
            k += 1
            continue
        x1, y1, x2, y2 = found.pop(other)
        found[k] = (min(one[0], x1), min(one[1], y1), max(one[2], x2), max(one[3], y2))
        k = 0
    out = np.array(found, np.float64).reshape(-1, 4)
    out[:, 2:] -= out[:, :2]
    return out


def _one_above_other(
    a: tuple[float, float, float, float], b: tuple[float, float, float, float]
) -> bool:
    """Whether two boxes (x1, y1, x2, y2) may be parts of one body."""
    shared = min(a[2], b[2]) - max(a[0], b[0])
    gap = max(a[1], b[1]) - min(a[3], b[3])
    height = max(a[3], b[3]) - min(a[1], b[1])
    return (
        shared >= PART_OVERLAP * min(a[2] - a[0], b[2] - b[0]) and gap <= PART_GAP * height
    )


def _distinct(boxes: Floats) -> NDArray[np.int64]:
    """Rows of the first box at each place and size: who stands still for long counts once."""
    x, y, w, h = (boxes[:, k] for k in range(4))
    cell = np.maximum(3.0, TOLERANCE * h)
    place = np.stack(
        [(x + w / 2) // cell, (y + h) // cell, np.rint(np.log2(np.maximum(h, 1.0)) * 6)],
        axis=1,
    )
    _, first = np.unique(place, axis=0, return_index=True)
    return np.sort(first)


def _line(x: Floats, y: Floats, min_gap: float) -> tuple[float, float]:
    """The line that most points lie near, relative to its own value; never falling."""
    n = len(x)
    k = np.arange(HYPOTHESES)
    i, j = k * 7919 % n, (k * 7919 // n + k * 104729 + 1) % n
    far = np.abs(x[i] - x[j]) >= min_gap
    i, j = i[far], j[far]
    slopes = np.concatenate([np.zeros(n), (y[i] - y[j]) / (x[i] - x[j])])
    intercepts = np.concatenate([y, y[i] - (y[i] - y[j]) / (x[i] - x[j]) * x[i]])
    rising = (slopes >= 0) & (slopes <= MAX_SLOPE)
    slopes, intercepts = slopes[rising], intercepts[rising]
    support = _support(slopes[:, None], intercepts[:, None], x, y).sum(axis=1)
    best = int(np.argmax(support / (1 + STEEPNESS * slopes**2)))
    slope, intercept = float(slopes[best]), float(intercepts[best])
    for _ in range(5):
        weight = _support(slope, intercept, x, y)
        total = weight.sum()
        mx, my = (weight * x).sum() / total, (weight * y).sum() / total
        sxx = (weight * (x - mx) ** 2).sum()
        slope = (
            min(MAX_SLOPE, max(0.0, float((weight * (x - mx) * (y - my)).sum() / sxx)))
            if sxx > 0
            else 0.0
        )
        intercept = float(my - slope * mx)
    return slope, intercept


def _support(
    slope: Floats | float, intercept: Floats | float, x: Floats, y: Floats
) -> Floats:
    """Epanechnikov weight of each point's distance from the line, relative to the line's value."""
    line = np.maximum(slope * x + intercept, 1.0)
    return np.maximum(0.0, 1 - ((y - line) / (TOLERANCE * line)) ** 2)
