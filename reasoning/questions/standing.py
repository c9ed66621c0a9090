"""Who stood in a zone, and who crossed a line: from where a target's feet were, in hindsight.

A target stands in the middle of its box's lower side. That point trembles while its owner stands
still, so an edge has a margin of `EDGE_SIZES` of the target's own size: who is in a zone has left
it once he is that far outside, and who is on one side of a line has changed sides once he is that
far on the other. The stay then ends with the last frame in which he was inside, the crossing is
where his way last met the line. A zone that was recorded and one that is drawn later go through
the same function, so both have the same answers.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from reasoning.geometry import Area, Floats
from reasoning.questions.runs import Belief, Interval
from reasoning.regions import EDGE_SIZES, foot_points

Point = tuple[float, float]
Ints = NDArray[np.int64]
OPPOSITE = {"left": "right", "right": "left", "up": "down", "down": "up"}


@dataclass(frozen=True)
class Steps:
    """The frames in which one target was present, in order.

    Attributes:
        frames: (N,) int64 numbers of the frames.
        ranks: (N,) int64 places of them among all frames of the recording: neighbours differ by 1.
        t: (N,) seconds.
        boxes: (N, 4) pixels.
        seen: (N,) bool, whether it was seen, or hidden by somebody who was.
        existence, identity: (N,) how likely it is somebody, and still the same.
        joins: (frame, event) of the events that joined tracks or doubt an identity.
    """

    frames: Ints
    ranks: Ints
    t: Floats
    boxes: Floats
    seen: NDArray[np.bool_]
    existence: Floats
    identity: Floats
    joins: Sequence[tuple[int, int]] = ()

    def within(self, first: int, end: int) -> Steps:
        """Those of frames from ``first`` on, before ``end``."""
        a, b = np.searchsorted(self.frames, [first, end])
        cut = slice(int(a), int(b))
        return Steps(
            frames=self.frames[cut], ranks=self.ranks[cut], t=self.t[cut], boxes=self.boxes[cut], seen=self.seen[cut],
            existence=self.existence[cut], identity=self.identity[cut],
            joins=[join for join in self.joins if first <= join[0] < end],
        )  # fmt: skip

    def belief(self, first: int, last: int) -> Belief:
        """How sure what rests on the steps from ``first`` to ``last`` is; a time without steps
        among them is one in which it was not seen.
        """
        span = slice(first, last + 1)
        seen, count = self.seen[span], int(self.ranks[last] - self.ranks[first]) + 1
        chosen = self.existence[span][seen] if seen.any() else self.existence[span]
        frames = int(self.frames[first]), int(self.frames[last])
        joins = list(dict.fromkeys(e for f, e in self.joins if frames[0] <= f <= frames[1]))
        return (
            round(int(seen.sum()) / count, 4),
            round(_in_order(chosen) / len(chosen), 4),
            round(float(self.identity[span].min()), 4),
            joins,
        )

    def interval(self, first: int, last: int) -> Interval:
        """Frames and seconds from one step to another."""
        return (
            int(self.frames[first]), int(self.frames[last]), float(self.t[first]), float(self.t[last])
        )  # fmt: skip


class Crossing(NamedTuple):
    """A target crossed a line: the first frame beyond it, where, and which way it went."""

    frame: int
    t: float
    direction: str
    x: float
    y: float
    belief: Belief


def stays(area: Area, steps: Steps, down: float = 1.0) -> list[tuple[Interval, Belief]]:
    """The stays of a target in an area, in order; one ends where the target is not present."""
    if not len(steps.frames):
        return []
    points = foot_points(steps.boxes, down)
    inside = area.contains(points)
    if not inside.any():
        return []
    beyond = ~inside & (area.depth(points) < -_edges(steps.boxes))
    held = _held(inside, beyond, np.diff(steps.ranks, prepend=steps.ranks[0] - 2) != 1)
    out = []
    for first, end in _runs(held, steps.ranks):
        last = int(first + np.flatnonzero(inside[first : end + 1])[-1])
        out.append((steps.interval(first, last), steps.belief(first, last)))
    return out


def crossings(start: Point, end: Point, steps: Steps) -> Iterator[Crossing]:
    """Every time a target crossed the line from ``start`` to ``end``, in order."""
    if len(steps.frames) < 2:
        return
    way = end[0] - start[0], end[1] - start[1]
    length = float(np.hypot(*way))
    points = foot_points(steps.boxes)
    from_line = (
        (points[:, 0] - start[0]) * way[1] - (points[:, 1] - start[1]) * way[0]
    ) / length
    settled = np.flatnonzero(np.abs(from_line) >= _edges(steps.boxes))
    beyond = from_line >= 0
    for before, after in zip(settled[:-1].tolist(), settled[1:].tolist(), strict=True):
        if beyond[before] == beyond[after]:
            continue
        over = beyond[before + 1 : after + 1] == beyond[after]
        was = beyond[before:after] == beyond[before]
        last = before + 1 + int(np.flatnonzero(over & was)[-1])
        part = from_line[last - 1] / (from_line[last - 1] - from_line[last])
        x, y = (points[last - 1] + part * (points[last] - points[last - 1])).tolist()
        along = ((x - start[0]) * way[0] + (y - start[1]) * way[1]) / length
        if 0.0 <= along <= length:
            word = positive_side(start, end)
            yield Crossing(
                int(steps.frames[last]), float(steps.t[last]),
                word if beyond[after] else OPPOSITE[word],
                round(x, 2), round(y, 2), steps.belief(before, after),
            )  # fmt: skip


def positive_side(start: Point, end: Point) -> str:
    """The direction in the picture in which a line from ``start`` to ``end`` is crossed from its
    negative to its positive side, by the larger part of its normal.

    >>> positive_side((100, 0), (100, 50)), positive_side((0, 100), (50, 100))
    ('right', 'up')
    """
    dx, dy = end[0] - start[0], end[1] - start[1]
    if abs(dy) >= abs(dx):
        return "right" if dy > 0 else "left"
    return "up" if dx > 0 else "down"


def _edges(boxes: Floats) -> Floats:
    edges: Floats = EDGE_SIZES * np.hypot(boxes[:, 2], boxes[:, 3])
    return edges


def _held(
    inside: NDArray[np.bool_], beyond: NDArray[np.bool_], fresh: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Inside until beyond: between the two, what was before; nothing was before a fresh start."""
    decided = inside | beyond | fresh
    last = np.maximum.accumulate(np.where(decided, np.arange(len(decided)), 0))
    held: NDArray[np.bool_] = inside[last]
    return held


def _runs(held: NDArray[np.bool_], ranks: Ints) -> Iterator[tuple[int, int]]:
    """First and last step of each unbroken run."""
    same = held[1:] & held[:-1] & (np.diff(ranks) == 1)
    firsts = np.flatnonzero(held & ~np.concatenate([[False], same]))
    lasts = np.flatnonzero(held & ~np.concatenate([same, [False]]))
    yield from zip(firsts.tolist(), lasts.tolist(), strict=True)


def _in_order(values: Floats) -> float:
    """The sum, added up in order: the same as that of frame after frame."""
    return float(np.cumsum(values)[-1])
