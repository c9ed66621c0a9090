"""Measured values and what they are held against: the thresholds that an event names, and those
of encounters.

The thresholds of encounters are those that the recording's rows were made with (table
``encounter_parameters``), whatever the current call's are: a row that is there was found with
them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from reasoning.encounters import SAME_WAY, EncounterParameters
from reasoning.encounters.states import STILL_SIZES_PER_S
from reasoning.questions.case import Case
from reasoning.questions.literals import literal
from recorders.evidence import is_limit, limit_of

_MEDIANS = "over its own frames"


@dataclass(frozen=True)
class Measure:
    """A measured value; where a threshold decides, its comparison, the threshold, and by how much
    it was met.
    """

    name: str
    value: Any
    compare: str = ""
    threshold: float | None = None
    margin: float | None = None


def at_most(name: str, value: float, threshold: float) -> Measure:
    """A value that must not be over a threshold."""
    return Measure(name, value, "<=", threshold, threshold - value)


def at_least(name: str, value: float, threshold: float, compare: str = ">=") -> Measure:
    """A value that must reach (or exceed) a threshold."""
    return Measure(name, value, compare, threshold, value - threshold)


def measure_line(measure: Measure) -> str:
    """A measure for a person to read: value, threshold, and by how much it was met."""
    line = f"{measure.name} = {_shown(measure.value)}"
    if measure.threshold is None:
        return line
    verdict = "met by" if (measure.margin or 0) >= 0 else "missed by"
    return (
        f"{line}, wanted {measure.compare} {_shown(measure.threshold)}: {verdict}"
        f" {_shown(abs(measure.margin or 0))}"
    )


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return "[" + ", ".join(_shown(v) for v in value) + "]"
    return str(value)


def event_measures(evidence: Mapping[str, Any]) -> list[Measure]:
    """An event's evidence as measures, each with the limit that stands beside it."""
    out: list[Measure] = []
    for name, value in evidence.items():
        if is_limit(name, evidence) or name in ("before", "after", "case"):
            continue
        compare, threshold = limit_of(name, evidence)
        if threshold is None or not _is_number(value):
            out.append(Measure(name, value))
        else:
            margin = value - threshold if compare in (">", ">=") else threshold - value
            out.append(Measure(name, value, compare, threshold, margin))
    return out


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def thresholds(case: Case, recording: str) -> EncounterParameters:
    """The thresholds that a recording's encounters were found with."""
    stated = dict(
        case.rows(
            "SELECT name, value FROM encounter_parameters WHERE recording ="
            f" {literal(recording)}"
        )
    )
    return EncounterParameters(
        **{
            field.name: stated[field.name]
            for field in fields(EncounterParameters)
            if field.name in stated
        }
    )


def encounter_measures(case: Case, row: Mapping[str, Any]) -> list[Measure]:
    """Of a row of ``encounters``: what made it one, and the medians over all of its frames beside
    it.
    """
    p = thresholds(case, row["recording"])
    found = case.rows(
        "SELECT distance, relative_speed, drift, near_s, sure_frame, all_distance, all_relative_speed "
        f"FROM encounter_evidence WHERE {_same(row)} AND start_frame = {row['start_frame']}"
    )
    if not found:
        return []
    distance, pace, drift, near_s, sure, all_distance, all_pace = found[0]
    only = "in the moments together for sure"
    return [
        at_least("seconds together for sure (near and slow)", near_s, p.least_s),
        at_most(f"median distance {only}, body sizes", distance, p.near_sizes),
        at_most(f"median relative speed {only}, body sizes/s", pace, p.pace_sizes_per_s),
        at_most(
            "drift past one another from the first to the last of them, body sizes/s",
            drift,
            p.drift_sizes_per_s,
        ),
        Measure("median distance with approach and parting, body sizes", all_distance),
        Measure("median relative speed with approach and parting, body sizes/s", all_pace),
        Measure("confidence", row["confidence"]),
        Measure("evidence sufficed in frame", sure),
        Measure("back-dated by frames", max(0, sure - row["start_frame"])),
        Measure("share of its frames in which both were seen", row["seen_share"]),
        Measure("least identity", row["identity"]),
    ]


PHASE_RULES = {
    "meeting": ("ours: together, and neither walking the same way nor in contact"),
    "moving": (
        "ours: both walk, the same way (cosine between the two motions at least {same:g})"
    ),
    "contact": (
        "ours: JOINT, or within touching distance and abrupt against one another, and not"
        " walking the same way; lulls up to {gap:g} s are closed"
    ),
    "separation": (
        "ours: the last way apart, after the last moment together in which they do not yet"
        " draw away from one another"
    ),
    "approach": ("ours: the way to one another, until they are near and close in no more"),
}


def phase_rule(case: Case, row: Mapping[str, Any]) -> str:
    """What makes a phase of this kind."""
    p = thresholds(case, row["recording"])
    rule = PHASE_RULES[row["kind"]].format(same=SAME_WAY, gap=p.gap_s)
    return f"{rule}; what lasts under {p.window_s:g} s belongs to the phase before it"


