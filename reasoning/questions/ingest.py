"""An annotated log as rows of the tables, reading its small channels alone: no picture is touched.

The log is streamed; rows of tracks are handed on in batches. What stays in memory is one open
interval per running relation, group, zone and track, and the boxes of the tracks (40 bytes per
track and frame) for the encounters.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Hashable, Sequence
from dataclasses import asdict, astuple, dataclass, field
from operator import itemgetter
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from reasoning.encounters import EncounterParameters, History, find_encounters, near, still
from reasoning.questions.schema import TABLES
from recorders import channels
from recorders.annotated.frames import annotated_cameras
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.messages import Event

Row = tuple[Any, ...]
Sink = Callable[[str, Sequence[Row]], None]
Interval = tuple[int, int, float, float]
BATCH_ROWS = 50_000
BITS = ("grouping", "grouped", "splitting")
ENDING = ("group_changed", "group_ended")
_READ = ("tracks", "relations", "groups", "events")
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

    Raises:
        RecordingError: no annotated log, or a damaged one.
    """
    base = name or Path(path).stem
    with LogReader(path, limits) as log:
        cameras: list[str | None] = [*annotated_cameras(log)]
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
            _Camera(annotated, facts, sink, encounters or EncounterParameters()).read()
            found.append(facts)
    return found


@dataclass
class _Open:
    """A run of frames in which something stayed the same."""

    value: Hashable
    start_frame: int
    start_t: float
    end_frame: int
    end_t: float

    @property
    def interval(self) -> Interval:
        return self.start_frame, self.end_frame, self.start_t, self.end_t


class Runs:
    """Turns what holds frame by frame into intervals: a run ends with the first frame in which it
    does not hold.
    """

    def __init__(self) -> None:
        self._open: dict[Hashable, _Open] = {}

    def step(
        self, frame: int, t: float, now: dict[Hashable, Hashable]
    ) -> list[tuple[Hashable, Hashable, Interval]]:
        """Take what holds in this frame (key to value); the runs that are over, as (key, value,
        interval).
        """
        over: list[tuple[Hashable, Hashable, Interval]] = []
        for key in [
            k for k, run in self._open.items() if k not in now or now[k] != run.value
        ]:
            run = self._open.pop(key)
            over.append((key, run.value, run.interval))
        for key, value in now.items():
            held = self._open.get(key)
            if held is None:
                self._open[key] = _Open(value, frame, t, frame, t)
            else:
                held.end_frame, held.end_t = frame, t
        return over

    def close(self) -> list[tuple[Hashable, Hashable, Interval]]:
        """All runs that are still open, as `step` gives them."""
        over = [(key, run.value, run.interval) for key, run in self._open.items()]
        self._open = {}
        return over


@dataclass
class _Boxes:
    frames: list[int] = field(default_factory=list)
    times: list[float] = field(default_factory=list)
    boxes: list[tuple[float, float, float, float]] = field(default_factory=list)

    def history(self) -> History:
        return History(
            np.array(self.frames, np.int64),
            np.array(self.times),
            np.array(self.boxes, np.float64).reshape(-1, 4),
        )


