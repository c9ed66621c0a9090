"""Interaction events between targets (EVENTS 3.1): safety areas, the collision map, eight states,
partner lists.

What the paper leaves open, and what is done here:

- The safety area is the ellipse in the target's box, its semi-axes longer by ``safety_margin``
  times the square root of the box's area. Two areas count as superposed when the centres'
  distance, each axis divided by the sum of both semi-axes, is at most 1: exact for ellipses of
  one shape. From a margin of 0.208 on, two targets of one shape whose boxes overlap always
  collide.
- A target's first frame (also after an absence) begins nothing, as the paper demands for
  grouping; a target born of a split is splitting from those that it collides with.
- A target that is first seen wholly inside the region of interest, its box over the box of one
  that was there before ("stable trackers are instantiated over the group region"), is taken to be
  born of a split, whether or not the tracker says so. Doors within the region are the price: who
  comes out of one beside somebody must not touch him.
- A target that is not in the picture keeps its partners while it collides, and gets no new ones;
  neither does one that is only predicted.
- A grouped target that is hidden (not observed, its predicted box within that of a partner who is)
  counts into the blob of the nearest such partner that it was grouped with and still collides
  with; or into the group tracker that it lies within.
- Grouped targets that stop colliding at once are splitting for one frame. Where they lie over
  different regions then (a jump, a frame rate too low), they were not seen to split, and it is
  told as an anomaly.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from reasoning.candidate_pairs import near_pairs
from reasoning.geometry import Bools, Floats, hidden_by, share_inside
from reasoning.transitions import GROUPED, GROUPING, SINGLE, SPLITTING
from recorders.messages import NO_BLOB, Box, GroupTrack
from recorders.parameters import Parameters, param

Pair = tuple[int, int]


@dataclasses.dataclass(frozen=True)
class InteractionParameters(Parameters):
    """Sizes that decide on collisions and on lying over a group (EVENTS 3.1)."""

    safety_margin: float = param(
        0.25,
        "the safety area reaches beyond the target by this share of the square root of its"
        " box's area",
        low=0.0,
        high=5.0,
        source="EVENTS 3.1 (value ours)",
    )
    leave_margin: float = param(
        0.0,
        "partners go on colliding until their safety distance exceeds 1 by this (damps"
        " flicker; 0 is the paper's rule)",
        low=0.0,
        high=5.0,
    )
    infer_splits: bool = param(
        True,
        "who is first seen inside the region of interest, over an older target's box, is"
        " born of a split",
    )
    over_share: float = param(
        0.5,
        "share of a target's box that must lie in a group tracker's box to lie over it",
        low=0.05,
        high=1.0,
    )


@dataclasses.dataclass(frozen=True)
class TargetRows:
    """The N targets of a frame as rows, ids ascending.

    ``boxes`` (N, 4) in pixels, an array or a list; ``blobs`` region ids; ``seen`` observed now;
    ``present`` in the picture; ``newborn`` first frame (of its life or after an absence);
    ``of_split`` born of a split in this frame; ``leaving``: ids in their last frame, which belong
    to no group's region any more.
    """

    ids: Sequence[int]
    boxes: Floats | Sequence[Box]
    blobs: Sequence[int]
    seen: Sequence[bool]
    present: Sequence[bool]
    newborn: Sequence[bool]
    of_split: Sequence[bool]
    leaving: Collection[int] = ()

    def box(self, k: int) -> Box:
        """A row's box as plain numbers."""
        x, y, w, h = self.boxes[k]
        return float(x), float(y), float(w), float(h)

    def hidden(self, behind: int, front: int) -> bool:
        """Whether a row is not seen and lies within another one that is."""
        if self.seen[behind] or not self.seen[front]:
            return False
        return hidden_by(self.box(behind), self.box(front))

    def lies_in(self, k: int, blob: int) -> bool:
        """Whether a row that names a blob lies in it: it is seen, or hidden by one who is seen in
        the same.
        """
        return self.seen[k] or (
            blob != NO_BLOB
            and any(
                b == blob and self.hidden(k, index) for index, b in enumerate(self.blobs)
            )
        )


