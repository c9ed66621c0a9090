"""Relations between two objects (SHELLS 2.3): INDEPENDENT, INTERACTION, JOINT, and the five cases
between them.

`resolve` is the paper's table for one pair. `RelationBook` keeps it for all pairs over time: one
record per pair, so that the lists L_i are symmetric by construction. Rules that the paper does
not give:

- JOINT with disjoint shells (an identity error, a dropped frame): INTERACTION in this frame, and
  the anomaly is told.
- Same blob while INDEPENDENT: case II now, case III in the next frame.
- Exactly one of two JOINT objects is unobserved and has no blob: it is hidden by the other,
  nothing shows that their blobs differ, so they stay JOINT while their shells meet. The paper: an
  occluded object can reappear anywhere within the shell of its occluder.
- JOINT objects of which one has no blob, though it is not hidden by the other, or is in its last
  frame: INTERACTION, but not by case IV, which asks for two different blobs.
- An object that is not in the picture keeps and loses relations but starts none.
- An object that disappears ends its relations, and the change says who is gone.
- Margins and durations may damp flicker; at their defaults the rule is the paper's.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Literal

import numpy as np

from reasoning.candidate_pairs import near_pairs
from reasoning.geometry import Floats, hidden_by
from recorders.messages import NO_BLOB, Box
from recorders.parameters import Parameters, param

RelationName = Literal["INDEPENDENT", "INTERACTION", "JOINT"]
Pair = tuple[int, int]

SECOND_NS = 1_000_000_000
UNSEEN = "SHELLS 2.3, ours: who is not seen in one blob with the other is not JOINT with it"
GONE = "SHELLS 2.3, ours: an object that disappears ends its relations"


@dataclasses.dataclass(frozen=True)
class RelationParameters(Parameters):
    """Damping of the five cases; every default is the paper's rule."""

    enter_margin: float = param(
        0.0,
        "shells must overlap by this share of the smaller radius to meet (case II)",
        low=0.0,
        high=2.0,
    )
    leave_margin: float = param(
        0.0,
        "shells must be apart by this share of the smaller radius to be disjoint (case V)",
        low=0.0,
        high=10.0,
    )
    enter_duration_s: float = param(
        0.0, "shells must have met for this long (case II)", unit="s", low=0.0, high=60.0
    )
    leave_duration_s: float = param(
        0.0,
        "shells must have been disjoint for this long (case V)",
        unit="s",
        low=0.0,
        high=60.0,
    )
    blob_duration_s: float = param(
        0.0,
        "blobs must have been the same or different for this long (cases III and IV)",
        unit="s",
        low=0.0,
        high=60.0,
    )


@dataclasses.dataclass(frozen=True, slots=True)
class RelationStep:
    """What a pair does in a frame: its state afterwards and the case, ``kept`` where nothing
    changes.
    """

    after: RelationName
    case: Literal["I", "II", "III", "IV", "V", "kept", "torn"]

    @property
    def rule(self) -> str:
        """Paper and case, as events cite it."""
        if self.case == "torn":
            return "SHELLS 2.3, ours: JOINT with disjoint shells goes through INTERACTION"
        return (
            f"SHELLS 2.3 case {self.case}"
            if self.case != "kept"
            else "SHELLS 2.3, no case applies: kept"
        )


_TABLE: Mapping[tuple[RelationName, bool, bool], RelationStep] = {
    ("INDEPENDENT", False, False): RelationStep("INDEPENDENT", "I"),
    ("INDEPENDENT", False, True): RelationStep("INDEPENDENT", "I"),
    ("INDEPENDENT", True, False): RelationStep("INTERACTION", "II"),
    ("INDEPENDENT", True, True): RelationStep("INTERACTION", "II"),
    ("INTERACTION", True, False): RelationStep("INTERACTION", "kept"),
    ("INTERACTION", True, True): RelationStep("JOINT", "III"),
    ("INTERACTION", False, False): RelationStep("INDEPENDENT", "V"),
    ("INTERACTION", False, True): RelationStep("INDEPENDENT", "V"),
    ("JOINT", True, False): RelationStep("INTERACTION", "IV"),
    ("JOINT", True, True): RelationStep("JOINT", "kept"),
    ("JOINT", False, False): RelationStep("INTERACTION", "torn"),
    ("JOINT", False, True): RelationStep("INTERACTION", "torn"),
}


