"""What two targets' boxes say of one another over time: distance, relative speed, speeds, heading.

Places are where a target stands: the middle of the box's lower edge. Lengths are in body sizes,
the mean diagonal of the two boxes in that frame, so that perspective needs no calibration: who
stands twice as far away is drawn half as large, and so is the distance between two people there.
Somebody upright is one body size tall, near enough; the diagonal, unlike the height, also holds
for who lies, for animals, and for views from above.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reasoning.geometry import middles_inside

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
_BURST_STEPS, _BURST_RATIO = 8, 4


@dataclass(frozen=True)
class History:
    """One target's boxes over time.

    Attributes:
        frames: (N,) int64, ascending, without repeats.
        times_s: (N,) float64, seconds from the recording's start.
        boxes: (N, 4) float64, x, y, w, h in pixels.
        seen: (N,) bool, whether it was observed there; None: always. Where it was not, its box is
            a prediction.
    """

    frames: Ints
    times_s: Floats
    boxes: Floats
    seen: Bools | None = None

    def observed(self) -> Bools:
        """(N,) bool, whether it was observed."""
        return np.ones(len(self.frames), np.bool_) if self.seen is None else self.seen

    def sights(self) -> History:
        """The frames in which it was seen, alone."""
        if self.seen is None:
            return self
        return History(
            self.frames[self.seen], self.times_s[self.seen], self.boxes[self.seen]
        )


@dataclass(frozen=True)
class Pair:
    """Two targets over an unbroken time in which both are there; all arrays (N,), one entry for
    each moment in which both are observed.

    Attributes:
        frames: frame indices.
        times_s: seconds.
        held: (M,) the frames in which both are held to be there, seen or not.
        held_seen: (M,) whether both are seen in those: observed, or the one wholly hidden by the
            other who is (SHELLS 2.3).
        apart: (N, 2) from the one's standing point to the other's, in body sizes, median filtered.
        distance: between the standing points, in body sizes, median filtered.
        gap: room between the boxes, in body sizes, 0 where they overlap, median filtered.
        relative_speed: of one against the other, body sizes per second.
        speed_a, speed_b: body sizes per second.
        place_a, place_b: (N, 2) where each stands, in body sizes of the whole time, median
            filtered.
        agitation: relative speed over half a second, median over two: high when two wrestle, low
            when they walk.
        heading: cosine of the angle between the two motions, 0 where one stands.
    """

    frames: Ints
    times_s: Floats
    held: Ints
    held_seen: Bools
    apart: Floats
    distance: Floats
    gap: Floats
    relative_speed: Floats
    agitation: Floats
    speed_a: Floats
    speed_b: Floats
    place_a: Floats
    place_b: Floats
    heading: Floats


def spans(mask: Bools) -> list[tuple[int, int]]:
    """Runs of True as (first, last) indices, both included.

    >>> spans(np.array([True, True, False, True]))
    [(0, 1), (3, 3)]
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [
        (int(edge), int(e) - 1) for edge, e in zip(edges[::2], edges[1::2], strict=True)
    ]


def frame_step(times_s: Floats) -> float:
    """The time between frames: the median step, or, where frames come in bursts, the median of the
    mean over some steps in a row. Windows are counted in frames by it, so it must not be that of
    a burst's inside.

    >>> round(frame_step(np.arange(5) * 0.04), 9)
    0.04
    >>> bursts = np.array([0.0, 1e-6, 2e-6, 3e-6])
    >>> round(frame_step(np.concatenate([bursts + 0.16 * k for k in range(4)])), 3)
    0.04
    """
    steps = np.diff(times_s)
    if not len(steps):
        return 0.0
    median = float(np.median(steps))
    width = min(_BURST_STEPS, len(steps))
    mean = float(np.median(times_s[width:] - times_s[:-width])) / width
    return mean if mean > _BURST_RATIO * median else median


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


