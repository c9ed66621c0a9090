"""Why: the rule, the measured values with their thresholds and margins, and the chain of states that led there.

An answer row names what it rests on by references: ``event:12``, ``relation:1-2@40`` (the interval of 1 and 2 that
frame 40 lies in; also ``encounter``, ``phase``, ``near``), ``group:3``, ``track:7@31``, ``zone:4@160``.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from reasoning.questions.case import Case
from reasoning.questions.values import literal
from recorders.errors import UsageError

_REFERENCE = re.compile(
    r"(?:event:)?(?P<event>\d{1,10})|group:(?P<group>\d{1,10})"
    r"|(?P<single>track|zone):(?P<one>\d{1,10})@(?P<at>\d{1,10})"
    r"|(?P<pair>relation|encounter|phase|near):(?P<a>\d{1,10})-(?P<b>\d{1,10})@(?P<since>\d{1,10})"
)
_TABLE = {"relation": "relations", "encounter": "encounters", "phase": "phases", "near": "near"}
_CHAIN = 14


@dataclass(frozen=True)
class Measure:
    """A measured value; where a threshold decides, its comparison, the threshold, and by how much it was met."""

    name: str
    value: Any
    compare: str = ""
    threshold: float | None = None
    margin: float | None = None


@dataclass(frozen=True)
class Explanation:
    """Why a row is in an answer.

    Attributes:
        reference: what was explained.
        recording: whose it is.
        kind: the event's kind, the relation's state, ...
        text: in words.
        rule: paper and case, or ours.
        subjects: track ids.
        start_frame, end_frame, start_t, end_t: when; of an event both are its frame.
        measures: the values.
        chain: what led there, oldest first, in words.
        evidence: the event's evidence as it was recorded.
    """

    reference: str
    recording: str
    kind: str
    text: str
    rule: str
    subjects: list[int]
    start_frame: int
    end_frame: int
    start_t: float
    end_t: float
    measures: list[Measure]
    chain: list[str]
    evidence: Mapping[str, Any]

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    def lines(self) -> list[str]:
        """For a person to read."""
        when = f"frame {self.start_frame}, {self.start_t:.2f} s"
        if self.end_frame != self.start_frame:
            when = (
                f"frames {self.start_frame} to {self.end_frame}, {self.start_t:.2f} to {self.end_t:.2f} s "
                f"({self.end_t - self.start_t:.2f} s)"
            )
        out = [f"{self.reference}: {self.kind}", f"  {self.text}", f"  when:  {when}", f"  rule:  {self.rule}"]
        if self.measures:
            out.append("  measured:")
            out += [f"    {measure_line(m)}" for m in self.measures]
        if self.chain:
            out.append("  what led there:")
            out += [f"    {line}" for line in self.chain]
        return out


def measure_line(m: Measure) -> str:
    """A measure for a person to read: value, threshold, and by how much it was met."""
    line = f"{m.name} = {_shown(m.value)}"
    if m.threshold is None:
        return line
    verdict = "met by" if (m.margin or 0) >= 0 else "missed by"
    return f"{line}, wanted {m.compare} {_shown(m.threshold)}: {verdict} {_shown(abs(m.margin or 0))}"


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, list):
        return "[" + ", ".join(_shown(v) for v in value) + "]"
    return str(value)


def explain(case: Case, reference: str, recording: str | None = None) -> Explanation:
    """Explain what a reference names.

    Raises:
        UsageError: it names nothing, or something in several recordings; says what there is.
    """
    match = _REFERENCE.fullmatch(reference.strip())
    if match is None:
        raise UsageError(
            f"{reference!r}: give an event's number (12 or event:12) or an id of a column `explain`, "
            "like relation:1-2@40, encounter:1-2@65, group:3, track:7@31, zone:4@160"
        )
    only = "" if recording is None else f" AND recording = {literal(recording)}"
    if match["event"] is not None:
        return _event(case, int(match["event"]), only)
    if match["group"] is not None:
        return _group(case, int(match["group"]), only)
    if match["single"] is not None:
        return _single(case, match["single"], int(match["one"]), int(match["at"]), only)
    a, b = sorted((int(match["a"]), int(match["b"])))
    return _pair(case, match["pair"], (a, b), int(match["since"]), only)


def _row(case: Case, query: str, reference: str) -> dict[str, Any]:
    answer = case.sql(query)
    rows = list(answer.rows)
    if not rows:
        raise UsageError(f"{reference}: there is none")
    names = sorted({str(r[0]) for r in rows})
    if len(names) > 1:
        raise UsageError(f"{reference}: in several recordings ({', '.join(names[:5])}); give --recording")
    return dict(zip(answer.columns, rows[0], strict=True))


def _event(case: Case, number: int, only: str) -> Explanation:
    row = _row(case, f"SELECT * FROM events WHERE event = {number}{only}", f"event:{number}")  # noqa: S608
    evidence = json.loads(row["evidence"] or "{}")
    evidence = evidence if isinstance(evidence, dict) else {"evidence": evidence}
    subjects = list(row["subjects"])
    return Explanation(
        f"event:{number}", row["recording"], row["kind"], row["text"], row["rule"], subjects,
        row["frame"], row["frame"], row["t"], row["t"], measures(row["kind"], evidence),
        chain(case, row["recording"], subjects, row["t"], f"event:{number}"), evidence,
    )  # fmt: skip


def measures(kind: str, evidence: Mapping[str, Any]) -> list[Measure]:
    """An event's evidence as measures; thresholds are those that the evidence names and those of SHELLS' cases."""
    out: list[Measure] = []
    for name, value in evidence.items():
        if name.endswith(("_at_most", "_at_least")) or name in ("before", "after", "case"):
            continue
        compare, threshold = _threshold(kind, name, evidence)
        if threshold is None or not _is_number(value):
            out.append(Measure(name, value))
        else:
            margin = value - threshold if compare in (">", ">=") else threshold - value
            out.append(Measure(name, value, compare, threshold, margin))
    return out


def _threshold(kind: str, name: str, evidence: Mapping[str, Any]) -> tuple[str, float | None]:
    for end, compare in (("_at_most", "<="), ("_at_least", ">=")):
        stated = evidence.get(f"{name}{end}")
        if _is_number(stated):
            return compare, float(stated or 0)
    if name == "shell_gap_px":  # two discs meet where the gap between them is at most 0
        return ("<=", 0.0) if evidence.get("after") != "INDEPENDENT" and "gone" not in evidence else (">", 0.0)
    if name == "safety_distance" and _is_number(evidence.get("collision_at_most")):
        limit = float(evidence["collision_at_most"])
        return (">", limit) if kind == "single" else ("<=", limit)
    return "", None


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _group(case: Case, label: int, only: str) -> Explanation:
    row = _row(case, f"SELECT * FROM groups WHERE group_id = {label}{only} ORDER BY start_frame", f"group:{label}")  # noqa: S608
    name, members = row["recording"], list(row["members"])
    events = case.rows(
        f"SELECT e.event, e.kind, e.t, e.text, e.rule FROM events e JOIN event_groups g USING (recording, event) "  # noqa: S608
        f"WHERE g.group_id = {label} AND e.recording = {literal(name)} ORDER BY e.event"
    )
    formed = f", formed from group {_listed(row['formed_from'])}" if row["formed_from"] else ""
    ended = f"; {row['ended_by']} ended it" if row["ended_by"] else "; it lasted to the end"
    rule = next((e[4] for e in events if e[1] in ("group_formed", "group_changed", "group_entered_scene")), "")
    chained = [f"{t:.2f} s: event:{n} {kind}: {text}" for n, kind, t, text, _ in events]
    return Explanation(
        f"group:{label}", name, "group", f"Group {label} of {_listed(members)}{formed}{ended}.",
        rule or "EVENTS 3.1: a group is a JOINT component", members, row["start_frame"], row["end_frame"],
        row["start_t"], row["end_t"], [], chained or chain(case, name, members, row["start_t"], f"group:{label}"), {},
    )  # fmt: skip


def _single(case: Case, kind: str, track: int, at: int, only: str) -> Explanation:
    table = "zones" if kind == "zone" else "presence"
    reference = f"{kind}:{track}@{at}"
    row = _row(
        case,
        f"SELECT * FROM {table} WHERE track = {track} AND {at} BETWEEN start_frame AND end_frame{only} "  # noqa: S608
        "ORDER BY start_frame DESC",
        reference,
    )
    where = f"was in the zone {row['zone']!r}" if kind == "zone" else "was present"
    bits = case.rows(
        f"SELECT bit, partners, start_frame, end_frame FROM bits WHERE track = {track} AND "  # noqa: S608
        f"{at} BETWEEN start_frame AND end_frame AND recording = {literal(row['recording'])} ORDER BY bit"
    )
    found = [Measure(f"{bit} in frame {at}", f"with {_listed(p)}, frames {s} to {e}") for bit, p, s, e in bits]
    return Explanation(
        reference, row["recording"], kind, f"Target {track} {where}.",
        "EVENTS 3.2: a target's centroid in the zone" if kind == "zone" else "EVENTS 2, 3.1: the target's own state",
        [track], row["start_frame"], row["end_frame"], row["start_t"], row["end_t"], found,
        chain(case, row["recording"], [track], row["start_t"], reference), {},
    )  # fmt: skip


def _pair(case: Case, kind: str, ids: tuple[int, int], since: int, only: str) -> Explanation:
    a, b = ids
    reference = f"{kind}:{a}-{b}@{since}"
    row = _row(
        case,
        f"SELECT * FROM {_TABLE[kind]} WHERE a = {a} AND b = {b} "  # noqa: S608
        f"AND {since} BETWEEN start_frame AND end_frame{only} ORDER BY start_frame DESC",
        reference,
    )
    name = row["recording"]
    led = chain(case, name, [a, b], row["start_t"], reference)
    span = (row["start_frame"], row["end_frame"], row["start_t"], row["end_t"])
    if kind == "relation":
        return Explanation(
            reference, name, row["state"], f"Targets {a} and {b} were in the relation {row['state']}.",
            "SHELLS 2.3: shells that meet are INTERACTION, with one blob JOINT", [a, b], *span,
            _began(case, name, ids, row), led, {},
        )  # fmt: skip
    if kind == "near":
        text = f"Targets {a} and {b} stood within touching distance."
        return Explanation(reference, name, kind, text, "ours: standing points", [a, b], *span, [], led, {})
    return Explanation(
        reference, name, f"{kind} ({row['kind']})",
        f"Targets {a} and {b} were socially together, for the most part: {row['kind']}.",
        "ours: encounters in hindsight (near, slow against one another, not passing, long enough)", [a, b], *span,
        _encounter_measures(case, name, ids, span[0]), led, {},
    )  # fmt: skip


def _began(case: Case, name: str, ids: tuple[int, int], row: Mapping[str, Any]) -> list[Measure]:
    """The measures of the event that began a relation's interval."""
    events = case.rows(
        "SELECT kind, evidence, event FROM events WHERE kind IN ('interaction_started', 'joined', 'separated') "  # noqa: S608
        f"AND recording = {literal(name)} AND frame = {row['start_frame']} AND subjects = [{ids[0]}, {ids[1]}]"
    )
    if not events:
        return []
    kind, evidence, number = events[0]
    return [Measure("began with", f"event:{number} {kind}"), *measures(kind, json.loads(evidence))]