@dataclasses.dataclass(frozen=True, slots=True)
class PairChange:
    """A pair's bit changed: ``before`` and ``after`` are 0, GROUPING, GROUPED or SPLITTING.

    ``distance`` is the safety distance (at most 1: collision), None where a partner is gone;
    ``of_split``: one of them is born of a split; ``jumped``: grouped targets are apart without
    having been seen to split; ``region``: the observed region that both lie over (its source and
    number), empty where there is none; ``absent``: those of them who are held but not in the
    picture, lost.
    """

    a: int
    b: int
    before: int
    after: int
    distance: float | None
    since_frame: int
    lasted_ns: int
    of_split: bool = False
    jumped: bool = False
    gone: tuple[int, ...] = ()
    region: str = ""
    absent: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class Cluster:
    """Members under one observed region: grouped targets in one blob or over one group tracker."""

    members: tuple[int, ...]
    source: str
    source_id: int


@dataclasses.dataclass(slots=True)
class Bond:
    """What holds between two partners, since when; ``distance`` is the last frame's safety
    distance.
    """

    bit: int
    since_frame: int
    since_ns: int
    distance: float


def pair_bit(
    before: int,
    collides: bool,
    over_group: bool,
    newborn: bool,
    of_split: bool,
    starts: bool = True,
) -> int:
    """The table of EVENTS 3.1 for one pair.

    Args:
        before: the pair's bit at t - 1 (0, GROUPING, GROUPED, SPLITTING).
        collides: their safety areas superpose at t.
        over_group: both lie over one group tracker that has an observation at t.
        newborn: one of them is in its first frame.
        of_split: one of them is born of a split in this frame.
        starts: both are in the picture and seen.

    >>> pair_bit(GROUPED, collides=True, over_group=False, newborn=False, of_split=False) == SPLITTING
    True
    """
    if not collides:
        return SPLITTING if before == GROUPED else 0
    if before in (GROUPED, SPLITTING) and not over_group:
        return SPLITTING
    if newborn and not before:
        return SPLITTING if of_split and starts else 0
    if not before and not starts:
        return 0
    return GROUPED if over_group else GROUPING


class SafetyAreas:
    """The safety areas of a frame's targets, as plain numbers: few pairs of a frame are ever
    asked for.

    Args:
        boxes: N boxes, pixels.
        margin: how far an area reaches beyond its box, in square roots of the box's area.
    """

    def __init__(self, boxes: Sequence[Box], margin: float) -> None:
        self._x: list[float] = []
        self._y: list[float] = []
        self._w: list[float] = []
        self._h: list[float] = []
        for x, y, w, h in boxes:
            area = w * h
            beyond = margin * math.sqrt(area) if area >= 0.0 else math.nan
            self._w.append(0.5 * w + beyond)
            self._h.append(0.5 * h + beyond)
            self._x.append(x + 0.5 * w)
            self._y.append(y + 0.5 * h)

    def squared(self, i: int, j: int) -> float:
        """Squared safety distance of two targets: at most 1 where their areas superpose."""
        dx = (self._x[i] - self._x[j]) / max(self._w[i] + self._w[j], 1e-9)
        dy = (self._y[i] - self._y[j]) / max(self._h[i] + self._h[j], 1e-9)
        return dx * dx + dy * dy

    def colliding(self) -> list[Pair]:
        """Rows (i, j), i < j, ascending, whose areas superpose."""
        return [
            (i, j) for i, j in near_pairs(self._x, self._w) if self.squared(i, j) <= 1.0
        ]


