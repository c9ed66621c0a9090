"""An annotated log as rows of the tables, reading its small channels alone: no picture is touched.

The log is streamed; rows of tracks are handed on in batches. What stays in memory is one open
interval per running relation, group, zone and track, and the boxes of the tracks (some hundred
bytes per track and frame) for the encounters.
"""

from __future__ import annotations

import hashlib
from bisect import bisect_left, bisect_right
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import asdict, astuple, dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

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
from reasoning.encounters.nearness import nearest
from reasoning.geometry import Area
from reasoning.questions.looks import Looks, look, sightings, usual_height
from reasoning.questions.runs import (
    Belief,
    HeldInterval,
    Interval,
    Runs,
    SeenTarget,
    Sight,
    sight,
)
from reasoning.questions.schema import TABLES
from reasoning.questions.standing import Steps, stays
from recorders import channels
from recorders.annotated.frames import annotated_cameras
from recorders.annotated.provenance import CORRECTIONS
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.corrections import parse_corrections
from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.messages import Box, Event, Regions, Track
from recorders.quality import QualityMeasure, recorded_quality

Row = tuple[Any, ...]
Sink = Callable[[str, Sequence[Row]], None]
BATCH_ROWS = 50_000
BITS = ("grouping", "grouped", "splitting")
ENDING = ("group_changed", "group_ended")
JOINS = ("identity", "track_recovered")
"""Kinds of events after which a track may be somebody else."""
_READ = ("tracks", "relations", "groups", "held_back", "events", "regions")
_INT32 = 2**31 - 1


@dataclass
class RecordingFacts:
    """What is known of one camera of an annotated log."""

    recording: str
    digest: str
    path: str
    camera: str
    tracker: str = ""
    width: int = 0
    height: int = 0
    frames: int = 0
    start_ns: int = 0
    seconds: float = 0.0
    output_digest: str = ""
    first_frame: int = 0

    def row(self) -> Row:
        """The row of ``recordings``."""
        return tuple(getattr(self, column) for column, _ in TABLES["recordings"])