def resolve(before: RelationName, meets: bool, same_blob: bool) -> RelationStep:
    """The five cases for one pair (SHELLS 2.3, equations 1 to 5) and our rule for a torn JOINT.

    Args:
        before: the pair's relation at t - 1.
        meets: S_i and S_j have a point in common at t.
        same_blob: B_i = B_j at t.

    >>> resolve("INTERACTION", meets=True, same_blob=True)
    RelationStep(after='JOINT', case='III')
    """
    return _TABLE[before, meets, same_blob]


def same_blob(
    blob_i: int, seen_i: bool, blob_j: int, seen_j: bool, hidden: bool = True
) -> bool | None:
    """Whether two objects lie in one blob; None: one of them is not seen, but may be ``hidden`` by
    the other, and nothing is known of its blob. Who is hidden by the other lies in that one's blob
    where the tracker says so; what is only predicted lies in nobody's.
    """
    one = NO_BLOB != blob_i == blob_j
    if seen_i and seen_j:
        return one
    return (one or None) if seen_i != seen_j and hidden else False


@dataclasses.dataclass(slots=True)
class Edge:
    """A pair's relation that is not INDEPENDENT; ``rule`` is the one that began its present state.

    ``since_frame`` is the present state's first frame, ``met_frame`` the first one after they
    were INDEPENDENT.

    ``distance`` and ``gap`` (distance minus both radii, negative: overlap) are of the last frame,
    in pixels.
    """

    a: int
    b: int
    state: RelationName
    since_frame: int
    since_ns: int
    rule: str
    distance: float
    radius_a: float
    radius_b: float
    met_frame: int
    met_ns: int
    pending: str = ""
    pending_ns: int = 0

    @property
    def gap(self) -> float:
        """Room between the shells in pixels, negative where they overlap."""
        return self.distance - (self.radius_a + self.radius_b)


@dataclasses.dataclass(frozen=True, slots=True)
class RelationChange:
    """A pair's change of relation in one frame, with what was measured (pixels; ``lasted_ns``:
    the state before); ``unseen``: who has no blob in this frame.
    """

    a: int
    b: int
    before: RelationName
    after: RelationName
    case: str
    rule: str
    distance: float
    radius_a: float
    radius_b: float
    same_blob: bool | None
    lasted_ns: int
    since_frame: int
    gone: tuple[int, ...] = ()
    unseen: tuple[int, ...] = ()

    @property
    def anomaly(self) -> bool:
        """A JOINT pair was torn apart without having been seen to split."""
        return self.case == "torn"


@dataclasses.dataclass(frozen=True)
class Objects:
    """The N objects of a frame as rows, by id.

    ``ids`` ascending; ``centres`` (N, 2), ``radii`` (N,) in pixels; ``blobs`` region ids;
    ``seen`` observed in this frame; ``starts`` may start relations; ``leaving``: ids that must
    not stay JOINT (their last frame); ``boxes`` say who hides whom, None: whoever is near.
    """

    ids: Sequence[int]
    centres: Floats | Sequence[tuple[float, float]]
    radii: Floats | Sequence[float]
    blobs: Sequence[int]
    seen: Sequence[bool]
    starts: Sequence[bool]
    leaving: Collection[int] = ()
    boxes: Sequence[Box] | None = None

    def hidden(self, i: int, j: int) -> bool:
        """Whether one of two rows is not seen and lies within the other one, which is."""
        if self.seen[i] == self.seen[j]:
            return False
        front, behind = (i, j) if self.seen[i] else (j, i)
        return self.boxes is None or hidden_by(self.boxes[behind], self.boxes[front])

    def same_blob(self, i: int, j: int) -> bool | None:
        """Whether two rows lie in one blob, see `same_blob`."""
        hidden = self.hidden(i, j)
        return same_blob(self.blobs[i], self.seen[i], self.blobs[j], self.seen[j], hidden)


