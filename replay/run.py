"""A whole replay: forward pass, hindsight, reasoning, and the annotated log.

Two readings of the recording where hindsight is on: the first runs the tracker and puts its
answers into a temporary spool, the second rewrites them with what came later, reasons over them
and writes. Memory stays flat: the spool is a file. Without hindsight one reading does both.
"""

from __future__ import annotations

import os
import tempfile
from array import array
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field
from itertools import chain, islice, repeat
from pathlib import Path
from threading import Event
from typing import IO, TYPE_CHECKING, Any

import msgspec
from msgspec import Struct

from reasoning.reasoner import Reasoner
from recorders import channels
from recorders.annotated import checkpoint, digest
from recorders.annotated.checkpoint import Checkpoint
from recorders.annotated.frames import instants
from recorders.annotated.membership import PATCHES, Patches, rename_labels
from recorders.annotated.provenance import provenance_of, sha256
from recorders.corrections import Corrections
from recorders.errors import RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.messages import Digest, Regions, Targets
from recorders.parameters import Config
from recorders.scene import Frame, SceneLog
from replay import hindsight
from replay.configuration import fingerprint, replay_config
from replay.engine import (
    AHEAD,
    Forward,
    Step,
    continuing,
    of_recording,
    recorded_now,
)
from replay.frame_payloads import payloads
from replay.hindsight.blind import blind_times
from replay.trackers.choice import DEFAULT_TRACKER, AnyTracker, TrackerChoice, choose
from replay.trackers.tracker import Payloads

Progress = Callable[[str, int], None]

if TYPE_CHECKING:
    from replay.correcting import Corrector

_BLOCK = 1 << 20


@dataclass(frozen=True)
class ReplayOptions:
    """What to write; never what is computed.

    Attributes:
        tracker: a tracker's name, or a class of the caller's own.
        config: as `replay_config` makes it; without, the tracker's defaults.
        from_ns: first log time to write.
        to_ns: end of what is written, excluded.
        annotations_only: leave the recorded messages out.
        checkpoint_ns: put a checkpoint into the log every so much recording time.
        checkpoints: an annotated log with checkpoints of this recording and configuration to
            start from.
        force: overwrite an existing output.
        camera: which camera, where there are several.
        regions: those that stand in place of all that were recorded.
        corrections: a person's, applied before anything is reasoned out.
        follow: read a log that is still written, without hindsight, until this is set or it ends.
        choice: the tracker that is meant.
        parameters: the whole configuration.
    """

    tracker: AnyTracker = DEFAULT_TRACKER
    config: Config | None = None
    from_ns: int | None = None
    to_ns: int | None = None
    annotations_only: bool = False
    checkpoint_ns: int | None = None
    checkpoints: Path | None = None
    force: bool = False
    camera: str | None = None
    limits: Limits = DEFAULT_LIMITS
    regions: Regions | None = None
    corrections: Corrections | None = None
    follow: Event | None = None
    choice: TrackerChoice = field(init=False, repr=False)
    parameters: Config = field(init=False, repr=False)

    def __post_init__(self) -> None:
        choice = choose(self.tracker)
        object.__setattr__(self, "choice", choice)
        config = replay_config(choice) if self.config is None else self.config
        object.__setattr__(self, "parameters", config)


@dataclass
class Annotated:
    """One frame on its way to the log."""

    frame: Frame
    payloads: list[tuple[str, bytes]]
    digest: Any
    track_ids: list[int]
    events: int


class SpoolEntry(Struct, frozen=True):
    """A frame of the forward pass, waiting for hindsight."""

    targets: Targets
    extra: Payloads = ()
    recorded: str = ""
    input_link: str = ""
    state: bytes | None = None


class _TargetsAlone(Struct, frozen=True):
    """A `SpoolEntry` without what hindsight does not read."""

    targets: Targets