class InteractionBook:
    """Every pair's bit over time, and from them the targets' states and partner lists."""

    def __init__(self, parameters: InteractionParameters | None = None) -> None:
        self._p = parameters if parameters is not None else InteractionParameters()
        self._reach = (1.0 + self._p.leave_margin) ** 2
        self.bonds: dict[Pair, Bond] = {}
        self.states: dict[int, int] = {}
        self._partners: dict[int, dict[int, list[int]]] = {}

    def partners(self, i: int, bit: int) -> list[int]:
        """The targets that i is grouping, grouped or splitting with, by id."""
        return self._partners.get(i, {}).get(bit, [])

    def safety_distance(self, a: Box, b: Box) -> float:
        """The safety distance of two boxes: at most 1 where their safety areas superpose."""
        return math.sqrt(SafetyAreas([a, b], self._p.safety_margin).squared(0, 1))

    def bit_of(self, a: int, b: int) -> int:
        """What holds between two targets, 0 for nothing."""
        bond = self.bonds.get((a, b) if a < b else (b, a))
        return bond.bit if bond is not None else 0

    def step(
        self,
        frame: int,
        time_ns: int,
        target_rows: TargetRows,
        group_tracks: Sequence[GroupTrack] | None,
    ) -> tuple[list[PairChange], list[Cluster]]:
        """Take a frame's targets; answer with every pair's change, by (a, b), and the clusters
        seen in this frame.
        """
        areas = SafetyAreas(
            target_rows.boxes.tolist()
            if isinstance(target_rows.boxes, np.ndarray)
            else target_rows.boxes,
            self._p.safety_margin,
        )
        row = {identity: index for index, identity in enumerate(target_rows.ids)}
        touching = self._touching(areas, row)
        collides = set(touching)
        regions, source = self._regions(target_rows, areas, group_tracks)
        changes: list[PairChange] = []
        for pair in [
            bond for bond in self.bonds if bond[0] not in row or bond[1] not in row
        ]:
            bond = self.bonds.pop(pair)
            gone = tuple(i for i in pair if i not in row)
            lasted = time_ns - bond.since_ns
            changes.append(
                PairChange(*pair, bond.bit, 0, None, bond.since_frame, lasted, gone=gone)
            )
        todo = {(target_rows.ids[i], target_rows.ids[j]): (i, j) for i, j in touching}
        for a, b in self.bonds:
            todo.setdefault((a, b), (row[a], row[b]))
        for pair, rows in todo.items():
            number = regions[rows[0]]
            one_group = number == regions[rows[1]] != NO_BLOB
            change = self._pair(
                frame,
                time_ns,
                pair,
                rows,
                target_rows,
                one_group=one_group,
                squared=areas.squared(*rows),
                collides=rows in collides,
            )
            if change is not None:
                region = f"{source} {number}"
                changes.append(
                    dataclasses.replace(change, region=region, jumped=False)
                    if one_group
                    else change
                )
        self._collect(target_rows.ids)
        # Who is grouped with nobody, as who is only predicted may begin nothing, is no member.
        grouped = [
            rows
            for pair, rows in todo.items()
            if pair in self.bonds and self.bonds[pair].bit == GROUPED
        ]
        clusters = _clusters(target_rows.ids, regions, source, grouped)
        return sorted(changes, key=lambda c: (c.a, c.b)), clusters

    def _touching(self, areas: SafetyAreas, row: Mapping[int, int]) -> list[Pair]:
        """Rows (i, j), i < j, ascending, that collide; partners may be as far apart as the margin
        for leaving says.
        """
        touching = areas.colliding()
        if not self._p.leave_margin:
            return touching
        bound = [(row[a], row[b]) for a, b in self.bonds if a in row and b in row]
        return sorted(
            {*touching, *(rows for rows in bound if areas.squared(*rows) <= self._reach)}
        )

    def _pair(
        self,
        frame: int,
        ns: int,
        pair: Pair,
        rows: Pair,
        target_rows: TargetRows,
        *,
        one_group: bool,
        squared: float,
        collides: bool,
    ) -> PairChange | None:
        i, j = rows
        bond = self.bonds.get(pair)
        before = bond.bit if bond is not None else 0
        newborn, of_split = (
            target_rows.newborn[i] or target_rows.newborn[j],
            target_rows.of_split[i] or target_rows.of_split[j],
        )
        starts = all(target_rows.present[row] and target_rows.seen[row] for row in rows)
        after = pair_bit(before, collides, one_group, newborn, of_split, starts)
        distance = math.sqrt(squared)
        if bond is not None:
            bond.distance = distance
        if after == before:
            return None
        since, began = (
            (bond.since_frame, bond.since_ns) if bond is not None else (frame, ns)
        )
        if after:
            self.bonds[pair] = Bond(after, frame, ns, distance)
        else:
            del self.bonds[pair]
        split = after == SPLITTING and before == 0
        jumped = (
            before == GROUPED
            and not collides
            and not (pair[0] in target_rows.leaving or pair[1] in target_rows.leaving)
        )
        return PairChange(
            *pair,
            before,
            after,
            distance,
            since,
            ns - began,
            of_split=split,
            jumped=jumped,
            absent=tuple(
                identity
                for identity, k in zip(pair, rows, strict=True)
                if not target_rows.present[k]
            ),
        )

    def _regions(
        self,
        target_rows: TargetRows,
        areas: SafetyAreas,
        tracks: Sequence[GroupTrack] | None,
    ) -> tuple[list[int], str]:
        """Each target's observed region (NO_BLOB: none), and what kind of region that is."""
        if tracks is None:
            return self._blob_regions(target_rows, areas), "blob"
        seen = [track for track in tracks if track.observed]
        return [
            self._track_of(index, target_rows, seen) if seen else NO_BLOB
            for index in range(len(target_rows.ids))
        ], "group track"

    def _may_lie_over(self, k: int, target_rows: TargetRows) -> bool:
        """Newborn and leaving targets belong to no group's region; absent ones only if they were
        grouped before.
        """
        if target_rows.newborn[k] or target_rows.ids[k] in target_rows.leaving:
            return False
        return target_rows.present[k] or bool(
            self.states.get(target_rows.ids[k], 0) & GROUPED
        )

    def _blob_regions(self, target_rows: TargetRows, areas: SafetyAreas) -> list[int]:
        regions = [
            blob
            if self._may_lie_over(index, target_rows) and target_rows.lies_in(index, blob)
            else NO_BLOB
            for index, blob in enumerate(target_rows.blobs)
        ]
        for index, identity in enumerate(target_rows.ids):
            if (
                target_rows.seen[index]
                or regions[index] != NO_BLOB
                or not self.states.get(identity, 0) & GROUPED
                or not self._may_lie_over(index, target_rows)
            ):
                continue
            row = {other: index for index, other in enumerate(target_rows.ids)}
            near = [
                (areas.squared(index, row[partner]), partner)
                for partner in self.partners(identity, GROUPED)
                if partner in row
                and target_rows.blobs[row[partner]] >= 0
                and target_rows.hidden(index, row[partner])
                and areas.squared(index, row[partner]) <= self._reach
            ]
            if near:
                regions[index] = target_rows.blobs[row[min(near)[1]]]
        return regions

    def _track_of(
        self, k: int, target_rows: TargetRows, tracks: Sequence[GroupTrack]
    ) -> int:
        """The one of some observed group trackers that target k lies over: named by the tracker,
        else the largest share of its box, ties by the lower id; NO_BLOB if none. Who is not seen
        is hidden in it where he lies within it, whatever it names.
        """
        if not self._may_lie_over(k, target_rows):
            return NO_BLOB
        box = target_rows.box(k)
        best = (0.0, 0)
        for track in tracks:
            named = 2.0 if target_rows.ids[k] in track.members else 0.0
            share = named if track.members else share_inside(box, track.box)
            within = target_rows.seen[k] or hidden_by(box, track.box)
            if within and share >= self._p.over_share:
                best = max(best, (share, -track.id - 1))
        return -best[1] - 1 if best[0] else NO_BLOB

    def _collect(self, ids: Sequence[int]) -> None:
        states = dict.fromkeys(ids, SINGLE)
        if not self.bonds:
            self.states, self._partners = states, {}
            return
        partners: dict[int, dict[int, list[int]]] = {}
        for pair in sorted(self.bonds):
            bit = self.bonds[pair].bit
            for i, other in (pair, pair[::-1]):
                states[i] |= bit
                partners.setdefault(i, {}).setdefault(bit, []).append(other)
        self.states, self._partners = states, partners

    def state(self) -> dict[str, Any]:
        """The whole book as plain data."""
        return {
            "bonds": [
                [a, b, bond.bit, bond.since_frame, bond.since_ns, bond.distance]
                for (a, b), bond in sorted(self.bonds.items())
            ],
            "ids": list(self.states),
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self.bonds = {(a, b): Bond(*rest) for a, b, *rest in state["bonds"]}
        self._collect(state["ids"])


def _clusters(
    ids: Sequence[int], regions: Sequence[int], source: str, grouped: Sequence[Pair]
) -> list[Cluster]:
    """Grouped targets over one region, two or more, by their first member."""
    if not grouped:
        return []
    root = list(range(len(ids)))
    for i, j in grouped:
        ri, rj = _find(root, i), _find(root, j)
        root[max(ri, rj)] = min(ri, rj)
    found: dict[int, list[int]] = {}
    for index in range(len(ids)):
        if regions[index] != NO_BLOB:
            found.setdefault(_find(root, index), []).append(index)
    return [
        Cluster(tuple(ids[row] for row in rows), source, regions[rows[0]])
        for rows in found.values()
        if len(rows) >= 2
    ]


def _find(root: list[int], i: int) -> int:
    while root[i] != i:
        root[i] = root[root[i]]
        i = root[i]
    return i


def collision_map(boxes: Floats, margin: float) -> Bools:
    """Which targets (N, 4) collide with which, (N, N) bool, symmetric; a target does not collide
    with itself.
    """
    collides = np.zeros((len(boxes), len(boxes)), np.bool_)
    for i, j in SafetyAreas(boxes.tolist(), margin).colliding():
        collides[i, j] = collides[j, i] = True
    return collides