def phase_measures(case: Case, row: Mapping[str, Any]) -> list[Measure]:
    """Of a row of ``phases``: what was measured over its own frames, with the thresholds that
    make its kind.
    """
    p = thresholds(case, row["recording"])
    distance, kind = f"median distance {_MEDIANS}, body sizes", row["kind"]
    pace = Measure(f"median relative speed {_MEDIANS}, body sizes/s", row["relative_speed"])
    slower = f"median speed of the slower one {_MEDIANS}, body sizes/s"
    heading = f"median cosine between the two motions {_MEDIANS}"
    if kind == "moving":
        return [
            Measure(distance, row["distance"]), pace, at_least(slower, row["slower"], p.walk_sizes_per_s),
            at_least(heading, row["heading"], SAME_WAY),
        ]  # fmt: skip
    if kind == "contact":
        return [
            *_contact(case, row, p),
            pace,
            Measure(slower, row["slower"]),
            Measure(heading, row["heading"]),
        ]
    if kind == "separation":
        last = "distance in its last frame, body sizes"
        return [
            Measure(distance, row["distance"]),
            Measure(last, row["end_distance"]),
            pace,
        ]
    return [
        Measure(distance, row["distance"]),
        pace,
        Measure(slower, row["slower"]),
        Measure(heading, row["heading"]),
    ]


def _contact(
    case: Case, row: Mapping[str, Any], encounter_parameters: EncounterParameters
) -> list[Measure]:
    """Both ways to a contact: whether it is one by JOINT, by touching and being abrupt, or by
    both.
    """
    joint = case.rows(
        f"SELECT start_frame, end_frame, start_t, end_t FROM relations WHERE {_same(row)} AND state = 'JOINT' "
        f"AND start_frame <= {row['end_frame']} AND end_frame >= {row['start_frame']} ORDER"
        " BY start_frame"
    )
    spans = [
        f"relation:{row['a']}-{row['b']}@{s} (frames {s} to {e}, {until - since:.2f} s)"
        for s, e, since, until in joint
    ]
    ways = [
        *(["JOINT"] if joint else []),
        *(["touching and abrupt"] if row["abrupt_s"] > 0 else []),
    ]
    fierce = case.rows(
        f"SELECT start_frame FROM abrupt WHERE {_same(row)} AND start_frame <= {row['end_frame']} "
        f"AND end_frame >= {row['start_frame']} ORDER BY start_frame"
    )
    touch, agitation = (
        f"median distance {_MEDIANS}, body sizes",
        f"median agitation {_MEDIANS}, body sizes/s",
    )
    by_touch = row["abrupt_s"] > 0
    return [
        Measure("a contact by", " and ".join(ways) or "a lull between contacts"),
        Measure("JOINT in it", "; ".join(spans) or "never"),
        Measure("seconds of it at touching distance and abrupt", row["abrupt_s"]),
        at_most(touch, row["distance"], encounter_parameters.touch_sizes) if by_touch
        else Measure(touch, row["distance"]),
        at_least(agitation, row["agitation"], encounter_parameters.abrupt_sizes_per_s) if by_touch
        else Measure(agitation, row["agitation"]),
        Measure("abrupt without going through (a fight's mark)",
                ", ".join(f"abrupt:{row['a']}-{row['b']}@{s}" for (s,) in fierce) or "never"),
    ]  # fmt: skip


ABRUPT_RULE = (
    "ours: within touching distance, abrupt against one another, not walking the same way,"
    " and not going through; JOINT does not count"
)


def abrupt_measures(case: Case, row: Mapping[str, Any]) -> list[Measure]:
    """Of a row of ``abrupt``: why it looks like a fight."""
    p = thresholds(case, row["recording"])
    held = "in the moments that are so by themselves"
    return [
        Measure("seconds that are so by themselves (the rest are lulls)", row["abrupt_s"]),
        at_most(f"median distance {held}, body sizes", row["distance"], p.touch_sizes),
        at_least(
            f"median agitation {held}, body sizes/s", row["agitation"], p.abrupt_sizes_per_s
        ),
        at_most(
            "way from first to last moment, share of a straight line",
            row["through"],
            p.through_share,
        ),
    ]


def near_measures(case: Case, row: Mapping[str, Any]) -> list[Measure]:
    """Of a row of ``near``."""
    p = thresholds(case, row["recording"])
    return [
        Measure(f"median distance {_MEDIANS}, sizes of the larger one", row["distance"]),
        at_most(
            f"largest distance {_MEDIANS}, sizes of the larger one",
            row["farthest"],
            p.touch_sizes,
        ),
    ]


def still_measures(row: Mapping[str, Any]) -> list[Measure]:
    """Of a row of ``still``."""
    return [
        Measure(f"median speed {_MEDIANS}, own sizes/s", row["speed"]),
        at_most(
            f"highest speed {_MEDIANS}, own sizes/s", row["fastest"], STILL_SIZES_PER_S
        ),
    ]


def _same(row: Mapping[str, Any]) -> str:
    return f"recording = {literal(row['recording'])} AND a = {row['a']} AND b = {row['b']}"


def began_with(case: Case, row: Mapping[str, Any]) -> list[Measure]:
    """Of a row of ``relations``: the measures of the event that began it."""
    events = case.rows(
        "SELECT kind, evidence, event FROM events WHERE kind IN ('interaction_started', 'joined', 'separated') "
        f"AND recording = {literal(row['recording'])} AND frame = {row['start_frame']} "
        f"AND subjects = [{row['a']}, {row['b']}]"
    )
    if not events:
        return []
    kind, evidence, number = events[0]
    return [
        Measure("began with", f"event:{number} {kind}"),
        *event_measures(json.loads(evidence)),
    ]
