"""Rows that are known once a recording was read to its end: how near people came on its ground,
who met whom, what each target was and looked like.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence, Set
from dataclasses import asdict, astuple, dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from reasoning.encounters import (
    PHASES,
    Encounter,
    EncounterParameters,
    History,
    find_encounters,
    near,
    still,
)
from reasoning.encounters.ground import GroundSlope, ground_of
from reasoning.encounters.nearness import drawing_away, ever_apart, nearest
from reasoning.questions.recording_facts import RecordingFacts, Row
from reasoning.questions.runs import Belief
from reasoning.questions.track_boxes import TrackBoxes, feet, first_way, usual_height
from recorders import channels
from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Box

if TYPE_CHECKING:  # looking at pictures brings OpenCV
    from reasoning.questions.looks import Looks

TableRow = tuple[str, Row]
"""A table's name, and a row of it without the recording."""
ENCOUNTERS = frozenset({"encounters", "phases", "abrupt", "encounter_evidence"})
"""Tables that finding encounters fills."""
BOXES = frozenset(
    {*ENCOUNTERS, "relations", "bits", "zones", "targets", "looks", "still", "near"}
)
"""Tables that are made from where everybody was in all frames."""
MOMENT_S = 1.0
"""Who joins was on his way a second before, who leaves is a second later."""


@dataclass
class Lives:
    """What was read of one camera: where its tracks were, and the intervals between them.

    Attributes:
        boxes: by track.
        labels: names that corrections gave, by track.
        related, held_bits: rows of ``relations`` and ``bits`` without how near the two came.
        joint: first and last frame of each JOINT interval, by pair.
    """

    boxes: dict[int, TrackBoxes] = field(default_factory=dict)
    labels: dict[int, str] = field(default_factory=dict)
    related: list[Row] = field(default_factory=list)
    held_bits: list[Row] = field(default_factory=list)
    joint: dict[tuple[int, int], list[tuple[int, int]]] = field(default_factory=dict)


def rows_of(
    lives: Lives,
    facts: RecordingFacts,
    parameters: EncounterParameters,
    pictures: AnnotatedLog | None,
    tables: Set[str],
) -> Iterator[TableRow]:
    """Every row of the wanted tables (others may come, too), table after table; targets have
    colours where there are ``pictures``.
    """
    for name, value in asdict(parameters).items():
        yield "encounter_parameters", (name, value)
    if not tables & BOXES:
        return
    histories = {track: lives.boxes[track].history() for track in sorted(lives.boxes)}
    if tables & {"relations", "bits", *ENCOUNTERS}:
        ground = ground_of(histories, float(facts.width) or None)
        yield from _related(lives, histories, ground, tables)
        if tables & ENCOUNTERS:
            for encounter in find_encounters(
                histories, parameters, joint=lives.joint, ground=ground
            ):
                yield from _encounter(lives, encounter)
    if tables & {"targets", "looks"}:
        yield from _targets(lives, facts, pictures)
    if "still" in tables:
        for track, history in histories.items():
            for stretch in still(history, parameters):
                yield "still", (track, *astuple(stretch))
    if "near" in tables:
        for a, b, stretch in near(histories, parameters):
            yield "near", (a, b, *astuple(stretch))


def _related(
    lives: Lives, histories: Mapping[int, History], ground: GroundSlope, tables: Set[str]
) -> Iterator[TableRow]:
    """The ground is known once all boxes are, and with it how near people came on it. Of two who
    never were apart, and so may be one, no distance is told.
    """
    two: dict[tuple[int, int], bool] = {}

    def away(a: int, b: int, first: int, last: int) -> float | None:
        if a not in histories or b not in histories:
            return None
        pair = min(a, b), max(a, b)
        if pair not in two:
            two[pair] = ever_apart(histories[a], histories[b])
        if not two[pair]:
            return None
        return nearest(histories[a], histories[b], first, last, ground)

    for row in lives.related if "relations" in tables else ():
        a, b, _, first, last, *_ = row
        yield "relations", (*row, away(a, b, first, last))
    for row in lives.held_bits:
        track, bit, partners, first, last, start_t, end_t, *_ = row
        found = [away(track, partner, first, last) for partner in partners]
        known = [distance for distance in found if distance is not None]
        far = max(known) if known and len(known) == len(found) else None
        yield (
            "bits",
            (*row, far, _drift(histories, ground, track, bit, partners, (start_t, end_t))),
        )


