"""Why: the rule, the measured values with their thresholds and margins, and the chain of states
that led there.

An answer row names what it rests on by references: ``event:12``, ``relation:1-2@40`` (the
interval of 1 and 2 that frame 40 lies in; also ``encounter``, ``phase``, ``abrupt``, ``near``),
``group:3``, ``track:7@31``, ``still:4@160``, ``zone:4@160:bench`` (the zone's name as in a URL;
it may be left out where target 4 is in one zone alone), ``line:4@160:gate`` (4 crossed
it). An explanation's own reference names its interval by the first frame, whatever frame was given.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any
from urllib.parse import unquote

from reasoning.questions import thresholds
from reasoning.questions.case import Case
from reasoning.questions.clocks import NANOS, starts
from reasoning.questions.joins import joins_of
from reasoning.questions.literals import literal, zone_reference, zone_word
from reasoning.questions.thresholds import Measure, event_measures, measure_line
from reasoning.regions import EDGE_SIZES
from recorders.errors import UsageError
from recorders.told_times import clock_text

_REFERENCE = re.compile(
    r"(?:event:)?(?P<event>\d{1,10})|correction:(?P<correction>\d{1,10})|group:(?P<group>\d{1,10})"
    r"|(?P<single>track|still):(?P<one>\d{1,10})@(?P<at>\d{1,10})"
    r"|zone:(?P<inside>\d{1,10})@(?P<then>\d{1,10})(?::(?P<zone>\S+))?"
    r"|line:(?P<who>\d{1,10})@(?P<when>\d{1,10})(?::(?P<line>\S+))?"
    r"|(?P<pair>relation|encounter|phase|near|abrupt):(?P<a>\d{1,10})-(?P<b>\d{1,10})@(?P<since>\d{1,10})"
)
_TABLE = {
    "relation": "relations", "encounter": "encounters", "phase": "phases", "near": "near", "abrupt": "abrupt",
    "track": "presence", "zone": "zones", "still": "still",
}  # fmt: skip
_CHAIN = 14


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
        joins: the events in it, and before it, after which a subject may be another, in words.
        corrected: what people corrected of the subjects, by whom and why, in words.
        clock: the clock's times of start and end, empty where the recording has no clock.
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
    joins: list[str] = field(default_factory=list)
    corrected: list[str] = field(default_factory=list)
    clock: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Plain data."""
        return asdict(self)

    def lines(self) -> list[str]:
        """For a person to read."""
        when = f"frame {self.start_frame}, {self.start_t:.2f} s"
        if self.end_frame != self.start_frame:
            when = (
                f"frames {self.start_frame} to {self.end_frame}, {self.start_t:.2f} to"
                f" {self.end_t:.2f} s ({self.end_t - self.start_t:.2f} s)"
            )
        out = [
            f"{self.reference}: {self.kind}",
            f"  {self.text}",
            f"  when:  {when}",
            *([f"  clock: {' to '.join(dict.fromkeys(self.clock))}"] if self.clock else []),
            f"  rule:  {self.rule}",
        ]
        if self.measures:
            out.append("  measured:")
            out += [f"    {measure_line(measure)}" for measure in self.measures]
        if self.chain:
            out.append("  what led there:")
            out += [f"    {line}" for line in self.chain]
        if self.joins:
            out.append("  rests on joins (explain -o DIR shows their two pictures):")
            out += [f"    {line}" for line in self.joins]
        if self.corrected:
            out.append("  corrected by hand:")
            out += [f"    {line}" for line in self.corrected]
        return out


def explain(
    case: Case, reference: str, recording: str | None = None, zone: str = "UTC"
) -> Explanation:
    """Explain what a reference names; the clock's times are told in a time zone.

    Raises:
        UsageError: it names nothing, or something in several recordings; says what there is.
    """
    found = _explain(case, reference, recording)
    start = starts(case).get(found.recording)
    if start is None:
        return found
    told = (start + round(t * NANOS) for t in (found.start_t, found.end_t))
    return replace(found, clock=tuple(clock_text(ns, zone) for ns in told))


def _explain(case: Case, reference: str, recording: str | None) -> Explanation:
    match = _REFERENCE.fullmatch(reference.strip())
    if match is None:
        raise UsageError(
            f"{reference!r}: give an event's number (12 or event:12) or an id of a column"
            " `explain`, like relation:1-2@40, encounter:1-2@65, group:3, track:7@31,"
            " zone:4@160:bench, line:4@160:gate, correction:2"
        )
    found = _explained(case, match, recording)
    return replace(found, joins=_joins(case, found), corrected=_corrected(case, found))


