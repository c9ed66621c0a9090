"""An annotated log as rows of the tables, reading its small channels alone: no picture is touched.

The log is streamed; rows of tracks are handed on in batches. What stays in memory is one open
interval per running relation, group, zone and track, and the boxes of the tracks (some hundred
bytes per track and frame) for the encounters.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Sequence
from operator import itemgetter
from pathlib import Path
from typing import Any

from msgspec import UNSET

from reasoning.encounters import (
    EncounterParameters,
)
from reasoning.questions.frame_rows import check_ids, correction_rows, event_row, track_row
from reasoning.questions.needed import EVERYTHING
from reasoning.questions.recording_facts import RecordingFacts, Row, Sink
from reasoning.questions.runs import (
    UNTOLD,
    HeldInterval,
    Interval,
    Runs,
    SeenTarget,
    Sight,
    ids_of,
    pair_of,
    seen_targets,
    sight,
)
from reasoning.questions.schema import TABLES
from reasoning.questions.track_boxes import TrackBoxes, recorded_stays
from reasoning.questions.whole_lives import BOXES, ENCOUNTERS, Lives, rows_of
from recorders import channels
from recorders.annotated.frames import annotated_cameras
from recorders.annotated.provenance import CORRECTIONS
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.messages import Event, Regions
from recorders.quality import QualityMeasure, recorded_quality

BATCH_ROWS = 50_000
BITS = ("grouping", "grouped", "splitting")
ENDING = ("group_changed", "group_ended")
_READ = ("tracks", "relations", "groups", "held_back", "events", "regions")
_INT32 = 2**31 - 1
_TOLD = frozenset({"tracks", "presence", "zones", "hidden"})
"""Tables that say of every track and frame how it was seen."""


def read_recordings(
    path: str | Path,
    sink: Sink,
    *,
    name: str | None = None,
    digest: str = "",
    limits: Limits = DEFAULT_LIMITS,
    encounters: EncounterParameters | None = None,
    looks: bool = False,
    tables: Collection[str] = EVERYTHING,
) -> list[RecordingFacts]:
    """Send every table's rows of a log to ``sink``; one recording per camera that has tracks.

    All messages are read and checked, whichever tables are wanted: what is damaged is said.

    Args:
        path: an annotated log.
        sink: takes a table's name and rows in the order of its columns.
        name: the recording's name, by default the file's stem; with several cameras ``/camera``
            is appended.
        digest: the file's digest, written into ``recordings``.
        limits: bounds on what the log may make us allocate.
        encounters: thresholds for the encounters.
        looks: look at some pictures of each target for its colours, where there are pictures.
        tables: those whose rows are wanted; what others alone are made from is not computed.

    Raises:
        RecordingError: no annotated log, or a damaged one.
        SceneTraceError: an id that fits no table.
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
            _Camera(annotated, facts, sink, parameters, looks=looks, tables=tables).read(
                quality.get(annotated.camera, ())
            )
            found.append(facts)
    return found


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
        tables: Collection[str],
    ) -> None:
        self._looking = looks and log.has_pictures
        self._log = log
        self._facts = facts
        self._sink = sink
        self._parameters = encounters
        self._rows: dict[str, list[Row]] = {t: [] for t in TABLES if t in tables}
        self._tells = self._wants(_TOLD)
        self._needs_targets = self._wants({*_TOLD, *BOXES, "groups", "events"})
        self._relations, self._groups, self._presence = Runs(), Runs(), Runs()
        self._zones, self._bits, self._hidden = Runs(), Runs(), Runs()
        self._formed: dict[int, tuple[int, ...]] = {}
        self._ended: dict[int, list[tuple[int, str]]] = {}
        self._group_rows: list[HeldInterval] = []
        self._lives = Lives()
        self._targets: dict[int, SeenTarget] = {}
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
        for row in correction_rows(self._log.facts.get(CORRECTIONS), facts.path):
            self._add("corrections", row)
        for table in self._rows:
            self._send(table)
        if "recordings" in self._rows:
            self._sink("recordings", [facts.row()])

    def _wants(self, tables: Collection[str]) -> bool:
        return not self._rows.keys().isdisjoint(tables)

    def _take(self, frame: AnnotatedFrame) -> None:
        t = (frame.time_ns - self._facts.start_ns) / channels.NANOS
        if frame.index > _INT32:
            raise RecordingError(
                f"frame {frame.index} after frame {self._frame}: no table holds such a number",
                self._facts.path,
                record="tracks",
            )
        if self._frame < 0:
            self._facts.first_frame = frame.index
        self._frame, self._t = frame.index, t
        self._facts.frames += 1
        self._add("frames", (frame.index, t))
        check_ids(frame)
        if self._needs_targets:
            self._targets = seen_targets(frame.tracks, frame.events)
        if frame.regions is not None and (
            not self._regions or frame.regions != self._regions[-1][1]
        ):
            self._regions.append((frame.index, frame.regions))
        if self._tells or self._wants(BOXES):
            self._take_tracks(frame, t)
        if self._wants(("relations", *ENCOUNTERS)):
            self._take_relations(frame, t)
        if self._wants(("groups",)):
            self._take_groups(frame, t)
        for withheld in frame.held_back:
            self._add("held_back", (t, *withheld.box, withheld.reason))
        for event in frame.events:
            self._take_event(event)

    def _add(self, table: str, values: tuple[Any, ...]) -> None:
        rows = self._rows.get(table)
        if rows is None:
            return
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
            tells = self._tells and track.present
            told = self._sight((track.id,)) if tells else UNTOLD
            if "tracks" in self._rows:
                self._add("tracks", (frame.index, t, *track_row(track, told)))
            if track.label is not UNSET:
                self._lives.labels[track.id] = track.label
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
            self._lives.boxes.setdefault(track.id, TrackBoxes()).add(
                self._facts.frames, frame.index, t, self._targets[track.id], told
            )

        def of_one(key: Any, _: Hashable) -> Sight:
            return alone[key[0] if isinstance(key, tuple) else key]

        def with_partners(key: Any, partners: Any) -> Sight:
            return self._sight((key[0], *partners))

        now = frame.index
        if "presence" in self._rows:
            self._end_presence(self._presence.step(now, t, present, of_one))
        if "zones" in self._rows:
            self._end_named("zones", self._zones.step(now, t, zones, of_one))
        if "bits" in self._rows:
            self._end_bits(self._bits.step(now, t, bits, with_partners))
        if "hidden" in self._rows:
            self._end_named("hidden", self._hidden.step(now, t, hidden, of_one))

    def _sight(self, ids: Sequence[int]) -> Sight:
        return sight(self._targets, ids)

    def _end_presence(self, over: Sequence[HeldInterval]) -> None:
        for run in over:
            self._add("presence", (run.key, *run.interval, *run.belief))

    def _end_named(self, table: str, over: Sequence[HeldInterval]) -> None:
        """Intervals of a track and a name: a zone that it was in, a part of it that was hidden."""
        for key, _, interval, belief in over:
            track, name = pair_of(key)
            self._add(table, (track, name, *interval, *belief))

    def _end_bits(self, over: Sequence[HeldInterval]) -> None:
        for key, partners, interval, belief in over:
            track, bit = pair_of(key)
            self._lives.held_bits.append(
                (track, bit, list(ids_of(partners)), *interval, *belief)
            )

    def _take_relations(self, frame: AnnotatedFrame, t: float) -> None:
        # A run is one interval of a state: the same state with a later `since` is a new interval.
        now: dict[Hashable, Hashable] = {
            (relation.a, relation.b): (relation.state, relation.since_frame)
            for relation in frame.relations
        }
        told = self._sight if "relations" in self._rows else lambda _: UNTOLD
        self._end_relations(
            self._relations.step(frame.index, t, now, lambda k, _: told(ids_of(k)))
        )

    def _end_relations(self, over: Sequence[HeldInterval]) -> None:
        for key, value, interval, belief in over:
            (a, b), (state, _) = pair_of(key), pair_of(value)
            self._lives.related.append((a, b, state, *interval, *belief))
            if state == "JOINT":
                self._lives.joint.setdefault((a, b), []).append(interval[:2])

    def _take_groups(self, frame: AnnotatedFrame, t: float) -> None:
        now: dict[Hashable, Hashable] = {
            group.label: tuple(sorted(group.members)) for group in frame.groups
        }
        for group in frame.groups:
            self._formed.setdefault(group.label, tuple(group.formed_from))
        self._group_rows += self._groups.step(
            frame.index, t, now, lambda _, members: self._sight(ids_of(members))
        )

    def _take_event(self, event: Event) -> None:
        if "events" in self._rows:
            t = (event.time_ns - self._facts.start_ns) / channels.NANOS
            self._add("events", event_row(event, t, self._sight(event.subjects)))
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
        if "zones" in self._rows:
            for stay in recorded_stays(
                self._regions, self._lives.boxes, self._log.zone_point
            ):
                self._add("zones", stay)
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
                    list(ids_of(members)),
                    *interval,
                    formed,
                    self._end(label, interval),
                    *belief,
                ),
            )
        pictures = self._log if self._looking else None
        for table, row in rows_of(
            self._lives, self._facts, self._parameters, pictures, self._rows.keys()
        ):
            self._add(table, row)

    def _end(self, label: int, interval: Interval) -> str | None:
        """The kind of the first event after the group's last frame that names it; None if it
        lived to the end.
        """
        after = [kind for frame, kind in self._ended.get(label, ()) if frame >= interval[1]]
        return after[0] if after and interval[1] < self._frame else None
