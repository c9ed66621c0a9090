"""From changes to events: kind, subjects, rule (paper and case), evidence with every value and
threshold, plain words.

Order of the events within a frame (total): a gap in time, then changes of the whole picture as they
were recorded; the tracker's own notices as it gave them; then life
of tracks by id (confirmed, recovered or lost, then mode), tracks removed by id; scene events of
those who are gone, then of those who are there, by id (status, zones left, zones entered, by
name); relations by (a, b); pairs' interaction by (a, b); targets that became single, by id;
groups that ended, then groups that began, by label; disagreements by (a, b); anomalies in the
order of their causes. Ids count on from 1 in this order.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from reasoning.groups import GroupChange, HeldGroup
from reasoning.interactions import InteractionParameters, PairChange
from reasoning.regions import RegionEvent
from reasoning.relations import SECOND_NS, RelationChange
from reasoning.transitions import GROUPED, GROUPING, SPLITTING, TABLE, code, name
from recorders.messages import Event, Notice, Target

PLACES = ("wholly outside", "partly inside", "wholly inside")
BIT_KINDS = {GROUPING: "grouping", GROUPED: "grouped", SPLITTING: "splitting"}


class EventLog:
    """Numbers events from 1 and gathers those of the frame at hand."""

    def __init__(self) -> None:
        self.next_id = 1
        self.events: list[Event] = []
        self._frame = 0
        self._time_ns = 0

    def open(self, frame: int, time_ns: int) -> None:
        """Begin a frame: what comes now happened in it."""
        self._frame, self._time_ns, self.events = frame, time_ns, []

    def add(
        self,
        kind: str,
        subjects: Sequence[int],
        rule: str,
        evidence: dict[str, Any],
        text: str,
        groups: Sequence[int] = (),
    ) -> None:
        """Append an event of this frame."""
        event = Event(
            self.next_id,
            kind=kind,
            subjects=list(subjects),
            frame=self._frame,
            time_ns=self._time_ns,
            rule=rule,
            evidence=evidence,
            text=text,
            groups=list(groups),
        )
        self.events.append(event)
        self.next_id += 1


def list_of(ids: Sequence[int]) -> str:
    """Ids in words.

    >>> list_of([1, 2, 5])
    '1, 2 and 5'
    """
    words = [str(identity) for identity in ids]
    return (
        " and ".join([", ".join(words[:-1]), words[-1]])
        if len(words) > 1
        else "".join(words)
    )


def seconds(ns: int) -> float:
    """Nanoseconds as seconds, to the millisecond."""
    return round(ns / SECOND_NS, 3)


_NOTICE_TEXT = {
    "track_confirmed": "{t} is confirmed.",
    "track_lost": "{t} is lost: not seen for too long.",
    "track_recovered": "{t} is found again under its old identity.",
    "track_removed": "{t} is not tracked any more.",
    "mode_changed": "{t} is tracked by {m}.",
}
BY = {"motion": "motion", "appearance": "appearance", "predicted": "prediction alone"}


def notice(log: EventLog, n: Notice) -> None:
    """Something the tracker tells of itself; what it says in words stands, else the kind speaks."""
    mode = str(n.evidence.get("to", n.evidence.get("mode", "")))
    text = n.text or _NOTICE_TEXT.get(n.kind, f"{{t}}: {n.kind}.").format(
        t=(
            f"Target {n.subjects[0]}"
            if len(n.subjects) == 1
            else f"Targets {list_of(n.subjects)}"
        ),
        m=BY.get(mode, "other means"),
    )
    if not n.text and n.kind == "track_recovered" and len(n.subjects) == 2:
        text = (
            f"Targets {list_of(n.subjects)} had been taken for one another: their"
            " identities are exchanged."
        )
    if not n.text and n.kind == "occluded" and len(n.subjects) == 2:
        text = f"Target {n.subjects[0]} is behind target {n.subjects[1]}."
    log.add(n.kind, n.subjects, n.rule, dict(n.evidence), text)


def scene_changed(log: EventLog, kind: str, evidence: Mapping[str, Any], text: str) -> None:
    """The picture changed as a whole, or there was none for a time."""
    log.add(
        "scene_changed",
        [],
        f"ours: the scene changed, {kind}",
        {"kind": kind, **evidence},
        text,
    )


def life(
    log: EventLog, kind: str, target: Target, evidence: dict[str, Any], text: str
) -> None:
    """A track is confirmed, lost, recovered, removed or followed in another way."""
    values = {
        "box": list(target.box),
        "mode": target.mode,
        "confidence": target.confidence,
        "observed": target.observed,
        **evidence,
    }
    log.add(kind, [target.id], "EVENTS 2", values, text)


_SCENE_TEXT = {
    "entering": "Target {i} is entering the scene.",
    "entered": "Target {i} has entered: it lies wholly inside the region of interest.",
    "exiting": (
        "Target {i} is exiting: a part of it is outside region of interest and border."
    ),
    "returned": (
        "Target {i} has returned: it lies wholly inside the region of interest again."
    ),
    "exited": "Target {i} has left the scene.",
    "zone_entered": "Target {i} entered zone {z}.",
    "zone_left": "Target {i} left zone {z} after {s} s.",
}


def scene(
    log: EventLog,
    change: RegionEvent,
    regions_source: str,
    box: Sequence[float],
    margins: tuple[float, float],
    in_zone: float = math.nan,
) -> None:
    """A scene event (EVENTS 3.2) or an entry into a named zone.

    Args:
        log: where it is told.
        change: the change.
        regions_source: where the regions are from.
        box: the target's, its last one if it is gone.
        margins: how far it lies within the region of interest and beyond region and border, pixels.
        in_zone: how far within the zone it stands, of a zone event.
    """
    evidence: dict[str, Any] = {}
    rule = "EVENTS 3.2"
    if change.zone:
        rule = "ours: named zones"
        evidence["zone"] = change.zone
        if change.kind == "zone_left":
            evidence["time_in_zone_s"] = seconds(change.lasted_ns)
    else:
        evidence = {
            "status_before": change.before or "none",
            "time_in_status_s": seconds(change.lasted_ns),
        }
    if change.reason:
        evidence["reason"] = change.reason
    else:
        evidence |= {"in_roi": PLACES[change.roi], "in_roi_and_border": PLACES[change.area]}
    if (
        not change.reason
        and change.kind in ("entered", "returned")
        and math.isfinite(margins[0])
    ):
        evidence |= {"within_roi_px": margins[0], "within_roi_px_at_least": 0.0}
    if change.kind == "entering" and margins[0] < 0.0:
        evidence |= {"within_roi_px": margins[0], "within_roi_px_under": 0.0}
    if change.kind == "zone_entered":
        evidence |= {"inside_px": in_zone, "inside_px_at_least": 0.0}
    if change.kind == "zone_left" and not change.reason and math.isfinite(in_zone):
        evidence |= {"inside_px": in_zone, "inside_px_at_most": 0.0}
    if (
        not change.reason
        and change.kind in ("exiting", "exited")
        and math.isfinite(margins[1])
    ):
        evidence |= {"beyond_border_px": margins[1], "beyond_border_px_over": 0.0}
    evidence |= {"box": list(box), "regions": regions_source}
    text = _SCENE_TEXT[change.kind].format(
        i=change.id, z=change.zone, s=seconds(change.lasted_ns)
    )
    log.add(change.kind, [change.id], rule, evidence, text)


_RELATION_KINDS = {
    "II": "interaction_started",
    "III": "joined",
    "IV": "separated",
    "unseen": "separated",
    "torn": "separated",
}
_RELATION_TEXT = {
    "II": "Targets {p} started to interact: their shells meet.",
    "III": "Targets {p} joined: they share one blob, their shells meet.",
    "IV": "Targets {p} separated into different blobs, their shells still meet.",
    "unseen": (
        "Targets {p} are not seen in one blob any more: {g} has none; their shells still meet."
    ),
    "V": "Targets {p} ended their interaction: their shells are disjoint.",
    "torn": (
        "Targets {p} were joined, and their shells are disjoint at once: they count as"
        " interacting for now."
    ),
    "gone": "Targets {p} ended their relation: {g} disappeared.",
}


def relation(
    log: EventLog, change: RelationChange, overlap: float, margins: dict[str, float]
) -> None:
    """A change of a pair's relation (SHELLS 2.3). Two discs meet where the gap between them is at
    most 0.
    """
    room = min(change.radius_a, change.radius_b)
    if change.case == "II":
        held = {"shell_gap_px_at_most": 0.0 - margins["enter_margin"] * room}
    else:
        ends = "at_most" if change.case in ("III", "IV", "unseen") else "over"
        held = {f"shell_gap_px_{ends}": margins["leave_margin"] * room}
    evidence: dict[str, Any] = {
        "case": change.case,
        "before": change.before,
        "after": change.after,
        "distance_px": change.distance,
        "shell_radii_px": [change.radius_a, change.radius_b],
        "shell_gap_px": change.distance - (change.radius_a + change.radius_b),
        **({} if change.gone else held),
        "shell_overlap": overlap,
        "same_blob": change.same_blob,
        "time_in_state_s": seconds(change.lasted_ns),
        "since_frame": change.since_frame,
        **margins,
    }
    if change.gone:
        evidence["gone"] = list(change.gone)
    pair = list_of([change.a, change.b])
    text = _RELATION_TEXT[change.case].format(
        p=pair, g=list_of(change.gone or change.unseen)
    )
    log.add(
        _RELATION_KINDS.get(change.case, "interaction_ended"),
        [change.a, change.b],
        change.rule,
        evidence,
        text,
    )


def safety(distance: float, margin: float) -> dict[str, float]:
    """A safety distance beside its limit: at most 1, or a margin more, safety areas superpose."""
    held = "at_most" if distance <= 1.0 + margin else "over"
    return {"safety_distance": distance, f"safety_distance_{held}": 1.0 + margin}


def _safety(change: PairChange, parameters: InteractionParameters) -> dict[str, float]:
    """A pair's safety distance, its limit, and what the safety areas are made of."""
    assert change.distance is not None, "nobody measures the distance to who is gone"
    found = safety(change.distance, parameters.leave_margin if change.before else 0.0)
    return {**found, "safety_margin": parameters.safety_margin}