def _explained(case: Case, match: re.Match[str], recording: str | None) -> Explanation:
    only = "" if recording is None else f" AND recording = {literal(recording)}"
    if match["correction"] is not None:
        return _correction(case, int(match["correction"]), only)
    if match["event"] is not None:
        return _event(case, int(match["event"]), only)
    if match["group"] is not None:
        return _group(case, int(match["group"]), only)
    if match["single"] is not None:
        return _single(case, match["single"], int(match["one"]), int(match["at"]), only)
    if match["inside"] is not None or match["who"] is not None:
        return _placed(case, match, only)
    a, b = sorted((int(match["a"]), int(match["b"])))
    return _pair(case, match["pair"], (a, b), int(match["since"]), only)


def _placed(case: Case, match: re.Match[str], only: str) -> Explanation:
    """What is about a place: a stay in a zone, or a crossing of a line."""
    name = match["zone"] or match["line"]
    named = None if name is None else unquote(name)
    if match["inside"] is not None:
        return _inside(case, int(match["inside"]), int(match["then"]), named, only)
    return _crossed(case, int(match["who"]), int(match["when"]), named, only)


def _row(case: Case, query: str, reference: str) -> dict[str, Any]:
    return _rows(case, query, reference)[0]


def _rows(case: Case, query: str, reference: str) -> list[dict[str, Any]]:
    """The rows that a reference names, one at least, of one recording."""
    answer = case.sql(query)
    rows = list(answer.rows)
    if not rows:
        raise UsageError(f"{reference}: there is none")
    names = sorted({str(row[0]) for row in rows})
    if len(names) > 1:
        raise UsageError(
            f"{reference}: in several recordings ({', '.join(names[:5])}); give --recording"
        )
    return [dict(zip(answer.columns, row, strict=True)) for row in rows]


def _event(case: Case, number: int, only: str) -> Explanation:
    row = _row(
        case, f"SELECT * FROM events WHERE event = {number}{only}", f"event:{number}"
    )
    evidence = json.loads(row["evidence"] or "{}")
    evidence = evidence if isinstance(evidence, dict) else {"evidence": evidence}
    subjects = list(row["subjects"])
    return Explanation(
        f"event:{number}",
        recording=row["recording"],
        kind=row["kind"],
        text=row["text"],
        rule=row["rule"],
        subjects=subjects,
        start_frame=row["frame"],
        end_frame=row["frame"],
        start_t=row["t"],
        end_t=row["t"],
        measures=event_measures(evidence),
        chain=chain(case, row["recording"], subjects, row["t"], f"event:{number}"),
        evidence=evidence,
    )


def _correction(case: Case, number: int, only: str) -> Explanation:
    reference = f"correction:{number}"
    row = _row(
        case, f"SELECT * FROM corrections WHERE correction = {number}{only}", reference
    )
    name = literal(row["recording"])
    last, end = case.rows(
        f"SELECT max(frame), max(t) FROM frames WHERE recording = {name}"
    )[0]
    begins = row["frame"] is None
    return Explanation(
        reference,
        recording=row["recording"],
        kind=f"correction ({row['kind']})",
        text=f"{row['text'].capitalize()}.",
        rule=f"the word of {row['made_by']}: {row['why']}",
        subjects=list(row["tracks"]),
        start_frame=0 if begins else row["frame"],
        end_frame=last if begins else row["frame"],
        start_t=0.0 if begins else row["t"],
        end_t=end if begins else row["t"],
        measures=[],
        chain=[],
        evidence={"date": row["date"], "taken_back": row["undone"]},
    )


def _joins(case: Case, found: Explanation) -> list[str]:
    """The joins that the identities of an explanation's subjects rest on, in order."""
    joins = joins_of(case, found.recording, found.subjects, found.end_frame)
    return [
        f"{join.t:.2f} s: event:{join.event}: {join.text}"
        for join in joins
        if found.reference != f"event:{join.event}"
    ]


def _corrected(case: Case, found: Explanation) -> list[str]:
    """What people corrected of an explanation's subjects until it ends."""
    if not found.subjects:
        return []
    rows = case.rows(
        f"""SELECT correction, text, made_by, why, date, undone FROM corrections
        WHERE recording = {literal(found.recording)} AND list_has_any(tracks, {found.subjects})
          AND coalesce(frame, 0) <= {found.end_frame} ORDER BY correction"""
    )
    return [
        f"correction:{number}: {text}: {why} ({who}{f', {date}' if date else ''})"
        + (" (taken back)" if undone else "")
        for number, text, who, why, date, undone in rows
        if found.reference != f"correction:{number}"
    ]


