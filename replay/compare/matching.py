"""Which track of one log is which of the other: by where they are, not by their numbers.

Within a frame boxes are paired by the assignment of greatest overlap (IoU >= 0.5; boxes that are
equal to the bit first; whoever were a pair before keep a small advantage); over the recording
tracks are paired by the assignment of most shared frames. Ties: lower ids first.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from recorders.annotated.reader import AnnotatedFrame
from recorders.messages import Relation, Track
from replay.compare.intervals import Interval, extend, union
from replay.trackers.association import assign, iou

MATCH_IOU = 0.5
_HABIT = 0.05
# A stretch on another's place that is shorter than this, beside longer ones, is a crossing, not a
# change.
SHORTEST_CHANGE = 5
DISCRETE = (
    "mode",
    "grouping",
    "grouped",
    "splitting",
    "scene",
    "zones",
    "hidden_parts",
    "label",
)
VALUES = (
    "ellipse",
    "velocity",
    "shell_radius",
    "confidence",
    "observed",
    "blob",
    *DISCRETE,
)
EDGE_VALUES = (
    "grouping",
    "grouped",
    "splitting",
    "shell_overlap",
    "rule",
    "since_frame",
    "since_ns",
)


@dataclass
class ValueChange:
    """A value that differs: in how many frames, where first, both values there."""

    frames: int
    first: int
    a: Any
    b: Any


@dataclass
class TrackPair:
    """A track of A and one of B while they lay over each other; ``disjoint`` counts the frames
    since in which they had nothing in common.
    """

    spans: list[Interval] = field(default_factory=list)
    frames: int = 0
    far: int = 0
    first_far: int = -1
    disjoint: int = 0
    largest_px: float = 0.0
    values: dict[str, ValueChange] = field(default_factory=dict)


@dataclass(frozen=True)
class OverlapRun:
    """A track of B lies over a track of A from a frame to a frame."""

    first: int
    last: int
    a: int
    b: int


class TrackMatching:
    """Takes the frames that both logs have, in order; then says who is whom.

    Attributes:
        pairs: (track of A, track of B) to what their common frames showed.
        edges: (edge of A, edge of B) to values that differ.
        partner: track of A to track of B; after `finish`.
        back: track of B to track of A; after `finish`.
        elsewhere_a: track of A to the frames in which it is another one of B than its partner;
            after `finish`.
        elsewhere_b: the same for B's tracks.
    """

    def __init__(self, tolerance_px: float) -> None:
        self._tolerance_px = tolerance_px
        self._fields = DISCRETE if tolerance_px > 0 else VALUES
        self._before: set[tuple[int, int]] = set()
        self._met: dict[int, list[int]] = {}
        self.pairs: dict[tuple[int, int], TrackPair] = {}
        self.edges: dict[
            tuple[tuple[int, int], tuple[int, int]], dict[str, ValueChange]
        ] = {}
        self.partner: dict[int, int] = {}
        self.back: dict[int, int] = {}
        self.elsewhere_a: dict[int, list[Interval]] = {}
        self.elsewhere_b: dict[int, list[Interval]] = {}
        self._runs_of_a: dict[int, list[OverlapRun]] = {}
        self._runs_of_b: dict[int, list[OverlapRun]] = {}

    def add(self, k: int, a: AnnotatedFrame, b: AnnotatedFrame) -> None:
        """Compare one frame that both logs have, the k-th of both together."""
        left = [track for track in a.tracks if track.present]
        right = [track for track in b.tracks if track.present]
        now: dict[int, int] = {}
        for i, j in self._frame_pairs(left, right):
            now[left[i].id] = right[j].id
            self._take(k, left[i], right[j])
        self._count_disjoint(left, right, now)
        self._before = set(now.items())
        if self._tolerance_px == 0 and a.relations != b.relations:
            theirs = {tuple(sorted((edge.a, edge.b))): edge for edge in b.relations}
            for edge in a.relations:
                at = tuple(sorted((now.get(edge.a, -1), now.get(edge.b, -1))))
                if at in theirs and theirs[at].state == edge.state:
                    self._take_edge(k, edge, theirs[at])

    def _count_disjoint(
        self, left: Sequence[Track], right: Sequence[Track], now: dict[int, int]
    ) -> None:
        """Note of tracks that lay over each other before that they do not touch now."""
        apart = {track.id: track.box for track in left if track.id in self._met}
        theirs = {track.id: track.box for track in right} if apart else {}
        for a, (x, y, w, h) in apart.items():
            for b in self._met[a]:
                if b not in theirs or now.get(a) == b:
                    continue
                u, v, p, q = theirs[b]
                if x >= u + p or u >= x + w or y >= v + q or v >= y + h:
                    self.pairs[a, b].disjoint += 1
        for a, b in now.items():
            if b not in self._met.setdefault(a, []):
                self._met[a].append(b)

    def _frame_pairs(
        self, left: Sequence[Track], right: Sequence[Track]
    ) -> list[tuple[int, int]]:
        places: dict[Any, list[int]] = {}
        for index, track in enumerate(right):
            places.setdefault(track.box, []).append(index)
        ours: dict[Any, int] = {}
        for track in left:
            ours[track.box] = ours.get(track.box, 0) + 1
        same = [
            (index, places[t.box][0])
            for index, t in enumerate(left)
            if ours[t.box] == 1 == len(places.get(t.box, ()))
        ]
        taken_a, taken_b = {i for i, _ in same}, {j for _, j in same}
        rows = [index for index in range(len(left)) if index not in taken_a]
        columns = [index for index in range(len(right)) if index not in taken_b]
        if not rows or not columns:
            return same
        overlap = iou(
            _boxes([left[row] for row in rows]),
            _boxes([right[column] for column in columns]),
        )
        habit = np.array(
            [
                [(left[row].id, right[column].id) in self._before for column in columns]
                for row in rows
            ]
        )
        found = assign(1.0 - overlap - _HABIT * habit, overlap >= MATCH_IOU)
        return sorted([*same, *((rows[i], columns[j]) for i, j in found)])

    def _take(self, frame: int, a: Track, b: Track) -> None:
        pair = self.pairs.setdefault((a.id, b.id), TrackPair())
        extend(pair.spans, frame)
        pair.frames += 1
        if a == b:
            return
        if a.box != b.box:
            (ax, ay, aw, ah), (bx, by, bw, bh) = a.box, b.box
            off = max(
                abs(ax - bx), abs(ay - by), abs(ax + aw - bx - bw), abs(ay + ah - by - bh)
            )
            if off > self._tolerance_px or (off == 0 and self._tolerance_px == 0):
                pair.far += 1
                pair.first_far = frame if pair.far == 1 else pair.first_far
                pair.largest_px = max(pair.largest_px, off)
        _note(pair.values, self._fields, frame, a, b)

    def _take_edge(self, frame: int, a: Relation, b: Relation) -> None:
        if any(getattr(a, name) != getattr(b, name) for name in EDGE_VALUES):
            _note(
                self.edges.setdefault(((a.a, a.b), (b.a, b.b)), {}),
                EDGE_VALUES,
                frame,
                a,
                b,
            )

    # -- who is whom
    # -----------------------------------------------------------------------------------------------

    def finish(self) -> None:
        """Pair the tracks."""
        for component in _components(sorted(self.pairs)):
            ids_a, ids_b = (sorted({pair[side] for pair in component}) for side in (0, 1))
            shared = np.zeros((len(ids_a), len(ids_b)))
            for a, b in component:
                shared[ids_a.index(a), ids_b.index(b)] = self.pairs[a, b].frames
            # Shares, not counts: the solver takes costs up to 1000.
            for i, j in assign(-shared / shared.max() * 900.0, shared > 0):
                self.partner[ids_a[i]] = ids_b[j]
        self.partner = dict(sorted(self.partner.items()))
        self.back = {b: a for a, b in self.partner.items()}
        by_a: dict[int, list[OverlapRun]] = {}
        by_b: dict[int, list[OverlapRun]] = {}
        for (a, b), pair in sorted(self.pairs.items()):
            runs = [OverlapRun(first, last, a, b) for first, last in pair.spans]
            by_a.setdefault(a, []).extend(runs)
            by_b.setdefault(b, []).extend(runs)
        self._runs_of_a = {a: _cleaned(found) for a, found in sorted(by_a.items())}
        self._runs_of_b = {b: _cleaned(found) for b, found in sorted(by_b.items())}
        for sides, elsewhere in (
            (self._runs_of_a, self.elsewhere_a),
            (self._runs_of_b, self.elsewhere_b),
        ):
            for track, own in sides.items():
                away = [
                    (run.first, run.last) for run in own if self.partner.get(run.a) != run.b
                ]
                elsewhere[track] = union(away)

    def followed(self, a: int, b: int) -> list[Interval]:
        """The frames in which a track of A is this track of B, which is not its partner."""
        runs = {
            run
            for side in (self._runs_of_a.get(a, ()), self._runs_of_b.get(b, ()))
            for run in side
        }
        return union(
            sorted((run.first, run.last) for run in runs if (run.a, run.b) == (a, b))
        )

    def changes(self) -> Iterator[tuple[OverlapRun, OverlapRun]]:
        """Where a track of A goes on as another one of B, or one of B as another one of A: the
        runs before and after.

        A change that both sides see is told once, as A's.
        """
        for runs in self._runs_of_a.values():
            yield from pairwise(runs)
        for runs in self._runs_of_b.values():
            for before, after in pairwise(runs):
                ends, begins = self._runs_of_a[before.a][-1], self._runs_of_a[after.a][0]
                if ends.b == before.b and begins.b == after.b:
                    yield before, after

    def translated(self, b: int, frame: int) -> int:
        """A track of B by its number in A: whom it lies on then; a negative number for one that A
        has not.
        """
        runs = self._runs_of_b.get(b)
        if not runs:
            return -1 - b
        return next((run.a for run in reversed(runs) if run.first <= frame), runs[0].a)


def _cleaned(runs: list[OverlapRun]) -> list[OverlapRun]:
    """A track's runs in order, without those that are too short to count beside longer ones,
    joined where the same.
    """
    joined = _joined(runs, SHORTEST_CHANGE)
    long = [run for run in joined if run.last - run.first + 1 >= SHORTEST_CHANGE]
    return _joined(long or joined)


def _joined(runs: Sequence[OverlapRun], gap: float = float("inf")) -> list[OverlapRun]:
    """Runs in order; those of one pair that follow one another, at most ``gap`` frames apart, as
    one.
    """
    kept: list[OverlapRun] = []
    for run in sorted(runs, key=lambda one: (one.first, one.a, one.b)):
        before = kept[-1] if kept else None
        if (
            before is not None
            and (before.a, before.b) == (run.a, run.b)
            and run.first - before.last <= gap
        ):
            kept[-1] = OverlapRun(before.first, run.last, run.a, run.b)
        else:
            kept.append(run)
    return kept


def _boxes(tracks: Sequence[Track]) -> np.ndarray:
    return np.array([track.box for track in tracks], np.float64).reshape(-1, 4)


def _note(
    changes: dict[str, ValueChange], fields: Sequence[str], frame: int, a: Any, b: Any
) -> None:
    for name in fields:
        x, y = getattr(a, name), getattr(b, name)
        if x != y:
            change = changes.setdefault(name, ValueChange(0, frame, x, y))
            change.frames += 1


def _components(pairs: Sequence[tuple[int, int]]) -> list[list[tuple[int, int]]]:
    """Pairs that hang together by a track of either side, in order."""
    root: dict[tuple[str, int], tuple[str, int]] = {}

    def find(node: tuple[str, int]) -> tuple[str, int]:
        while root.setdefault(node, node) != node:
            root[node] = root[root[node]]
            node = root[node]
        return node

    for a, b in pairs:
        root[find(("b", b))] = find(("a", a))
    out: dict[tuple[str, int], list[tuple[int, int]]] = {}
    for a, b in pairs:
        out.setdefault(find(("a", a)), []).append((a, b))
    return list(out.values())