def _splitting(change: PairChange, collides: bool) -> tuple[str, str]:
    """Rule and words of a pair that is splitting from this frame on."""
    both = list_of([change.a, change.b])
    if change.of_split:
        return (
            "EVENTS 3.1 born of a split",
            f"Targets {both} are splitting: one of them is born of the split.",
        )
    if collides and change.absent:
        return (
            "EVENTS 3.1, ours: no group is observed over who is lost",
            f"Targets {both} are splitting: {list_of(change.absent)}"
            f" {'is' if len(change.absent) == 1 else 'are'} lost, so that no group is seen over"
            " them.",
        )
    if collides:
        return (
            "EVENTS 3.1 splitting",
            f"Targets {both} are splitting: their group is not observed any more.",
        )
    why = (
        "their safety areas do not superpose any more, without a frame in which they split"
    )
    if change.region:
        why = f"their safety areas do not superpose any more, though they share {change.region}"
    if not change.jumped and not change.region:
        why = "one of them has disappeared"
    return (
        "EVENTS 3.1, ours: grouped targets that stop colliding are splitting for one frame",
        f"Targets {both} are splitting: {why}.",
    )


def pair(
    log: EventLog,
    change: PairChange,
    group: int | None,
    parameters: InteractionParameters,
    inferred: Collection[int] = (),
) -> None:
    """Two targets are grouping, grouped or splitting from this frame on (EVENTS 3.1).

    ``inferred``: who is born of a split by our rule, without a word of the tracker.
    """
    kind = BIT_KINDS[change.after]
    safety = _safety(change, parameters)
    evidence = {
        "before": BIT_KINDS.get(change.before, "none"),
        "after": kind,
        **safety,
        "region": change.region or "none",
        "time_in_state_s": seconds(change.lasted_ns),
    }
    both = list_of([change.a, change.b])
    rule, text = f"EVENTS 3.1 {kind}", ""
    if change.after == GROUPING:
        text = (
            f"Targets {both} are grouping: their safety areas superpose, no group is seen"
            " over them."
        )
    elif change.after == GROUPED:
        text = f"Targets {both} are grouped: they lie over one group that is observed."
    else:
        rule, text = _splitting(change, "safety_distance_at_most" in safety)
    if change.of_split:
        evidence["inferred"] = change.a in inferred or change.b in inferred
    log.add(
        kind, [change.a, change.b], rule, evidence, text, [] if group is None else [group]
    )


