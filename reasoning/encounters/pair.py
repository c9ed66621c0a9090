"""What two targets' boxes say of one another over time: distance, relative speed, speeds, heading.

Places are where a target stands: the middle of the box's lower edge. Lengths are in body sizes,
the mean diagonal of the two boxes in that frame, so that perspective needs no calibration: who
stands twice as far away is drawn half as large, and so is the distance between two people there.
Somebody upright is one body size tall, near enough; the diagonal, unlike the height, also holds
for who lies, for animals, and for views from above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class History:
    """One target's boxes over time.

    Attributes:
        frames: (N,) int64, ascending, without repeats.
        times_s: (N,) float64, seconds from the recording's start.
        boxes: (N, 4) float64, x, y, w, h in pixels.
    """

    frames: Ints
    times_s: Floats
    boxes: Floats


@dataclass(frozen=True)
class Pair:
    """Two targets over an unbroken time in which both are seen (short gaps filled); all arrays
    (N,).

    Attributes:
        frames: frame indices.
        times_s: seconds.
        apart: (N, 2) from the one's standing point to the other's, in body sizes, median filtered.
        distance: between the standing points, in body sizes, median filtered.
        relative_speed: of one against the other, body sizes per second.
        speed_a, speed_b: body sizes per second.
        agitation: relative speed over half a second, median over two: high when two wrestle, low
            when they walk.
        heading: cosine of the angle between the two motions, 0 where one stands.
    """

    frames: Ints
    times_s: Floats
    apart: Floats
    distance: Floats
    relative_speed: Floats
    agitation: Floats
    speed_a: Floats
    speed_b: Floats
    heading: Floats


def spans(mask: Bools) -> list[tuple[int, int]]:
    """Runs of True as (first, last) indices, both included.

    >>> spans(np.array([True, True, False, True]))
    [(0, 1), (3, 3)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(s), int(e) - 1) for s, e in zip(edges[::2], edges[1::2], strict=True)]


def running_median(values: Floats, half: int, causal: bool = False) -> Floats:
    """Median over ``half`` values on either side (over the last ``2 half + 1`` when causal); ends
    are repeated.
    """
    if half < 1 or len(values) < 2:
        return values
    width = 2 * half + 1
    before = width - 1 if causal else half
    padded = np.concatenate(
        [np.repeat(values[:1], before), values, np.repeat(values[-1:], width - 1 - before)]
    )
    middle: Floats = np.median(
        np.lib.stride_tricks.sliding_window_view(padded, width), axis=1
    )
    return middle


def velocity(places: Floats, times_s: Floats, half: int, causal: bool = False) -> Floats:
    """Mean velocity over a window around (before, when causal) each moment; (N, 2) in, (N, 2) per
    second out.
    """
    index = np.arange(len(places))
    low = np.maximum(index - (2 * half if causal else half), 0)
    high = index if causal else np.minimum(index + half, len(places) - 1)
    seconds = times_s[high] - times_s[low]
    return (places[high] - places[low]) / np.where(seconds > 0, seconds, 1.0)[:, None]


def length(vectors: Floats) -> Floats:
    """Euclidean length of (N, 2) vectors, written out so that it is the same on every machine."""
    return np.sqrt(vectors[:, 0] * vectors[:, 0] + vectors[:, 1] * vectors[:, 1])


def pairs(
    a: History, b: History, window_s: float, gap_s: float, causal: bool = False
) -> list[Pair]:
    """Two histories side by side, one `Pair` for each stretch without a gap longer than
    ``gap_s``.
    """
    first, last = (
        max(int(a.frames[0]), int(b.frames[0])),
        min(int(a.frames[-1]), int(b.frames[-1])),
    )
    if first > last:
        return []
    common, in_a, in_b = np.intersect1d(
        a.frames, b.frames, assume_unique=True, return_indices=True
    )
    if len(common) < 2:
        return []
    times = a.times_s[in_a]
    breaks = np.flatnonzero(np.diff(times) > gap_s) + 1
    return [
        _measure(
            common[part],
            times[part],
            a.boxes[in_a[part]],
            b.boxes[in_b[part]],
            window_s,
            causal,
        )
        for part in np.split(np.arange(len(common)), breaks)
        if len(part) > 1
    ]


def _measure(
    frames: Ints, times_s: Floats, a: Floats, b: Floats, window_s: float, causal: bool
) -> Pair:
    step = float(np.median(np.diff(times_s)))
    half = max(1, round(window_s / 2 / step)) if step > 0 else 1
    size = np.maximum((length(a[:, 2:]) + length(b[:, 2:])) / 2, 1.0)
    foot_a = np.stack([a[:, 0] + a[:, 2] / 2, a[:, 1] + a[:, 3]], axis=1)
    foot_b = np.stack([b[:, 0] + b[:, 2] / 2, b[:, 1] + b[:, 3]], axis=1)
    apart = (foot_b - foot_a) / size[:, None]
    wide = 2 * half
    move_a = velocity(foot_a, times_s, wide, causal) / size[:, None]
    move_b = velocity(foot_b, times_s, wide, causal) / size[:, None]
    speed_a, speed_b = length(move_a), length(move_b)
    product = speed_a * speed_b
    dot = move_a[:, 0] * move_b[:, 0] + move_a[:, 1] * move_b[:, 1]
    return Pair(
        frames=frames,
        times_s=times_s,
        apart=np.stack([running_median(apart[:, k], half, causal) for k in (0, 1)], axis=1),
        distance=running_median(length(foot_a - foot_b) / size, half, causal),
        relative_speed=length(move_a - move_b),
        agitation=running_median(
            length(velocity(foot_a - foot_b, times_s, half, causal) / size[:, None]),
            2 * wide,
            causal,
        ),
        speed_a=speed_a,
        speed_b=speed_b,
        heading=np.where(product > 1e-9, dot / np.where(product > 1e-9, product, 1.0), 0.0),
    )