class Spool:
    """The forward pass's answers in a temporary file, read as often as hindsight wants."""

    def __init__(self) -> None:
        self._file: IO[bytes] = tempfile.TemporaryFile(prefix="scenetrace-")  # noqa: SIM115
        self._encoder = msgspec.msgpack.Encoder()
        self._decoder = msgspec.msgpack.Decoder(SpoolEntry)
        self._targets = msgspec.msgpack.Decoder(_TargetsAlone)

    def __enter__(self) -> Spool:
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def append(self, entry: SpoolEntry) -> None:
        """Add the next frame."""
        data = self._encoder.encode(entry)
        self._file.write(len(data).to_bytes(8, "little"))
        self._file.write(data)

    def entries(self, first: int = 0) -> Iterator[SpoolEntry]:
        """The frames from one on; several readings may go on at once."""
        for data in islice(self._records(), first, None):
            yield self._decoder.decode(data)

    def _records(self) -> Iterator[bytes]:
        # Each reading has its own place and buffer, so the file's one position is moved once a
        # block, not once a frame.
        self._file.flush()
        place, end = 0, self._file.seek(0, os.SEEK_END)
        buffer = b""
        start = 0
        while start < len(buffer) or place < end:
            size = (
                int.from_bytes(buffer[start : start + 8], "little")
                if len(buffer) - start >= 8
                else None
            )
            if size is None or len(buffer) - start - 8 < size:
                self._file.seek(place)
                block = self._file.read(max(_BLOCK, size or 0))
                place += len(block)
                buffer, start = buffer[start:] + block, 0
                continue
            yield buffer[start + 8 : start + 8 + size]
            start += 8 + size

    def targets(self) -> Iterator[Targets]:
        """The trackers' answers from the first frame on."""
        return (self._targets.decode(data).targets for data in self._records())


def recorded_targets(
    path: Path, camera: str, start: Checkpoint, limits: Limits
) -> Iterator[tuple[int, Targets]]:
    """The forward pass's answers up to a checkpoint with their log times, as an annotated log
    holds them.

    Raises:
        UsageError: the log does not hold them all (it was written with ``--from``).
        RecordingError: they are not those that led to the checkpoint.
    """
    expected, link = 0, digest.START
    wanted = ("targets", "digest")
    with LogReader(path, limits) as log:
        for time_ns, messages, _ in instants(log, camera, wanted):
            latest = dict(messages)
            if len(latest) < len(wanted):
                break
            targets, made = (latest[name].data for name in wanted)
            found: Targets = channels.decode(
                "targets", targets, path=str(path), limits=limits
            )
            if found.frame != expected or expected > start.frame:
                break
            said: Digest = channels.decode("digest", made, path=str(path), limits=limits)
            link = digest.link(link, said.frame, time_ns, said.recorded, said.channels)
            if link != said.link or digest.channel_digests([("targets", targets)])[
                "targets"
            ] != said.channels.get("targets"):
                raise RecordingError(
                    f"frame {expected} is not what the replay wrote: altered; replay"
                    " without --checkpoints",
                    path,
                )
            expected += 1
            yield time_ns, found
    if expected <= start.frame:
        raise UsageError(
            f"{path}: holds the forward pass up to frame {expected} only; replay without"
            " --checkpoints"
        )
    if link != start.link:
        raise RecordingError(
            f"its frames do not lead to {checkpoint.name(start.frame)}: altered", path
        )


def _under_final_ids(kept: SpoolEntry, names: Mapping[int, int]) -> Payloads:
    """What a tracker wrote besides its targets, under the identities that they have after
    hindsight.
    """
    ids = [target.id for target in kept.targets.targets]
    finished: list[tuple[str, bytes]] = []
    for name, data in kept.extra:
        if name == PATCHES:
            finished.append(("membership", Patches.unpacked(data).payload(names, ids)))
        else:
            finished.append(
                (name, rename_labels(data, names, ids) if name == "membership" else data)
            )
    return tuple(finished)


def _painted(
    pool: ThreadPoolExecutor, entries: Iterator[SpoolEntry], names: Mapping[int, int]
) -> Iterator[tuple[SpoolEntry, Callable[[], Payloads]]]:
    """The entries in order, each with what gives `_under_final_ids`: label images are painted a
    few frames ahead.
    """
    waiting: deque[tuple[SpoolEntry, Callable[[], Payloads]]] = deque()
    for kept in entries:
        made = pool.submit(_under_final_ids, kept, names).result if kept.extra else tuple
        waiting.append((kept, made))
        if len(waiting) > AHEAD:
            yield waiting.popleft()
    yield from waiting