def _steady(places: Floats, half: int, causal: bool) -> Floats:
    """(N, 2) places, each axis median filtered."""
    return np.stack([running_median(places[:, k], half, causal) for k in (0, 1)], axis=1)


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
    a: History,
    b: History,
    window_s: float,
    gap_s: float,
    causal: bool = False,
    stretch: Callable[[Floats], Floats] | None = None,
) -> list[Pair]:
    """Two histories side by side, one `Pair` for each stretch without a gap longer than
    ``gap_s``.

    ``stretch`` says by how much ways in depth are longer than they look beside bodies of some
    heights (`ground`).

    A moment in which one of the two is not observed says nothing of them: it neither ends a
    stretch nor counts in it.
    """
    common, in_a, in_b = _common(a, b)
    if len(common) < 2:
        return []
    observed = a.observed()[in_a] & b.observed()[in_b]
    seen = both_seen(a, b, in_a, in_b)
    times = a.times_s[in_a]
    breaks = np.flatnonzero(np.diff(times) > gap_s) + 1
    found: list[Pair] = []
    for part in np.split(np.arange(len(common)), breaks):
        kept = part[observed[part]]
        if len(kept) > 1:
            held = common[part], seen[part]
            boxes = a.boxes[in_a[kept]], b.boxes[in_b[kept]]
            found.append(
                _measure(common[kept], times[kept], held, boxes, window_s, causal, stretch)
            )
    return found


def _common(a: History, b: History) -> tuple[Ints, Ints, Ints]:
    """Frames that both histories have, and where in each."""
    nobody = np.zeros(0, np.int64)
    if not (len(a.frames) and len(b.frames)):
        return nobody, nobody, nobody
    if max(a.frames[0], b.frames[0]) > min(a.frames[-1], b.frames[-1]):
        return nobody, nobody, nobody
    return np.intersect1d(a.frames, b.frames, assume_unique=True, return_indices=True)


def both_seen(a: History, b: History, in_a: Ints, in_b: Ints) -> Bools:
    """(N,) at common frames: both are observed, or one is and hides the other (SHELLS 2.3)."""
    seen_a, seen_b = a.observed()[in_a], b.observed()[in_b]
    seen: Bools = seen_a & seen_b
    for front, behind, boxes_front, boxes_behind in (
        (seen_a, seen_b, a.boxes[in_a], b.boxes[in_b]),
        (seen_b, seen_a, b.boxes[in_b], a.boxes[in_a]),
    ):
        hidden = front & ~behind
        if hidden.any():
            seen |= hidden & middles_inside(boxes_behind, boxes_front)
    return seen


def _room(a: Floats, b: Floats) -> Floats:
    """(N,) pixels between two boxes, 0 where they overlap."""
    beyond = np.maximum(a[:, :2] - b[:, :2] - b[:, 2:], b[:, :2] - a[:, :2] - a[:, 2:])
    return length(np.maximum(beyond, 0.0))


def _measure(
    frames: Ints,
    times_s: Floats,
    held: tuple[Ints, Bools],
    boxes: tuple[Floats, Floats],
    window_s: float,
    causal: bool,
    stretch: Callable[[Floats], Floats] | None,
) -> Pair:
    a, b = boxes
    step = frame_step(times_s)
    half = max(1, round(window_s / 2 / step)) if step > 0 else 1
    size = np.maximum((length(a[:, 2:]) + length(b[:, 2:])) / 2, 1.0)
    foot_a = np.stack([a[:, 0] + a[:, 2] / 2, a[:, 1] + a[:, 3]], axis=1)
    foot_b = np.stack([b[:, 0] + b[:, 2] / 2, b[:, 1] + b[:, 3]], axis=1)
    scale = np.ones((len(size), 2))
    if stretch is not None:
        scale[:, 1] = stretch((a[:, 3] + b[:, 3]) / 2)
    scale /= size[:, None]
    apart = (foot_b - foot_a) * scale
    wide = 2 * half
    move_a = velocity(foot_a, times_s, wide, causal) * scale
    move_b = velocity(foot_b, times_s, wide, causal) * scale
    speed_a, speed_b = length(move_a), length(move_b)
    product = speed_a * speed_b
    dot = move_a[:, 0] * move_b[:, 0] + move_a[:, 1] * move_b[:, 1]
    return Pair(
        frames=frames,
        times_s=times_s,
        held=held[0],
        held_seen=held[1],
        apart=_steady(apart, half, causal),
        distance=running_median(length(apart), half, causal),
        gap=running_median(_room(a, b) / size, half, causal),
        relative_speed=length(move_a - move_b),
        agitation=running_median(
            length(velocity(foot_a - foot_b, times_s, half, causal) * scale),
            2 * wide,
            causal,
        ),
        speed_a=speed_a,
        speed_b=speed_b,
        place_a=_steady(foot_a / np.median(size), half, causal),
        place_b=_steady(foot_b / np.median(size), half, causal),
        heading=np.where(product > 1e-9, dot / np.where(product > 1e-9, product, 1.0), 0.0),
    )