def _encounter_measures(case: Case, name: str, ids: tuple[int, int], frame: int) -> list[Measure]:
    p = case.encounters
    rows = case.rows(
        "SELECT v.distance, v.relative_speed, v.drift, v.near_s, v.sure_frame, e.confidence, e.start_frame "  # noqa: S608
        "FROM encounter_evidence v JOIN encounters e USING (recording, a, b, start_frame) "
        f"WHERE recording = {literal(name)} AND a = {ids[0]} AND b = {ids[1]} "
        f"AND {frame} BETWEEN e.start_frame AND e.end_frame"
    )
    if not rows:
        return []
    distance, pace, drift, near_s, sure, confidence, start = rows[0]
    return [
        Measure("median distance in body sizes", distance, "<=", p.near_sizes, p.near_sizes - distance),
        Measure("median relative speed in body sizes/s", pace, "<=", p.pace_sizes_per_s, p.pace_sizes_per_s - pace),
        Measure(
            "drift past one another in body sizes/s", drift, "<=", p.drift_sizes_per_s, p.drift_sizes_per_s - drift
        ),
        Measure("seconds near and slow", near_s, ">=", p.least_s, near_s - p.least_s),
        Measure("confidence", confidence),
        Measure("evidence sufficed in frame", sure),
        Measure("back-dated by frames", sure - start),
    ]


