"""The annotated log: recorded messages byte for byte as they were, the annotated channels beside
them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

from recorders import channels
from recorders.annotated import checkpoint, digest
from recorders.annotated.checkpoint import Checkpoint
from recorders.annotated.provenance import (
    CORRECTIONS,
    KIND,
    METADATA,
    canonical,
    extras,
    sha256,
    with_fact_digests,
)
from recorders.clock import Gaps
from recorders.errors import OutputExistsError, UsageError
from recorders.format_version import FORMAT_VERSION
from recorders.log import Attachment, LogWriter, Message
from recorders.log.writer import LIVE_FLUSH_NS
from recorders.machine import machine, opencv_build, python_version
from recorders.names import utf8
from recorders.parameters import as_plain
from recorders.pieces import Span, carried
from recorders.scene import SceneLog
from recorders.vision import opencv_threads
from replay.configuration import package_versions
from replay.run import Annotated, Progress, ReplayOptions, Run

RECORDING_METADATA = "scenetrace.recording"
_OPTIONAL = ("membership",)
WHOLE_FLUSH_NS = 60_000_000_000
"""Nobody reads the log before it is whole, and one frame a chunk would make its index long."""


@dataclass(frozen=True)
class ReplaySummary:
    """What a replay did.

    Attributes:
        frames: frames written.
        computed: frames that went through the reasoning.
        tracks: different track ids in the frames written.
        events: events in the frames written.
        input_digest: the input chain's last link.
        output_digest: the output chain's last link.
        found: different tracks that were observed in more than one frame, written or not.
        resumed: the checkpoint's frame that the replay started after, None from the start.
        unreadable: pictures that could not be decoded: a line for each reason.
        gaps: times in which nothing was recorded: a line for each.
        ended: the recording was read to its end.
    """

    frames: int
    computed: int
    tracks: int
    events: int
    input_digest: str
    output_digest: str
    found: int = 0
    resumed: int | None = None
    unreadable: tuple[str, ...] = ()
    gaps: tuple[str, ...] = ()
    ended: bool = True


def replay(
    scene_path: str | Path,
    out: str | Path,
    options: ReplayOptions,
    progress: Progress | None = None,
) -> ReplaySummary:
    """Replay a scene log into an annotated log.

    Args:
        scene_path: a scene log, or an annotated log whose scene is replayed again.
        out: the annotated log; complete or absent.
        options: tracker, configuration, span.
        progress: called with the stage's name and the frame's number.

    Raises:
        RecordingError, UsageError, OutputExistsError.
    """
    out = Path(out)
    if out.exists() and not options.force:
        raise OutputExistsError(out)
    if out.exists() and Path(scene_path).exists() and out.samefile(scene_path):
        raise UsageError(
            f"{out}: is the recording itself; write the annotated log to another file"
        )
    # Decoding, painting and writing go on side by side: threads of OpenCV's own would only take
    # turns with them.
    with (
        opencv_threads(1),
        SceneLog(
            scene_path, options.camera, options.limits, options.regions, options.follow
        ) as scene,
    ):
        run = Run(scene, options, progress)
        start = run.nearest_checkpoint()
        pictures = [channels.topic(scene.camera, name) for name in channels.PICTURES]
        with LogWriter(
            out,
            force=options.force,
            keep_part=scene.grows,
            picture_topics=pictures,
            flush_interval_ns=LIVE_FLUSH_NS if scene.grows else WHOLE_FLUSH_NS,
            limits=options.limits,
        ) as log:
            writer = AnnotatedWriter(
                log, scene, options, digest.START if start is None else start.link
            )
            writer.carry()
            for annotated in run.frames(start, writer.keep):
                writer.write(annotated)
                writer.gaps.step(annotated.frame.index, annotated.frame.time_ns)
                if writer.is_past(annotated) and run.may_stop:
                    break
            else:
                writer.copy(scene.trailing)
                if scene.trailing:
                    run.input_link = digest.chain_link(
                        run.input_link, digest.recorded_digest(scene.trailing)
                    )
            return writer.finish(run)


class AnnotatedWriter:
    """Writes annotated frames within the options' span; ``link`` is the output chain's before the
    first that comes.
    """

    def __init__(
        self,
        log: LogWriter,
        scene: SceneLog,
        options: ReplayOptions,
        link: str = digest.START,
    ) -> None:
        self._log = log
        self._scene = scene
        self._options = options
        self._recorded: dict[int, int] = {}
        if not options.annotations_only:
            for c in scene.recorded:
                self._recorded[c.id] = log.channel(
                    c.topic, c.schema, c.message_encoding, c.metadata
                )
        self._annotated = {
            n: self._open(n) for n in channels.ANNOTATED if n not in _OPTIONAL
        }
        self._frames = 0
        self._first_frame: int | None = None
        self._link_before = link
        self.gaps = Gaps(scene.info.frame_ns)
        self._link = digest.START
        self._tracks: dict[int, None] = {}
        self._events = 0
        self._last_ns = 0
        self._checkpoints: dict[str, str] = {}
        # What a log says of itself stands at its end.
        self._extras = {} if scene.grows else self._copy_extras()

    def _open(self, name: str) -> int:
        topic = channels.topic(self._scene.camera, name)
        return self._log.channel(
            topic, channels.schema(name), channels.message_encoding(name), {}
        )

    def _copied_attachments(self) -> Iterator[Attachment]:
        """Pass the recording's attachments through; they are hashed one by one on their way."""
        for attachment in self._scene.log.attachments():
            if not attachment.name.startswith(f"{checkpoint.PREFIX}/"):
                self._log.attach(
                    attachment.name,
                    attachment.media_type,
                    attachment.data,
                    attachment.log_time_ns,
                    attachment.create_time_ns,
                )
                yield attachment

    def _copy_extras(self) -> dict[str, str]:
        """Pass attachments and metadata of the recording through; their digests."""
        if self._options.annotations_only:
            return {}
        records = []
        for name, values in self._scene.log.metadata():
            if name != METADATA:
                records.append((name, values))
            elif "tracker" not in values:
                records.append((RECORDING_METADATA, values))
        digests = extras(self._copied_attachments(), records)
        for name, values in records:
            self._log.metadata(name, values)
        return digests

    def _within(self, time_ns: int) -> bool:
        first, end = self._options.from_ns, self._options.to_ns
        return (first is None or time_ns >= first) and (end is None or time_ns < end)

    def is_past(self, annotated: Annotated) -> bool:
        """Whether nothing of what follows this frame can lie in the span."""
        return (
            self._options.to_ns is not None
            and annotated.frame.time_ns >= self._options.to_ns
        )

    def carry(self) -> None:
        """Write what was recorded before the span and still holds in it, so that the log stands
        alone: regions, calibrations, the packets since a video's last key frame.
        """
        if self._options.annotations_only or self._options.from_ns is None:
            return
        scene, span = self._scene, Span(self._options.from_ns, self._options.to_ns)
        found = carried(scene.log, [c.topic for c in scene.recorded], span)
        if scene.regions is not None:
            first_ns = next(scene.frame_times())
            own = scene.regions_message(first_ns)
            found = [m for m in found if m.topic != own.topic]
            found += [own] if first_ns < self._options.from_ns else []
        for message in sorted(found, key=lambda m: m.order):
            self._copy(message)

    def copy(self, messages: Iterable[Message]) -> None:
        """Pass recorded messages of the span through as they are."""
        if self._options.annotations_only:
            return
        for message in messages:
            if self._within(message.log_time_ns):
                self._copy(message)

    def _copy(self, message: Message) -> None:
        self._log.write(
            self._recorded[message.channel.id],
            message.data,
            message.log_time_ns,
            message.publish_time_ns,
            message.sequence,
        )

    def write(self, annotated: Annotated) -> None:
        """Write one frame: what was recorded, then what was found."""
        frame = annotated.frame
        self.copy(frame.messages)
        if not self._within(frame.time_ns):
            if self._first_frame is None:
                self._link_before = annotated.digest.link
            return
        if self._first_frame is None:
            self._first_frame = frame.index
        for name, payload in [
            *annotated.payloads,
            ("digest", channels.encode("digest", annotated.digest)),
        ]:
            if name not in self._annotated:
                self._annotated[name] = self._open(name)
            # The frame's number, so that a span's messages are those of the whole.
            self._log.write(
                self._annotated[name], payload, frame.time_ns, frame.time_ns, frame.index
            )
        self._link = annotated.digest.link
        self._last_ns = frame.time_ns
        self._frames += 1
        self._tracks.update(dict.fromkeys(annotated.track_ids))
        self._events += annotated.events

    def keep(self, found: Checkpoint) -> None:
        """Attach a checkpoint."""
        data = checkpoint.encode(found)
        self._log.attach(
            checkpoint.name(found.frame), checkpoint.MEDIA_TYPE, data, found.time_ns
        )
        self._checkpoints[checkpoint.name(found.frame)] = sha256(data)

    def finish(self, run: Run) -> ReplaySummary:
        """Write what the log says of itself."""
        options = self._options
        scene = self._scene
        if scene.grows:
            self._extras = self._copy_extras()
            if not scene.ended:
                options = replace(options, to_ns=self._last_ns + 1)
        facts = {
            "format_version": FORMAT_VERSION,
            "kind": KIND,
            "tracker": options.choice.name,
            "camera": self._scene.camera,
            "width": str(self._scene.info.width),
            "height": str(self._scene.info.height),
            "configuration": canonical(as_plain(options.parameters)),
            "packages": canonical(package_versions()),
            "python": python_version(),
            "machine": machine(),
            "opencv_build": opencv_build(),
            "scene": utf8(self._scene.path.name),
            "input_digest": run.input_link,
            "input_frames": str(run.last_index + 1),
            "output_digest": self._link,
            "link_before": self._link_before,
            "first_frame": str(-1 if self._first_frame is None else self._first_frame),
            "frames": str(self._frames),
            "annotations_only": str(options.annotations_only).lower(),
            "from_ns": "" if options.from_ns is None else str(options.from_ns),
            "to_ns": "" if options.to_ns is None else str(options.to_ns),
            "checkpoint_ns": ""
            if options.checkpoint_ns is None
            else str(options.checkpoint_ns),
            "checkpoints": canonical(self._checkpoints),
            "extras": canonical(self._extras),
        }
        if options.regions is not None:
            facts["regions"] = canonical(options.regions)
        if options.corrections is not None:
            facts[CORRECTIONS] = options.corrections.text
        if options.choice.version:
            facts["tracker_version"] = options.choice.version
        self._log.metadata(METADATA, with_fact_digests(facts))
        found = sum(frames > 1 for frames in run.sightings.values())
        return ReplaySummary(
            frames=self._frames,
            computed=run.computed,
            tracks=len(self._tracks),
            events=self._events,
            input_digest=run.input_link,
            output_digest=self._link,
            found=found,
            resumed=run.resumed,
            unreadable=tuple(self._scene.unreadable.lines()),
            gaps=tuple(self.gaps.lines()),
            ended=not scene.grows or scene.ended,
        )