def _group(case: Case, label: int, only: str) -> Explanation:
    row = _row(
        case,
        f"SELECT * FROM groups WHERE group_id = {label}{only} ORDER BY start_frame",
        f"group:{label}",
    )
    name, members = row["recording"], list(row["members"])
    events = case.rows(
        f"SELECT e.event, e.kind, e.t, e.text, e.rule FROM events e JOIN event_groups g USING (recording, event) "
        f"WHERE g.group_id = {label} AND e.recording = {literal(name)} ORDER BY e.event"
    )
    formed = (
        f", formed from group {_listed(row['formed_from'])}" if row["formed_from"] else ""
    )
    ended = f"; {row['ended_by']} ended it" if row["ended_by"] else "; it lasted to the end"
    rule = next(
        (
            event[4]
            for event in events
            if event[1] in ("group_formed", "group_changed", "group_entered_scene")
        ),
        "",
    )
    chained = [f"{t:.2f} s: event:{n} {kind}: {text}" for n, kind, t, text, _ in events]
    return Explanation(
        f"group:{label}",
        recording=name,
        kind="group",
        text=f"Group {label} of {_listed(members)}{formed}{ended}.",
        rule=rule or "EVENTS 3.1: a group is a JOINT component",
        subjects=members,
        start_frame=row["start_frame"],
        end_frame=row["end_frame"],
        start_t=row["start_t"],
        end_t=row["end_t"],
        measures=[],
        chain=chained or chain(case, name, members, row["start_t"], f"group:{label}"),
        evidence={},
    )


_SINGLE = {
    "track": ("was present", "EVENTS 2, 3.1: the target's own state"),
    "still": (
        "stood still",
        "ours: slower than a small part of its own size per second, for a second and more",
    ),
}


def _single(case: Case, kind: str, track: int, at: int, only: str) -> Explanation:
    row = _row(case, _during(kind, track, at, only), f"{kind}:{track}@{at}")
    text, rule = _SINGLE[kind]
    # What a target does in a frame is asked of that frame: `track:7@31` keeps it.
    reference = f"{kind}:{track}@{at if kind == 'track' else row['start_frame']}"
    found = thresholds.still_measures(row) if kind == "still" else _bits(case, row, at)
    return _of_one(case, row, (reference, kind), f"Target {track} {text}.", rule, found)


def _inside(case: Case, track: int, at: int, zone: str | None, only: str) -> Explanation:
    if zone is not None:
        only += f" AND zone = {literal(zone)}"
    asked = f"zone:{track}@{at}" if zone is None else zone_reference(track, at, zone)
    rows = _rows(case, _during("zone", track, at, only), asked)
    zones = sorted({row["zone"] for row in rows})
    if len(zones) > 1:
        ways = ", ".join(zone_reference(track, at, name) for name in zones[:5])
        raise UsageError(
            f"{asked}: target {track} is in {len(zones)} zones then; give one of them:"
            f" {ways}"
        )
    row = rows[0]
    reference = zone_reference(track, row["start_frame"], row["zone"])
    text, rule = (
        f"Target {track} was in the zone {row['zone']!r}.",
        "EVENTS 3.2: a target's centroid in the zone",
    )
    return _of_one(case, row, (reference, "zone"), text, rule, _bits(case, row, at))


def _during(kind: str, track: int, at: int, only: str) -> str:
    """A target's rows that a frame lies in, the latest first."""
    return (
        f"SELECT * FROM {_TABLE[kind]} WHERE track = {track} AND {at} BETWEEN start_frame AND end_frame{only} "
        "ORDER BY start_frame DESC"
    )


def _bits(case: Case, row: Mapping[str, Any], at: int) -> list[Measure]:
    """Whom a target was grouping with, grouped with and splitting from in a frame."""
    rows = case.rows(
        f"SELECT bit, partners, start_frame, end_frame FROM bits WHERE track = {row['track']} AND "
        f"{at} BETWEEN start_frame AND end_frame AND recording ="
        f" {literal(row['recording'])} ORDER BY bit"
    )
    return [
        Measure(f"{bit} in frame {at}", f"with {_listed(p)}, frames {s} to {e}")
        for bit, p, s, e in rows
    ]


def _crossed(case: Case, track: int, at: int, line: str | None, only: str) -> Explanation:
    """A crossing of a drawn line."""
    asked = f"line:{track}@{at}" + ("" if line is None else f":{zone_word(line)}")
    if line is not None:
        only += f" AND line = {literal(line)}"
    rows = _rows(
        case,
        f"SELECT *, frame AS start_frame, frame AS end_frame, t AS start_t, t AS end_t"
        f" FROM crossings WHERE track = {track} AND frame = {at}{only} ORDER BY line",
        asked,
    )
    lines = sorted({row["line"] for row in rows})
    if len(lines) > 1:
        raise UsageError(
            f"{asked}: crossed {', '.join(lines)}; name one, as {asked}:{lines[0]}"
        )
    row = rows[0]
    found = [
        Measure("x_px", row["x"]),
        Measure("y_px", row["y"]),
        Measure("direction", row["direction"]),
    ]
    text = f"Target {track} crossed line {row['line']} to the {row['direction']}."
    text = text.replace("to the up.", "upwards.").replace("to the down.", "downwards.")
    rule = f"ours: feet that were {EDGE_SIZES:g} of the body's size on one side, then on the other"
    reference = f"line:{track}@{at}:{zone_word(row['line'])}"
    return _of_one(case, row, (reference, f"crossed {row['line']}"), text, rule, found)