class _Discs:
    """The objects' shells as plain numbers: for the few pairs of a frame these are quicker than
    arrays.
    """

    def __init__(self, o: Objects) -> None:
        centres = o.centres.tolist() if isinstance(o.centres, np.ndarray) else o.centres
        self.x = [centre[0] for centre in centres]
        self.y = [centre[1] for centre in centres]
        self.radii: Sequence[float] = (
            o.radii.tolist() if isinstance(o.radii, np.ndarray) else o.radii
        )

    def distance(self, i: int, j: int) -> float:
        dx, dy = self.x[i] - self.x[j], self.y[i] - self.y[j]
        return math.sqrt(dx * dx + dy * dy)


class RelationBook:
    """All pairs' relations over time; the lists L_i of the paper are `of`."""

    def __init__(self, parameters: RelationParameters | None = None) -> None:
        self._p = parameters if parameters is not None else RelationParameters()
        self._edges: dict[Pair, Edge] = {}
        self._meeting: dict[Pair, int] = {}

    @property
    def edges(self) -> list[Edge]:
        """Every relation that is not INDEPENDENT, by (a, b)."""
        return [self._edges[edge] for edge in sorted(self._edges)]

    def get(self, a: int, b: int) -> Edge | None:
        """The pair's edge, None when INDEPENDENT."""
        return self._edges.get((a, b) if a < b else (b, a))

    def state_of(self, a: int, b: int) -> RelationName:
        """The pair's relation."""
        edge = self.get(a, b)
        return "INDEPENDENT" if edge is None else edge.state

    def of(self, i: int) -> list[tuple[int, RelationName]]:
        """L_i: (j, relation) of everyone related to i, by j."""
        return sorted(
            (edge.b if edge.a == i else edge.a, edge.state)
            for pair, edge in self._edges.items()
            if i in pair
        )

    def step(self, frame: int, time_ns: int, objects: Objects) -> list[RelationChange]:
        """Take a frame's objects; answer with every change, by (a, b)."""
        ids = objects.ids
        row = {identity: index for index, identity in enumerate(ids)}
        discs = _Discs(objects)
        changes: list[RelationChange] = []
        for pair in list(self._edges):
            if pair[0] not in row or pair[1] not in row:
                changes.append(self._end_of_gone(pair, row, time_ns))
                continue
            change = self._advance(
                frame, time_ns, pair, (row[pair[0]], row[pair[1]]), objects, discs
            )
            if change is not None:
                changes.append(change)
        held = {(change.a, change.b) for change in changes if change.after == "INDEPENDENT"}
        meeting: dict[Pair, int] = {}
        ready = [a and b for a, b in zip(objects.starts, objects.seen, strict=True)]
        # Most that are near on one axis are not on the other: what is cheap to ask comes first.
        for i, j in near_pairs(discs.x, discs.radii):
            if not (ready[i] and ready[j]):
                continue
            distance = discs.distance(i, j)
            if not self._may_meet(distance, discs.radii[i], discs.radii[j]):
                continue
            pair = (ids[i], ids[j])
            if pair in self._edges or pair in held:
                continue
            begun = meeting[pair] = self._meeting.get(pair, time_ns)
            if time_ns - begun >= self._p.enter_duration_s * SECOND_NS:
                changes.append(self._begin(frame, time_ns, pair, (i, j), objects, discs))
                del meeting[pair]
        self._meeting = meeting
        return sorted(changes, key=lambda c: (c.a, c.b))

    def _may_meet(self, distance: float, ra: float, rb: float) -> bool:
        """Whether two shells meet by the rule for entering."""
        limit = -self._p.enter_margin * min(ra, rb) if self._p.enter_margin else 0.0
        return distance - (ra + rb) <= limit

    def _begin(
        self, frame: int, ns: int, pair: Pair, m: Pair, objects: Objects, discs: _Discs
    ) -> RelationChange:
        step = resolve("INDEPENDENT", meets=True, same_blob=False)
        distance, ra, rb = discs.distance(*m), discs.radii[m[0]], discs.radii[m[1]]
        self._edges[pair] = Edge(
            *pair,
            state=step.after,
            since_frame=frame,
            since_ns=ns,
            rule=step.rule,
            distance=distance,
            radius_a=ra,
            radius_b=rb,
            met_frame=frame,
            met_ns=ns,
        )
        same = objects.same_blob(*m)
        return RelationChange(
            *pair,
            "INDEPENDENT",
            step.after,
            step.case,
            step.rule,
            distance=distance,
            radius_a=ra,
            radius_b=rb,
            same_blob=same,
            lasted_ns=0,
            since_frame=frame,
        )

    def _advance(
        self, frame: int, ns: int, pair: Pair, m: Pair, objects: Objects, discs: _Discs
    ) -> RelationChange | None:
        """One frame of a pair that is related: what its case demands, once it has lasted long
        enough.
        """
        edge = self._edges[pair]
        distance, ra, rb = discs.distance(*m), discs.radii[m[0]], discs.radii[m[1]]
        edge.distance, edge.radius_a, edge.radius_b = distance, ra, rb
        meets = distance - (ra + rb) <= self._p.leave_margin * min(ra, rb)
        same = objects.same_blob(*m)
        leaving = pair[0] in objects.leaving or pair[1] in objects.leaving
        one_blob = (edge.state == "JOINT" and not leaving) if same is None else same
        step = resolve(edge.state, meets, one_blob)
        if step.after == edge.state:
            edge.pending = ""
            return None
        if edge.pending != step.case:
            edge.pending, edge.pending_ns = step.case, ns
        if not leaving and ns - edge.pending_ns < self._needed_ns(step.case):
            return None
        before, began, since = edge.state, edge.since_ns, edge.since_frame
        edge.state, edge.since_frame, edge.since_ns, edge.rule, edge.pending = (
            step.after,
            frame,
            ns,
            step.rule,
            "",
        )
        if step.after == "INDEPENDENT":
            del self._edges[pair]
        case: str = step.case
        rule = step.rule
        unseen = tuple(
            i
            for i, k in zip(pair, m, strict=True)
            if objects.blobs[k] == NO_BLOB or not objects.seen[k]
        )
        if case == "IV" and (leaving or unseen):
            # Case IV asks for two blobs, and there are not two.
            case, rule, edge.rule = "unseen", UNSEEN, UNSEEN
        return RelationChange(
            *pair,
            before,
            step.after,
            case,
            rule,
            distance=distance,
            radius_a=ra,
            radius_b=rb,
            same_blob=same,
            lasted_ns=ns - began,
            since_frame=since,
            unseen=unseen,
        )

    def _needed_ns(self, case: str) -> float:
        if case == "V":
            return self._p.leave_duration_s * SECOND_NS
        return self._p.blob_duration_s * SECOND_NS if case in ("III", "IV") else 0.0

    def _end_of_gone(self, pair: Pair, row: Mapping[int, int], ns: int) -> RelationChange:
        e = self._edges.pop(pair)
        gone = tuple(i for i in pair if i not in row)
        return RelationChange(
            *pair,
            e.state,
            "INDEPENDENT",
            "gone",
            GONE,
            distance=e.distance,
            radius_a=e.radius_a,
            radius_b=e.radius_b,
            same_blob=None,
            lasted_ns=ns - e.since_ns,
            since_frame=e.since_frame,
            gone=gone,
        )

    def state(self) -> dict[str, Any]:
        """The whole book as plain data."""
        return {
            "edges": [list(dataclasses.astuple(edge)) for edge in self.edges],
            "meeting": [[a, b, ns] for (a, b), ns in sorted(self._meeting.items())],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._edges = {(e[0], e[1]): Edge(*e) for e in state["edges"]}
        self._meeting = {(a, b): ns for a, b, ns in state["meeting"]}
