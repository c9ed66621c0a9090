"""Where one track was, for what is asked of it once the whole recording was read."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from reasoning.encounters import History
from reasoning.geometry import Area
from reasoning.questions.recording_facts import Row
from reasoning.questions.runs import SeenTarget, Sight
from reasoning.questions.standing import Steps, stays
from recorders.messages import Box, Regions

_TELLS_S, _FIRST_S = 1.0, 2.0
_LAST = 2**31 - 1
_EDGE_PX = 2.0


@dataclass
class TrackBoxes:
    """A track's boxes and what was believed of it, frame by frame."""

    frames: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)
    seen: list[bool] = field(default_factory=list)
    told: list[bool] = field(default_factory=list)
    ranks: list[int] = field(default_factory=list)
    existence: list[float] = field(default_factory=list)
    identity: list[float] = field(default_factory=list)
    joins: list[tuple[int, int]] = field(default_factory=list)

    def history(self) -> History:
        """Where it was, as encounters are found in."""
        return History(
            np.array(self.frames, np.int64),
            np.array(self.times),
            np.array(self.boxes, np.float64).reshape(-1, 4),
            np.array(self.seen, np.bool_),
        )

    def steps(self) -> Steps:
        """Where it was when, to ask who stood where."""
        return Steps(
            frames=np.array(self.frames, np.int64),
            ranks=np.array(self.ranks, np.int64),
            t=np.array(self.times),
            boxes=np.array(self.boxes, np.float64).reshape(-1, 4),
            seen=np.array(self.told, np.bool_),
            existence=np.array(self.existence),
            identity=np.array(self.identity),
            joins=self.joins,
        )

    def add(self, rank: int, frame: int, t: float, seen: SeenTarget, told: Sight) -> None:
        """Take a frame in which it was present; ``rank`` counts the recording's frames."""
        self.ranks.append(rank)
        self.told.append(told.seen)
        self.frames.append(frame)
        self.times.append(t)
        self.boxes.append(seen.box)
        self.seen.append(seen.observed)
        self.existence.append(seen.existence)
        self.identity.append(seen.identity)
        self.joins += [(frame, event) for event in seen.joins]

    def between(self, first: int, last: int) -> tuple[float, float, list[int]]:
        """Mean existence where it was observed, least identity, joins, from frame to frame."""
        span = slice(bisect_left(self.frames, first), bisect_right(self.frames, last))
        seen = [e for e, s in zip(self.existence[span], self.seen[span], strict=True) if s]
        joins = [event for frame, event in self.joins if first <= frame <= last]
        mean = sum(seen) / len(seen) if seen else 0.0
        return mean, min(self.identity[span], default=0.0), joins


def feet(box: Box) -> tuple[float, float]:
    """Where somebody stands: the middle of the box's lower side, pixels."""
    x, y, w, h = box
    return round(x + w / 2, 2), round(y + h, 2)


def first_way(history: History) -> float | None:
    """How far a target's centre was from its first place at most, in its first two seconds and in
    its own sizes; None where it was not there for a second.
    """
    since = history.times_s - history.times_s[0]
    if since[-1] < _TELLS_S:
        return None
    x, y, w, h = history.boxes[since <= _FIRST_S].T
    away = np.hypot(x + w / 2 - x[0] - w[0] / 2, y + h / 2 - y[0] - h[0] / 2)
    return round(float((away / np.sqrt(np.maximum(w * h, 1.0))).max()), 2)


def usual_height(
    boxes: NDArray[np.float64], seen: NDArray[np.bool_], size: tuple[int, int]
) -> float | None:
    """The median height of boxes (N, 4) that were seen whole, in pixels; None without any."""
    whole = seen & _within(boxes, size)
    return round(float(np.median(boxes[whole, 3])), 1) if whole.any() else None


def _within(boxes: NDArray[np.float64], size: tuple[int, int]) -> NDArray[np.bool_]:
    width, height = size
    inside = np.asarray((boxes[:, :2] > _EDGE_PX).all(axis=1), np.bool_)
    if width and height:
        inside &= boxes[:, 0] + boxes[:, 2] < width - _EDGE_PX
        inside &= boxes[:, 1] + boxes[:, 3] < height - _EDGE_PX
    return inside


def recorded_stays(
    recorded: Sequence[tuple[int, Regions]], boxes: Mapping[int, TrackBoxes], point: str
) -> Iterator[Row]:
    """Rows of ``zones``: stays in the zones that were recorded, in hindsight, as in those that are
    drawn later; none where the log has no regions.

    Args:
        recorded: regions, each with the first frame that they hold in.
        boxes: by track.
        point: where a target stands: ``foot`` or ``centre`` of its box.
    """
    down = 0.5 if point == "centre" else 1.0
    ends = [first for first, _ in recorded[1:]] + [_LAST]
    for (first, regions), end in zip(recorded, ends, strict=False):
        areas = [(zone.name, Area([zone.polygon])) for zone in regions.zones]
        for track in sorted(boxes) if areas else ():
            steps = boxes[track].steps().within(first, end)
            for name, area in areas:
                for interval, belief in stays(area, steps, down):
                    yield (track, name, *interval, *belief)