def _drift(
    histories: Mapping[int, History],
    ground: GroundSlope,
    track: int,
    bit: str,
    partners: Sequence[int],
    span: tuple[float, float],
) -> float | None:
    """How fast a target that is grouping closes in on its partners, from a second before on, or one
    that is splitting draws away, to a second after: of the partner of whom that is least so.
    """
    if bit == "grouped" or track not in histories:
        return None
    since, until = (
        (span[0] - MOMENT_S, span[1])
        if bit == "grouping"
        else (span[0], span[1] + MOMENT_S)
    )
    drifts = [
        drawing_away(histories[track], histories[partner], since, until, ground)
        if partner in histories
        else None
        for partner in partners
    ]
    told = [drift for drift in drifts if drift is not None]
    if not told or len(told) < len(drifts):
        return None
    return max(told) if bit == "grouping" else min(told)


def _targets(
    lives: Lives, facts: RecordingFacts, pictures: AnnotatedLog | None
) -> Iterator[TableRow]:
    looks = {} if pictures is None else _looks(lives.boxes, facts, pictures)
    size = facts.width, facts.height
    for track in sorted(lives.boxes):
        own = lives.boxes[track]
        existence, identity, _ = own.between(own.frames[0], own.frames[-1])
        share = round(sum(own.seen) / len(own.seen), 4)
        history, seen = own.history(), looks.get(track)
        yield (
            "targets",
            (
                track,
                lives.labels.get(track),
                own.times[0],
                own.times[-1],
                share,
                round(identity, 4),
                seen and seen.upper_colour,
                seen and seen.lower_colour,
                usual_height(history.boxes, np.array(own.seen, np.bool_), size),
                round(existence, 4),
                *feet(own.boxes[-1]),
                first_way(history),
            ),
        )
        if seen is not None:
            yield (
                "looks",
                (track, seen.samples, seen.upper, seen.lower, seen.frame, *seen.box),
            )


def _looks(
    boxes: Mapping[int, TrackBoxes], facts: RecordingFacts, pictures: AnnotatedLog
) -> dict[int, Looks]:
    """What each target looks like, from a few pictures."""
    from reasoning.questions.looks import look, sightings

    others: dict[int, list[tuple[int, Box]]] = {}
    for track in sorted(boxes):
        own = boxes[track]
        for frame, box in zip(own.frames, own.boxes, strict=True):
            others.setdefault(frame, []).append((track, box))
    wanted = {}
    for track in sorted(boxes):
        own = boxes[track]
        times = [facts.start_ns + round(t * channels.NANOS) for t in own.times]
        history = own.history()
        wanted[track] = sightings(
            np.array(own.frames, np.int64),
            times,
            history.boxes,
            np.array(own.seen, np.bool_),
            others,
            track,
        )
    return look(pictures.path, pictures.camera, pictures.limits, wanted)


def _encounter(lives: Lives, encounter: Encounter) -> Iterator[TableRow]:
    """The time together is the encounter's row; approach and parting are phases of it."""
    pair = encounter.a, encounter.b
    seen_share, existence, identity, joins = _belief(
        encounter, [lives.boxes[track] for track in pair]
    )
    yield (
        "encounters",
        (
            *pair,
            encounter.kind,
            encounter.together_frame,
            encounter.apart_frame,
            encounter.together_s,
            encounter.apart_s,
            encounter.confidence,
            seen_share,
            identity,
            existence,
            joins,
        ),
    )
    for phase in encounter.phases:
        yield "phases", (*pair, *astuple(phase), PHASES[phase.kind])
    for fierce in encounter.abrupt:
        yield "abrupt", (*pair, *astuple(fierce))
    yield (
        "encounter_evidence",
        (
            *pair,
            encounter.together_frame,
            encounter.near_s,
            encounter.distance,
            encounter.relative_speed,
            encounter.sure_frame,
            encounter.drift,
            encounter.all_distance,
            encounter.all_relative_speed,
        ),
    )


def _belief(encounter: Encounter, pair: Sequence[TrackBoxes]) -> Belief:
    of_a, of_b = (
        own.between(encounter.together_frame, encounter.apart_frame) for own in pair
    )
    existence, identity = min(of_a[0], of_b[0]), min(of_a[1], of_b[1])
    joins = sorted({*of_a[2], *of_b[2]})
    return encounter.seen_share, round(existence, 4), round(identity, 4), joins