def chain(case: Case, recording: str, subjects: Sequence[int], until_t: float, reference: str) -> list[str]:
    """The states and events of the subjects that began before a moment, oldest first, the last few of them."""
    if not subjects:
        return []
    ids = ", ".join(str(s) for s in sorted(subjects))
    within = f"[{ids}]"
    both = f"a IN ({ids}) AND b IN ({ids})" if len(subjects) > 1 else f"(a IN ({ids}) OR b IN ({ids}))"
    rows = case.rows(
        f"""SELECT * FROM (
        SELECT start_t AS t, end_t, format('{{}} and {{}} were {{}}', a, b, state) AS what,
          format('relation:{{}}-{{}}@{{}}', a, b, start_frame) AS ref
        FROM relations WHERE recording = {literal(recording)} AND {both} AND start_t <= {until_t!r}
        UNION ALL
        SELECT start_t, end_t, format('group {{}} of {{}}', group_id, members), format('group:{{}}', group_id)
        FROM groups WHERE recording = {literal(recording)} AND list_has_any(members, {within})
          AND start_t <= {until_t!r}
        UNION ALL
        SELECT t, t, text, format('event:{{}}', event)
        FROM events WHERE recording = {literal(recording)} AND len(subjects) > 0 AND list_has_all({within}, subjects)
          AND kind <> 'mode_changed' AND t <= {until_t!r})
        WHERE ref <> {literal(reference)} ORDER BY t DESC, end_t DESC, ref DESC LIMIT {_CHAIN}"""  # noqa: S608
    )
    return [
        f"{t:.2f} s: {what} ({ref})" if t == end else f"{t:.2f} to {end:.2f} s: {what} ({ref})"
        for t, end, what, ref in reversed(rows)
    ]


def _listed(ids: Sequence[int]) -> str:
    words = [str(i) for i in ids]
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}" if words else "nobody"