def single(
    log: EventLog,
    target: int,
    before: int,
    parted: Sequence[PairChange],
    parameters: InteractionParameters,
) -> None:
    """A target collides with nobody any more; ``parted``: the pairs that ended with this frame."""
    measured = [c for c in parted if c.distance is not None]
    nearest = min(measured, key=lambda c: c.distance or 0.0, default=None)
    evidence = {
        "state_before": code(before),
        "state_before_name": name(before),
        "partners_before": [c.b if c.a == target else c.a for c in parted],
        "safety_distances": [c.distance for c in parted],
        "partners_gone": sorted(i for c in parted for i in c.gone),
        **({} if nearest is None else _safety(nearest, parameters)),
    }
    log.add(
        "single",
        [target],
        "EVENTS 3.1 single",
        evidence,
        f"Target {target} is single: no partner is left.",
    )


def group(log: EventLog, group_change: GroupChange) -> None:
    """A group began, changed its members (one ended, another began), ended, or is understood to
    have entered as one.
    """
    g = group_change.group
    members = list(g.members)
    evidence: dict[str, Any] = {"members": members, "observed": g.observed}
    if group_change.kind == "group_ended":
        evidence |= {"splitting_pairs": 0, "splitting_pairs_at_most": 0}
    else:
        evidence |= {"count": len(members), "count_at_least": 2}
    if g.source:
        evidence |= {"source": g.source, "source_id": g.source_id}
    if group_change.before:
        evidence |= _membership(g, group_change.before)
    text = f"Group {g.label} of targets {list_of(members)} formed."
    if group_change.kind == "group_changed":
        old = list_of([b.label for b in group_change.before])
        text = (
            f"Group {old} ended; group {g.label} of targets {list_of(members)} began in its"
            " place."
        )
        if group_change.before[0].label == g.label:
            gone = list_of(
                [
                    member
                    for member in group_change.before[0].members
                    if member not in members
                ]
            )
            text = f"Group {g.label} goes on as targets {list_of(members)}, without {gone}."
    elif group_change.kind == "group_entered_scene":
        text = (
            f"Targets {list_of(members)} had entered the scene as one: understood as group"
            f" {g.label} when they split."
        )
    elif group_change.kind == "group_ended":
        evidence |= {
            "lasted_s": seconds(group_change.lasted_ns),
            "since_frame": g.since_frame,
            "gone": list(group_change.gone),
        }
        text = (
            f"Group {g.label} of targets {list_of(members)} ended: no two of them are"
            " splitting any more."
        )
    labels = [b.label for b in group_change.before if b.label != g.label] + [g.label]
    rules = {
        "group_formed": "EVENTS 3.1 group tracker over a collision zone",
        "group_changed": (
            "EVENTS 3.1 nobody joins a group: the old one ends, a new one begins"
        ),
        "group_ended": "EVENTS 3.1 group without observation, members apart",
        "group_entered_scene": (
            "EVENTS 3.1 a group that entered as one, detected as it splits"
        ),
    }
    rule = rules[group_change.kind]
    if labels == [g.label] and group_change.before:
        rule = (
            "EVENTS 3.1, ours: who collides with no member of a splitting group has left it"
        )
    subjects = set(members)
    if group_change.kind != "group_entered_scene":
        # Who was with one of them before has entered with nobody.
        subjects.update(member for b in group_change.before for member in b.members)
    log.add(group_change.kind, sorted(subjects), rule, evidence, text, labels)