class Run:
    """The replay of one scene: iterate `frames` for the annotated frames in order.

    Attributes:
        input_link: the input chain's link after the last frame read.
        link: the output chain's link after the last frame.
        resumed: the frame after which a checkpoint was taken up, None from the start.
        sightings: in how many frames each track was observed, written or not.
    """

    def __init__(
        self, scene: SceneLog, options: ReplayOptions, progress: Progress | None = None
    ) -> None:
        self.scene = scene
        self.options = options
        self.input_link = digest.START
        self.link = digest.START
        self.computed = 0
        self.last_index = -1
        self.sightings: dict[int, int] = {}
        self._progress = progress or (lambda *_: None)
        self._choice = options.choice
        self._fingerprint = fingerprint(
            options.choice, options.parameters, options.corrections
        )
        self._corrector = _corrector(options.corrections)
        self._hindsight = options.choice.wants_hindsight(options.parameters)
        # Whether the second reading has to decode what was detected, for its labels alone.
        self._labelled = False
        self._start_ns: int | None = None
        self._periods = 0
        self.resumed: int | None = None

    @property
    def may_stop(self) -> bool:
        """Whether frames that nobody wants need not be computed: nothing later can change an
        earlier frame.
        """
        return not self._hindsight

    # -- the forward pass
    # ------------------------------------------------------------------------------------------

    def _forward(self, start: Checkpoint | None) -> Iterator[Step]:
        forward = Forward(
            self.scene, self._choice, self.options.parameters, unfinished=self._hindsight
        )
        if start is not None:
            forward.resume(start)
        yield from forward.steps(self._checkpoint_due)

    def _checkpoint_due(self, now: int) -> bool:
        """The first frame of every period, reckoned from the recording's start, so that the same
        frames have checkpoints wherever the replay was started.
        """
        period = self.options.checkpoint_ns
        if period is None:
            return False
        if self._start_ns is None:
            self._start_ns = next(self.scene.frame_times())
        before, self._periods = self._periods, (now - self._start_ns) // period
        return self._periods > before

    def _first_reading(
        self, start: Checkpoint | None, spool: Spool, times: array[int]
    ) -> Iterator[Targets]:
        """The tracker's answers while they are made; they and their times are kept."""
        if start is not None:
            assert self.options.checkpoints is not None
            path, limits = self.options.checkpoints, self.options.limits
            for time_ns, before in recorded_targets(path, self.scene.camera, start, limits):
                times.append(time_ns)
                spool.append(SpoolEntry(before))
                yield before
        for step in self._forward(start):
            self._labelled = self._labelled or any(step.frame.detections.labels)
            times.append(step.frame.time_ns)
            spool.append(
                SpoolEntry(
                    step.targets, step.extra, step.recorded, step.input_link, step.state
                )
            )
            self._progress("tracking", step.frame.index)
            yield step.targets

    def _two_readings(self, start: Checkpoint | None, spool: Spool) -> Iterator[Step]:
        times = array("q")
        readings = chain([self._first_reading(start, spool, times)], repeat(None))
        first = 0 if start is None else start.frame + 1
        start_ns = None if start is None else start.time_ns + 1
        names: dict[int, int] = {}
        rewritten = hindsight.rewrite(
            lambda: next(readings) or spool.targets(),
            self.scene.info,
            times,
            self.options.parameters,
            names,
            [] if self._corrector is None else self._corrector.apart,
            lambda: blind_times(self.scene.changes(), times),
        )
        frames = self.scene.frames(
            start_ns, first, again=True, own=self.options.annotations_only
        )
        seen = islice(rewritten, first, None)
        with ThreadPoolExecutor(max_workers=1, thread_name_prefix="paint") as pool:
            # The first rewritten frame comes first: with it the names are known.
            for targets, frame, (kept, extra) in zip(
                seen, frames, _painted(pool, spool.entries(first), names), strict=True
            ):
                yield Step(
                    frame,
                    targets,
                    extra(),
                    kept.recorded,
                    kept.input_link,
                    kept.targets,
                    kept.state,
                )

    # -- reasoning and writing
    # -------------------------------------------------------------------------------------

    def frames(
        self,
        start: Checkpoint | None = None,
        keep: Callable[[Checkpoint], None] | None = None,
    ) -> Iterator[Annotated]:
        """The annotated frames from the start, or from after a checkpoint; ``keep`` gets the new
        checkpoints.
        """
        info = self.scene.info
        reasoner = Reasoner(self.options.parameters, info.width, info.height)
        if start is not None:
            with continuing(start.frame):
                reasoner.restore(start.reasoner_state)
            self.link = start.link
            self.resumed = start.frame
            self._checkpoint_due(start.time_ns)
        with ExitStack() as stack:
            spool = stack.enter_context(Spool()) if self._hindsight else None
            steps = (
                self._forward(start) if spool is None else self._two_readings(start, spool)
            )
            for step in steps:
                annotated = self._annotate(step, reasoner)
                self.computed += 1
                self.last_index = step.frame.index
                self.input_link = step.input_link
                self._progress("writing", step.frame.index)
                yield annotated
                if step.state is not None and keep is not None:
                    keep(self._checkpoint(step, step.state, reasoner))

    def _annotate(self, step: Step, reasoner: Reasoner) -> Annotated:
        frame = step.frame
        targets, extra, labels = step.targets, step.extra, None
        if self._corrector is not None:
            corrected = self._corrector.step(targets, reasoner.known)
            extra = corrected.payloads(extra, targets)
            targets, labels = corrected.targets, corrected.labels
        scene = reasoner.step(
            frame.index,
            frame.time_ns,
            targets,
            frame.regions,
            frame.detections if self._labelled or step.forward is None else None,
            labels,
            scene_changes=frame.changes,
        )
        forward = step.targets if step.forward is None else step.forward
        content = payloads(
            forward,
            scene,
            reasoner.regions,
            frame.time_ns,
            frame.stamp_ns,
            extra,
            step.targets.held_back,
        )
        made = digest.digest(self.link, frame.index, frame.time_ns, step.recorded, content)
        self.link = made.link
        ids = [track.id for track in scene.tracks.tracks]
        for track in scene.tracks.tracks:
            if track.observed:
                self.sightings[track.id] = self.sightings.get(track.id, 0) + 1
        return Annotated(frame, content, made, ids, len(scene.events))

    def _checkpoint(
        self, step: Step, tracker_state: bytes, reasoner: Reasoner
    ) -> Checkpoint:
        return Checkpoint(
            checkpoint.FORMAT,
            frame=step.frame.index,
            time_ns=step.frame.time_ns,
            recorded=recorded_now(step.frame),
            input_link=step.input_link,
            link=self.link,
            tracker=self._choice.name,
            fingerprint=self._fingerprint,
            tracker_state=checkpoint.decode_state(tracker_state),
            reasoner_state=reasoner.state(),
        )

    def nearest_checkpoint(self) -> Checkpoint | None:
        """The last checkpoint before ``from_ns`` that this recording and configuration can
        continue.

        Raises:
            UsageError: the checkpoints are of another recording, configuration, tracker or version.
        """
        options = self.options
        if options.checkpoints is None or options.from_ns is None:
            return None
        with LogReader(options.checkpoints, options.limits) as log:
            best = _last_checkpoint(log, options.from_ns)
        if best is None:
            return None
        if best.tracker != options.choice.name:
            raise UsageError(
                f"{options.checkpoints}: its checkpoints were made with another tracker"
                f" ({best.tracker}, not {options.choice.name}); replay without --checkpoints"
            )
        if best.fingerprint != self._fingerprint:
            raise UsageError(
                f"{options.checkpoints}: its checkpoints were made with another"
                " configuration or package version; replay without --checkpoints"
            )
        if not of_recording(self.scene, best):
            raise UsageError(
                f"{options.checkpoints}: its checkpoints are of another recording than"
                f" {self.scene.path}"
            )
        return best