def _of_one(
    case: Case,
    row: Mapping[str, Any],
    named: tuple[str, str],
    text: str,
    rule: str,
    found: list[Measure],
) -> Explanation:
    reference, kind = named
    return Explanation(
        reference,
        recording=row["recording"],
        kind=kind,
        text=text,
        rule=rule,
        subjects=[row["track"]],
        start_frame=row["start_frame"],
        end_frame=row["end_frame"],
        start_t=row["start_t"],
        end_t=row["end_t"],
        measures=found,
        chain=chain(case, row["recording"], [row["track"]], row["start_t"], reference),
        evidence={},
    )


def _pair(
    case: Case, kind: str, ids: tuple[int, int], since: int, only: str
) -> Explanation:
    a, b = ids
    row = _row(
        case,
        f"SELECT * FROM {_TABLE[kind]} WHERE a = {a} AND b = {b} "
        f"AND {since} BETWEEN start_frame AND end_frame{only} ORDER BY start_frame DESC",
        f"{kind}:{a}-{b}@{since}",
    )
    reference = f"{kind}:{a}-{b}@{row['start_frame']}"
    what, text, rule, found = _told_of_pair(case, kind, row)
    return Explanation(
        reference,
        recording=row["recording"],
        kind=what,
        text=f"Targets {a} and {b} {text}.",
        rule=rule,
        subjects=[a, b],
        start_frame=row["start_frame"],
        end_frame=row["end_frame"],
        start_t=row["start_t"],
        end_t=row["end_t"],
        measures=found,
        chain=chain(case, row["recording"], [a, b], row["start_t"], reference),
        evidence={},
    )


def _told_of_pair(
    case: Case, kind: str, row: Mapping[str, Any]
) -> tuple[str, str, str, list[Measure]]:
    """Kind, what the two did, rule and measures of a row about a pair."""
    if kind == "relation":
        rule = "SHELLS 2.3: shells that meet are INTERACTION, with one blob JOINT"
        return (
            row["state"],
            f"were in the relation {row['state']}",
            rule,
            thresholds.began_with(case, row),
        )
    if kind == "near":
        rule = "ours: standing points, within touching distance"
        return (
            kind,
            "stood within touching distance",
            rule,
            thresholds.near_measures(case, row),
        )
    if kind == "abrupt":
        text = "were abrupt against one another at touching distance"
        return kind, text, thresholds.ABRUPT_RULE, thresholds.abrupt_measures(case, row)
    if kind == "phase":
        text = f"were socially together; this part of it: {row['kind']}"
        rule = thresholds.phase_rule(case, row)
        return f"phase ({row['kind']})", text, rule, thresholds.phase_measures(case, row)
    text = f"were socially together, for the most part: {row['kind']}"
    rule = (
        "ours: encounters in hindsight (near, slow against one another, not passing, long"
        " enough)"
    )
    return (
        f"encounter ({row['kind']})",
        text,
        rule,
        thresholds.encounter_measures(case, row),
    )


def chain(
    case: Case, recording: str, subjects: Sequence[int], until_t: float, reference: str
) -> list[str]:
    """The states and events of the subjects that began before a moment, oldest first, the last
    few of them.
    """
    if not subjects:
        return []
    ids = ", ".join(str(subject) for subject in sorted(subjects))
    within = f"[{ids}]"
    both = (
        f"a IN ({ids}) AND b IN ({ids})"
        if len(subjects) > 1
        else f"(a IN ({ids}) OR b IN ({ids}))"
    )
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
        WHERE ref <> {literal(reference)} ORDER BY t DESC, end_t DESC, ref DESC LIMIT {_CHAIN}"""
    )
    return [
        (
            f"{t:.2f} s: {what} ({ref})"
            if t == end
            else f"{t:.2f} to {end:.2f} s: {what} ({ref})"
        )
        for t, end, what, ref in reversed(rows)
    ]


def _listed(ids: Sequence[int]) -> str:
    words = [str(identity) for identity in ids]
    return (
        words[0]
        if len(words) == 1
        else f"{', '.join(words[:-1])} and {words[-1]}"
        if words
        else "nobody"
    )