def _membership(held_group: HeldGroup, before: Sequence[HeldGroup]) -> dict[str, Any]:
    old = sorted({member for b in before for member in b.members})
    return {
        "ended": [b.label for b in before if b.label != held_group.label],
        "began": held_group.label,
        "members_before": [list(b.members) for b in before],
        "joined": [member for member in held_group.members if member not in old],
        "left": [i for i in old if i not in held_group.members],
    }


def forbidden(log: EventLog, target: int, before: int, after: int) -> None:
    """A target made a transition that the table forbids: the reasoning contradicts itself."""
    evidence = {"from": code(before), "to": code(after), "why": TABLE[before, after].why}
    text = (
        f"Target {target} went from {name(before)} to {name(after)}, which should be"
        " impossible."
    )
    log.add("anomaly", [target], "EVENTS 3.1 transition table", evidence, text)


def torn(log: EventLog, change: RelationChange) -> None:
    """A JOINT pair's shells are disjoint."""
    evidence = {
        "distance_px": change.distance,
        "shell_radii_px": [change.radius_a, change.radius_b],
        "shell_gap_px": change.distance - (change.radius_a + change.radius_b),
        "shell_gap_px_over": 0.0,
        "same_blob": change.same_blob,
    }
    text = (
        f"Targets {list_of([change.a, change.b])} were joined, yet their shells are disjoint: an"
        " identity error or a lost frame."
    )
    log.add("anomaly", [change.a, change.b], change.rule, evidence, text)


def jumped(log: EventLog, change: PairChange, parameters: InteractionParameters) -> None:
    """A grouped pair stopped colliding without having been seen to split."""
    evidence = {"before": "grouped", **_safety(change, parameters)}
    text = (
        f"Targets {list_of([change.a, change.b])} were grouped and do not collide at once: they were"
        " not seen to split."
    )
    rule = "EVENTS 3.1, ours: the frame rate is high enough to see grouped targets split"
    log.add("anomaly", [change.a, change.b], rule, evidence, text)


def disagreement(
    log: EventLog, a: int, b: int, bit: int, state: str, measured: dict[str, Any]
) -> None:
    """The two papers' views of a pair contradict one another; both stand as they are."""
    expected = "INTERACTION" if bit in (GROUPING, SPLITTING) else "JOINT"
    kind = BIT_KINDS.get(bit, "in one group")
    evidence = {
        "interaction": kind,
        "relation": state,
        "relation_expected": expected,
        **measured,
    }
    text = (
        f"Targets {list_of([a, b])} are {kind}, which asks for {expected}, but"
        f" their shells say {state}."
    )
    log.add("disagreement", [a, b], "EVENTS 3.1 against SHELLS 2.3", evidence, text)