def file_digest(path: str | Path) -> str:
    """SHA-256 of the file: what makes a recording the same recording.

    Raises:
        RecordingError: it cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", path) from error


def read_recordings(
    path: str | Path,
    sink: Sink,
    *,
    name: str | None = None,
    digest: str = "",
    limits: Limits = DEFAULT_LIMITS,
    encounters: EncounterParameters | None = None,
    looks: bool = False,
) -> list[RecordingFacts]:
    """Send every table's rows of a log to ``sink``; one recording per camera that has tracks.

    Args:
        path: an annotated log.
        sink: takes a table's name and rows in the order of its columns.
        name: the recording's name, by default the file's stem; with several cameras ``/camera``
            is appended.
        digest: the file's digest, written into ``recordings``.
        limits: bounds on what the log may make us allocate.
        encounters: thresholds for the encounters.
        looks: look at some pictures of each target for its colours, where there are pictures.

    Raises:
        RecordingError: no annotated log, or a damaged one.
    """
    base = name or Path(path).stem
    with LogReader(path, limits) as log:
        cameras: list[str | None] = [*annotated_cameras(log)]
        quality = recorded_quality(log.metadata(), path)
    found = []
    # Without a camera the reader says itself that there is none.
    for camera in cameras or [None]:
        with AnnotatedLog(path, camera, limits) as annotated:
            facts = RecordingFacts(
                base if len(cameras) == 1 else f"{base}/{camera}",
                digest,
                str(path),
                annotated.camera,
            )
            parameters = encounters or EncounterParameters()
            _Camera(annotated, facts, sink, parameters, looks=looks).read(
                quality.get(annotated.camera, ())
            )
            found.append(facts)
    return found


@dataclass
class _Boxes:
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


_TELLS_S, _FIRST_S = 1.0, 2.0


class _Camera:
    """Reads one camera of one log."""

    def __init__(
        self,
        log: AnnotatedLog,
        facts: RecordingFacts,
        sink: Sink,
        encounters: EncounterParameters,
        *,
        looks: bool,
    ) -> None:
        self._looking = looks and log.has_pictures
        self._log = log
        self._facts = facts
        self._sink = sink
        self._parameters = encounters
        self._rows: dict[str, list[Row]] = {table: [] for table in TABLES}
        self._relations, self._groups, self._presence = Runs(), Runs(), Runs()
        self._zones, self._bits, self._hidden = Runs(), Runs(), Runs()
        self._formed: dict[int, tuple[int, ...]] = {}
        self._ended: dict[int, list[tuple[int, str]]] = {}
        self._group_rows: list[HeldInterval] = []
        self._related: list[Row] = []
        self._held_bits: list[Row] = []
        self._joint: dict[tuple[int, int], list[tuple[int, int]]] = {}
        self._boxes: dict[int, _Boxes] = {}
        self._targets: dict[int, SeenTarget] = {}
        self._labels: dict[int, str] = {}
        self._regions: list[tuple[int, Regions]] = []
        self._t, self._frame = 0.0, -1

    def read(self, quality: Sequence[QualityMeasure]) -> None:
        facts = self._facts
        facts.tracker = self._log.tracker
        facts.output_digest = self._log.facts.get("output_digest", "")
        facts.start_ns = self._log.start_ns
        facts.width, facts.height = self._log.size() or (0, 0)
        for frame in self._log.frames(_READ):
            self._take(frame)
        self._finish()
        for measure in quality:
            self._add("quality", (measure.name, measure.value, measure.verdict))
        self._add_corrections()
        for table in self._rows:
            self._send(table)
        self._sink("recordings", [facts.row()])

    def _add_corrections(self) -> None:
        text = self._log.facts.get(CORRECTIONS)
        if text is None:
            return
        found = parse_corrections(text, self._facts.path)
        for row in found.rows:
            self._add(
                "corrections",
                (
                    row.correction,
                    row.do,
                    list(row.tracks),
                    row.frame,
                    row.t,
                    row.told(),
                    row.by,
                    row.why,
                    row.date or None,
                    row.other or None,
                    row.correction in found.undone,
                ),
            )

    def _take(self, frame: AnnotatedFrame) -> None:
        t = (frame.time_ns - self._facts.start_ns) / channels.NANOS
        if frame.index <= self._frame or frame.index > _INT32:
            raise RecordingError(
                f"frame {frame.index} after frame {self._frame}; frames must rise",
                self._facts.path,
                record="tracks",
            )
        if self._frame < 0:
            self._facts.first_frame = frame.index
        self._frame, self._t = frame.index, t
        self._facts.frames += 1
        self._add("frames", (frame.index, t))
        self._targets = _targets(frame.tracks, frame.events)
        if frame.regions is not None and (
            not self._regions or frame.regions != self._regions[-1][1]
        ):
            self._regions.append((frame.index, frame.regions))
        self._take_tracks(frame, t)
        self._take_relations(frame, t)
        self._take_groups(frame, t)
        for withheld in frame.held_back:
            self._add("held_back", (t, *withheld.box, withheld.reason))
        for event in frame.events:
            self._take_event(event)

    def _add(self, table: str, values: tuple[Any, ...]) -> None:
        rows = self._rows[table]
        rows.append((self._facts.recording, *values))
        if len(rows) >= BATCH_ROWS:
            self._send(table)

    def _send(self, table: str) -> None:
        rows = self._rows[table]
        if table == "relations":
            # A pair's rows stand together, in the order of time: who asks about a target reads
            # few places.
            rows.sort(key=itemgetter(1, 2, 4))
        if rows:
            self._sink(table, rows)
        self._rows[table] = []

    def _take_tracks(self, frame: AnnotatedFrame, t: float) -> None:
        present: dict[Hashable, Hashable] = {}
        zones: dict[Hashable, Hashable] = {}
        bits: dict[Hashable, Hashable] = {}
        hidden: dict[Hashable, Hashable] = {}
        alone: dict[int, Sight] = {}
        for track in frame.tracks:
            told = self._sight((track.id,)) if track.present else Sight(False, 0.0, 0.0)
            self._add(
                "tracks",
                (
                    frame.index,
                    t,
                    track.id,
                    *track.box,
                    *track.velocity,
                    track.mode,
                    track.confidence,
                    track.grouping,
                    track.grouped,
                    track.splitting,
                    track.group,
                    track.scene,
                    None if track.label is UNSET else track.label,
                    track.present,
                    bool(told.seen),
                    track.identity,
                ),
            )
            if track.label is not UNSET:
                self._labels[track.id] = track.label
            if not track.present:
                continue
            present[track.id] = True
            if not self._regions:
                zones.update({(track.id, zone): True for zone in track.zones})
            hidden.update({(track.id, part): True for part in track.hidden_parts})
            for bit in BITS:
                if getattr(track, bit):
                    bits[(track.id, bit)] = tuple(sorted(getattr(track, f"{bit}_partners")))
            alone[track.id] = told
            self._boxes.setdefault(track.id, _Boxes()).add(
                self._facts.frames, frame.index, t, self._targets[track.id], told
            )

        def of_one(key: Any, _: Hashable) -> Sight:
            return alone[key[0] if isinstance(key, tuple) else key]

        def with_partners(key: Any, partners: Any) -> Sight:
            return self._sight((key[0], *partners))

        now = frame.index
        self._end_presence(self._presence.step(now, t, present, of_one))
        self._end_named("zones", self._zones.step(now, t, zones, of_one))
        self._end_bits(self._bits.step(now, t, bits, with_partners))
        self._end_named("hidden", self._hidden.step(now, t, hidden, of_one))

    def _sight(self, ids: Sequence[int]) -> Sight:
        return sight(self._targets, ids)

    def _end_presence(self, over: Sequence[HeldInterval]) -> None:
        for run in over:
            self._add("presence", (run.key, *run.interval, *run.belief))

    def _end_named(self, table: str, over: Sequence[HeldInterval]) -> None:
        """Intervals of a track and a name: a zone that it was in, a part of it that was hidden."""
        for key, _, interval, belief in over:
            track, name = _pair(key)
            self._add(table, (track, name, *interval, *belief))

    def _end_bits(self, over: Sequence[HeldInterval]) -> None:
        for key, partners, interval, belief in over:
            track, bit = _pair(key)
            self._held_bits.append((track, bit, list(_ids(partners)), *interval, *belief))

    def _take_relations(self, frame: AnnotatedFrame, t: float) -> None:
        # A run is one interval of a state: the same state with a later `since` is a new interval.
        now: dict[Hashable, Hashable] = {
            (relation.a, relation.b): (relation.state, relation.since_frame)
            for relation in frame.relations
        }
        self._end_relations(
            self._relations.step(frame.index, t, now, lambda k, _: self._sight(_ids(k)))
        )

    def _end_relations(self, over: Sequence[HeldInterval]) -> None:
        for key, value, interval, belief in over:
            (a, b), (state, _) = _pair(key), _pair(value)
            self._related.append((a, b, state, *interval, *belief))
            if state == "JOINT":
                self._joint.setdefault((a, b), []).append(interval[:2])

    def _take_groups(self, frame: AnnotatedFrame, t: float) -> None:
        now: dict[Hashable, Hashable] = {
            group.label: tuple(sorted(group.members)) for group in frame.groups
        }
        for group in frame.groups:
            self._formed.setdefault(group.label, tuple(group.formed_from))
        self._group_rows += self._groups.step(
            frame.index, t, now, lambda _, members: self._sight(_ids(members))
        )

    def _take_event(self, event: Event) -> None:
        t = (event.time_ns - self._facts.start_ns) / channels.NANOS
        evidence = msgspec.json.encode(event.evidence).decode()
        told = self._sight(event.subjects)
        belief = (
            (float(told.seen), told.existence, told.identity)
            if event.subjects
            else (None, None, None)
        )
        self._add(
            "events",
            (
                event.id,
                event.kind,
                event.frame,
                t,
                list(event.subjects),
                event.rule,
                evidence,
                event.text,
                *belief,
                list(told.joins),
            ),
        )
        if event.kind == "scene_changed" and event.evidence.get("kind") == "gap":
            length = float(event.evidence.get("gap_s", 0))
            verdict = f"before frame {event.frame}: nothing was recorded then"
            self._add("quality", ("gap_s", length, verdict))
        for label in event.groups:
            self._add("event_groups", (event.id, label))
            if event.kind in ENDING:
                self._ended.setdefault(label, []).append((event.frame, event.kind))

    def _finish(self) -> None:
        self._facts.seconds = self._t
        self._end_presence(self._presence.close())
        self._end_named("zones", self._zones.close())
        self._find_stays()
        self._end_bits(self._bits.close())
        self._end_named("hidden", self._hidden.close())
        self._end_relations(self._relations.close())
        self._group_rows += self._groups.close()
        for key, members, interval, belief in sorted(
            self._group_rows, key=lambda row: (row.interval[0], str(row.key).zfill(10))
        ):
            label = int(str(key))
            formed = list(self._formed[label])
            self._add(
                "groups",
                (
                    label,
                    list(_ids(members)),
                    *interval,
                    formed,
                    self._end(label, interval),
                    *belief,
                ),
            )
        self._find_encounters()

    def _end(self, label: int, interval: Interval) -> str | None:
        """The kind of the first event after the group's last frame that names it; None if it
        lived to the end.
        """
        after = [kind for frame, kind in self._ended.get(label, ()) if frame >= interval[1]]
        return after[0] if after and interval[1] < self._frame else None

    def _find_stays(self) -> None:
        """Stays in the zones that were recorded, in hindsight, as in those that are drawn later.

        A log without its regions (annotations alone) has what its tracks say of zones instead.
        """
        down = 0.5 if self._log.zone_point == "centre" else 1.0
        ends = [first for first, _ in self._regions[1:]] + [_INT32]
        for (first, regions), end in zip(self._regions, ends, strict=False):
            areas = [(zone.name, Area([zone.polygon])) for zone in regions.zones]
            for track in sorted(self._boxes) if areas else ():
                steps = self._boxes[track].steps().within(first, end)
                for name, area in areas:
                    for interval, belief in stays(area, steps, down):
                        self._add("zones", (track, name, *interval, *belief))

    def _find_encounters(self) -> None:
        for name, value in asdict(self._parameters).items():
            self._add("encounter_parameters", (name, value))
        histories = {track: self._boxes[track].history() for track in sorted(self._boxes)}
        width = float(self._facts.width) or None
        ground = ground_of(histories, width)
        self._add_relations(histories, ground)
        for encounter in find_encounters(
            histories, self._parameters, joint=self._joint, ground=ground
        ):
            self._add_encounter(encounter)
        self._add_targets()
        for track, history in histories.items():
            for stretch in still(history, self._parameters):
                self._add("still", (track, *astuple(stretch)))
        for a, b, stretch in near(histories, self._parameters):
            self._add("near", (a, b, *astuple(stretch)))

    def _add_relations(self, histories: Mapping[int, History], ground: GroundSlope) -> None:
        """The ground is known once all boxes are, and with it how near people came on it."""

        def away(a: int, b: int, first: int, last: int) -> float | None:
            if a not in histories or b not in histories:
                return None
            return nearest(histories[a], histories[b], first, last, ground)

        for row in self._related:
            a, b, _, first, last, *_ = row
            self._add("relations", (*row, away(a, b, first, last)))
        for row in self._held_bits:
            track, _, partners, first, last, *_ = row
            found = [away(track, partner, first, last) for partner in partners]
            known = [distance for distance in found if distance is not None]
            self._add("bits", (*row, max(known, default=None)))
        self._related, self._held_bits = [], []

    def _add_targets(self) -> None:
        looks = self._look() if self._looking else {}
        size = self._facts.width, self._facts.height
        for track in sorted(self._boxes):
            own = self._boxes[track]
            existence, identity, _ = own.between(own.frames[0], own.frames[-1])
            share = round(sum(own.seen) / len(own.seen), 4)
            history, seen = own.history(), looks.get(track)
            self._add(
                "targets",
                (
                    track,
                    self._labels.get(track),
                    own.times[0],
                    own.times[-1],
                    share,
                    round(identity, 4),
                    seen and seen.upper_colour,
                    seen and seen.lower_colour,
                    usual_height(history.boxes, np.array(own.seen, np.bool_), size),
                    round(existence, 4),
                    *_feet(own.boxes[-1]),
                    _first_way(history),
                ),
            )
            if seen is not None:
                self._add(
                    "looks",
                    (track, seen.samples, seen.upper, seen.lower, seen.frame, *seen.box),
                )

    def _look(self) -> dict[int, Looks]:
        """What each target looks like, from a few pictures."""
        others: dict[int, list[tuple[int, Box]]] = {}
        for track in sorted(self._boxes):
            own = self._boxes[track]
            for frame, box in zip(own.frames, own.boxes, strict=True):
                others.setdefault(frame, []).append((track, box))
        wanted = {}
        for track in sorted(self._boxes):
            own = self._boxes[track]
            times = [self._facts.start_ns + round(t * channels.NANOS) for t in own.times]
            history = own.history()
            wanted[track] = sightings(
                np.array(own.frames, np.int64),
                times,
                history.boxes,
                np.array(own.seen, np.bool_),
                others,
                track,
            )
        return look(self._log.path, self._log.camera, self._log.limits, wanted)

    def _add_encounter(self, encounter: Encounter) -> None:
        """The time together is the encounter's row; approach and parting are phases of it."""
        seen_share, existence, identity, joins = self._belief_of_pair(encounter)
        self._add(
            "encounters",
            (
                encounter.a,
                encounter.b,
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
            self._add(
                "phases", (encounter.a, encounter.b, *astuple(phase), PHASES[phase.kind])
            )
        for fierce in encounter.abrupt:
            self._add("abrupt", (encounter.a, encounter.b, *astuple(fierce)))
        self._add(
            "encounter_evidence",
            (
                encounter.a,
                encounter.b,
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

    def _belief_of_pair(self, encounter: Encounter) -> Belief:
        of_a, of_b = (
            self._boxes[i].between(encounter.together_frame, encounter.apart_frame)
            for i in (encounter.a, encounter.b)
        )
        existence, identity = min(of_a[0], of_b[0]), min(of_a[1], of_b[1])
        joins = sorted({*of_a[2], *of_b[2]})
        return encounter.seen_share, round(existence, 4), round(identity, 4), joins


def _targets(tracks: Sequence[Track], events: Sequence[Event]) -> dict[int, SeenTarget]:
    """A frame's targets as they were seen, with the joins that were told in it."""
    joins: dict[int, tuple[int, ...]] = {}
    for event in events:
        if event.kind in JOINS:
            for subject in event.subjects:
                joins[subject] = (*joins.get(subject, ()), event.id)
    return {track.id: _seen(track, joins.get(track.id, ())) for track in tracks}


def _seen(track: Track, joins: tuple[int, ...]) -> SeenTarget:
    observed = track.observed and track.present
    return SeenTarget(track.box, observed, track.confidence, track.identity, joins)


def _pair(value: Hashable) -> tuple[Any, Any]:
    assert isinstance(value, tuple)
    return value[0], value[1]


def _ids(value: Hashable) -> tuple[int, ...]:
    assert isinstance(value, tuple)
    return value


def _feet(box: Box) -> tuple[float, float]:
    """Where somebody stands: the middle of the box's lower side, pixels."""
    x, y, w, h = box
    return round(x + w / 2, 2), round(y + h, 2)


def _first_way(history: History) -> float | None:
    """How far a target's centre was from its first place at most, in its first two seconds and in
    its own sizes; None where it was not there for a second.
    """
    since = history.times_s - history.times_s[0]
    if since[-1] < _TELLS_S:
        return None
    x, y, w, h = history.boxes[since <= _FIRST_S].T
    away = np.hypot(x + w / 2 - x[0] - w[0] / 2, y + h / 2 - y[0] - h[0] / 2)
    return round(float((away / np.sqrt(np.maximum(w * h, 1.0))).max()), 2)