def _corrector(corrections: Corrections | None) -> Corrector | None:
    """What corrects as a person said; nothing of it is loaded where nobody did."""
    if corrections is None:
        return None
    from replay.correcting import Corrector

    return Corrector(corrections)


def _last_checkpoint(log: LogReader, before_ns: int) -> Checkpoint | None:
    """The last checkpoint before a time, held against the digest that the log has of it.

    Raises:
        RecordingError: it is damaged or altered.
    """
    listed = [
        (entry.log_time_ns, entry.name)
        for entry in log.index.attachment_indexes or log.attachments()
        if entry.name.startswith(f"{checkpoint.PREFIX}/") and entry.log_time_ns < before_ns
    ]
    if not listed:
        return None
    name = max(listed)[1]
    known = provenance_of(log).checkpoints
    for found in log.attachments([name]):
        if known is not None and known.get(name) != sha256(found.data):
            raise RecordingError(
                f"{name} is not what the replay wrote: altered; replay without"
                " --checkpoints",
                log.path,
                record=name,
            )
        made = checkpoint.decode(found.data, str(log.path))
        if (made.time_ns, checkpoint.name(made.frame)) != (found.log_time_ns, name):
            raise RecordingError(
                f"{name} holds the state after frame {made.frame}", log.path, record=name
            )
        return made
    return None