class _Camera:
    """Reads one camera of one log."""

    def __init__(
        self,
        log: AnnotatedLog,
        facts: RecordingFacts,
        sink: Sink,
        encounters: EncounterParameters,
    ) -> None:
        self._log = log
        self._facts = facts
        self._sink = sink
        self._parameters = encounters
        self._rows: dict[str, list[Row]] = {table: [] for table in TABLES}
        self._relations, self._groups, self._presence = Runs(), Runs(), Runs()
        self._zones, self._bits, self._hidden = Runs(), Runs(), Runs()
        self._formed: dict[int, tuple[int, ...]] = {}
        self._ended: dict[int, list[tuple[int, str]]] = {}
        self._group_rows: list[tuple[int, tuple[int, ...], Interval]] = []
        self._joint: dict[tuple[int, int], list[tuple[int, int]]] = {}
        self._boxes: dict[int, _Boxes] = {}
        self._t, self._frame = 0.0, -1

    def read(self) -> None:
        facts = self._facts
        facts.tracker = self._log.tracker
        facts.output_digest = self._log.facts.get("output_digest", "")
        facts.start_ns = self._log.start_ns
        facts.width, facts.height = self._log.size() or (0, 0)
        for frame in self._log.frames(_READ):
            self._take(frame)
        self._finish()
        for table in self._rows:
            self._send(table)
        self._sink("recordings", [facts.row()])

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
        self._add("frames", frame.index, t)
        self._take_tracks(frame, t)
        self._take_relations(frame, t)
        self._take_groups(frame, t)
        for event in frame.events:
            self._take_event(event)

    def _add(self, table: str, *values: Any) -> None:
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
        for track in frame.tracks:
            self._add(
                "tracks", frame.index, t, track.id, *track.box, *track.velocity, track.mode, track.confidence,
                track.grouping, track.grouped, track.splitting, track.group, track.scene,
                None if track.label is UNSET else track.label, track.present,
            )  # fmt: skip
            if not track.present:
                continue
            present[track.id] = True
            zones.update({(track.id, zone): True for zone in track.zones})
            hidden.update({(track.id, part): True for part in track.hidden_parts})
            for bit in BITS:
                if getattr(track, bit):
                    bits[(track.id, bit)] = tuple(sorted(getattr(track, f"{bit}_partners")))
            own = self._boxes.setdefault(track.id, _Boxes())
            own.frames.append(frame.index)
            own.times.append(t)
            own.boxes.append(track.box)
        for key, _, interval in self._presence.step(frame.index, t, present):
            self._add("presence", key, *interval)
        self._end_named("zones", self._zones.step(frame.index, t, zones))
        self._end_bits(self._bits.step(frame.index, t, bits))
        self._end_named("hidden", self._hidden.step(frame.index, t, hidden))

    def _end_named(self, table: str, over: list[tuple[Any, Any, Interval]]) -> None:
        """Intervals of a track and a name: a zone that it was in, a part of it that was hidden."""
        for (track, name), _, interval in over:
            self._add(table, track, name, *interval)

    def _end_bits(self, over: list[tuple[Any, Any, Interval]]) -> None:
        for (track, bit), partners, interval in over:
            self._add("bits", track, bit, list(partners), *interval)

    def _take_relations(self, frame: AnnotatedFrame, t: float) -> None:
        # A run is one interval of a state: the same state with a later `since` is a new interval.
        now: dict[Hashable, Hashable] = {
            (relation.a, relation.b): (relation.state, relation.since_frame)
            for relation in frame.relations
        }
        self._end_relations(self._relations.step(frame.index, t, now))

    def _end_relations(self, over: list[tuple[Any, Any, Interval]]) -> None:
        for (a, b), (state, _), interval in over:
            self._add("relations", a, b, state, *interval)
            if state == "JOINT":
                self._joint.setdefault((a, b), []).append(interval[:2])

    def _take_groups(self, frame: AnnotatedFrame, t: float) -> None:
        now: dict[Hashable, Hashable] = {
            group.label: tuple(sorted(group.members)) for group in frame.groups
        }
        for group in frame.groups:
            self._formed.setdefault(group.label, tuple(group.formed_from))
        self._end_groups(self._groups.step(frame.index, t, now))

    def _end_groups(self, over: list[tuple[Any, Any, Interval]]) -> None:
        self._group_rows += [
            (label, members, interval) for label, members, interval in over
        ]

    def _take_event(self, event: Event) -> None:
        t = (event.time_ns - self._facts.start_ns) / channels.NANOS
        evidence = msgspec.json.encode(event.evidence).decode()
        self._add(
            "events",
            event.id,
            event.kind,
            event.frame,
            t,
            list(event.subjects),
            event.rule,
            evidence,
            event.text,
        )
        for label in event.groups:
            self._add("event_groups", event.id, label)
            if event.kind in ENDING:
                self._ended.setdefault(label, []).append((event.frame, event.kind))

    def _finish(self) -> None:
        self._facts.seconds = self._t
        for key, _, interval in self._presence.close():
            self._add("presence", key, *interval)
        self._end_named("zones", self._zones.close())
        self._end_bits(self._bits.close())
        self._end_named("hidden", self._hidden.close())
        self._end_relations(self._relations.close())
        self._end_groups(self._groups.close())
        for label, members, interval in sorted(
            self._group_rows, key=lambda g: (g[2][0], g[0])
        ):
            self._add(
                "groups",
                label,
                list(members),
                *interval,
                list(self._formed[label]),
                self._end(label, interval),
            )
        self._find_encounters()

    def _end(self, label: int, interval: Interval) -> str | None:
        """The kind of the first event after the group's last frame that names it; None if it
        lived to the end.
        """
        after = [kind for frame, kind in self._ended.get(label, ()) if frame >= interval[1]]
        return after[0] if after and interval[1] < self._frame else None

    def _find_encounters(self) -> None:
        for name, value in asdict(self._parameters).items():
            self._add("encounter_parameters", name, value)
        histories = {track: self._boxes[track].history() for track in sorted(self._boxes)}
        for encounter in find_encounters(histories, self._parameters, joint=self._joint):
            self._add(
                "encounters",
                encounter.a,
                encounter.b,
                encounter.kind,
                encounter.start_frame,
                encounter.end_frame,
                encounter.start_s,
                encounter.end_s,
                encounter.confidence,
            )
            for phase in encounter.phases:
                self._add("phases", encounter.a, encounter.b, *astuple(phase))
            for fierce in encounter.abrupt:
                self._add("abrupt", encounter.a, encounter.b, *astuple(fierce))
            self._add(
                "encounter_evidence",
                encounter.a,
                encounter.b,
                encounter.start_frame,
                encounter.near_s,
                encounter.distance,
                encounter.relative_speed,
                encounter.sure_frame,
                encounter.drift,
                encounter.all_distance,
                encounter.all_relative_speed,
            )
        for track, history in histories.items():
            for stretch in still(history, self._parameters):
                self._add("still", track, *astuple(stretch))
        for a, b, stretch in near(histories, self._parameters):
            self._add("near", a, b, *astuple(stretch))
