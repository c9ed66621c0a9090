"""Pieces of logs that stand alone: a span, some topics, several logs as one.

A piece begins with what was said before it and still holds (regions, calibrations, fixed
transforms, ROS topics that are latched) and with the packets of a video since its last key frame,
all with their own times. Messages pass byte for byte; what is written is in order of log time.

An annotated log's digests stay true in a piece that lacks nothing but time, or the whole
recording; in any other they are taken out, and that is said.
"""

from __future__ import annotations

import fnmatch
from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from heapq import merge as in_order
from pathlib import Path

from recorders import channels
from recorders.annotated.checkpoint import PREFIX
from recorders.annotated.frames import annotated_cameras
from recorders.annotated.provenance import (
    DIGESTS,
    METADATA,
    canonical,
    with_fact_digests,
)
from recorders.errors import UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import ChannelInfo, LogReader, LogWriter, Message
from recorders.log.recovery import PICTURE_SCHEMAS
from recorders.messages import Digest
from recorders.scene_pictures import check_group, is_video, starts_group

_LATCHED = (
    "scenetrace.Regions",
    "foxglove.CameraCalibration",
    "sensor_msgs/msg/CameraInfo",
    "sensor_msgs/CameraInfo",
)
_TRANSIENT = ("durability: 1", "durability: transient_local")
"""How a ROS 2 bag says, in a channel's metadata, that late listeners get the last message."""
_KEPT_FACTS = (
    "format_version", "tracker", "camera", "width", "height", "configuration", "packages", "scene"
)  # fmt: skip
"""What a log without its digests still says of its making."""


@dataclass(frozen=True)
class Span:
    """What of a log is wanted.

    Attributes:
        from_ns: the first log time, None: the beginning.
        to_ns: the end, excluded, None: the end.
        topics: patterns of the topics that are kept (``*`` stands for anything), None: all.
        exclude: patterns of topics that are not kept.
    """

    from_ns: int | None = None
    to_ns: int | None = None
    topics: Sequence[str] | None = None
    exclude: Sequence[str] = ()

    def keeps(self, topic: str) -> bool:
        """Whether a topic is wanted."""
        kept = self.topics is None or any(
            fnmatch.fnmatchcase(topic, piece) for piece in self.topics
        )
        return kept and not any(fnmatch.fnmatchcase(topic, piece) for piece in self.exclude)

    def holds(self, time_ns: int) -> bool:
        """Whether a log time lies in the span."""
        return (self.from_ns is None or time_ns >= self.from_ns) and (
            self.to_ns is None or time_ns < self.to_ns
        )


@dataclass
class PieceReport:
    """What a piece holds.

    Attributes:
        messages: all of them.
        carried: those from before the span.
        notes: what a reader should know: digests that are gone, videos that begin undecodable.
    """

    messages: int = 0
    carried: int = 0
    notes: list[str] = field(default_factory=list)


def cut(
    path: str | Path,
    out: str | Path,
    span: Span,
    *,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> PieceReport:
    """Write a piece of a log.

    Raises:
        RecordingError: the log is damaged.
        UsageError: nothing lies in the span, or no topic is wanted.
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    report = PieceReport()
    with LogReader(path, limits) as log:
        kept = [channel for channel in log.channels if span.keeps(channel.topic)]
        if not kept:
            raise UsageError(
                f"{path}: none of its topics is wanted; it has {', '.join(log.topics())}"
            )
        if span.from_ns is None and span.to_ns is None and len(kept) == len(log.channels):
            keeps_digests = True
        else:
            keeps_digests = _lacks_only_what_may(log, kept)
        if not keeps_digests and _facts(log) is not None:
            kept = [
                channel for channel in kept if channels.split(channel.topic)[1] != "digest"
            ]
            report.notes.append(
                "its digests are taken out, because they are those of more topics: `verify`"
                " needs the whole log"
            )
        topics = [channel.topic for channel in kept]
        before = list(carried(log, topics, span, report.notes))
        with LogWriter(
            out, force=force, limits=limits, profile=log.header.profile
        ) as writer:
            copy = _Copy(writer, kept)
            _copy_attachments(log, writer, without_checkpoints=span != Span())
            for message in before:
                copy.write(message)
            links = _Links(kept)
            for message in log.messages(topics, span.from_ns, span.to_ns):
                copy.write(message)
                links.see(message)
            report.carried, report.messages = len(before), copy.count
            if copy.count == len(before):
                raise UsageError(f"{path}: holds none of these topics in this span")
            _copy_metadata(log, writer, span, links, keeps_digests=keeps_digests)
    return report


def merge(
    paths: Sequence[str | Path],
    out: str | Path,
    *,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> PieceReport:
    """Write several logs as one, in order of log time; one log alone is sorted.

    Messages of one time come in the order of the logs. Attachments and metadata records of all
    of them are kept.

    Raises:
        RecordingError: a log is damaged.
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    report = PieceReport()
    with ExitStack() as stack:
        logs = [stack.enter_context(LogReader(path, limits)) for path in paths]
        alone = len(logs) == 1
        profiles = list(dict.fromkeys(log.header.profile for log in logs))
        kept = [log.channels for log in logs]
        if not alone:
            kept = [
                [
                    channel
                    for channel in log.channels
                    if channels.split(channel.topic)[1] != "digest"
                ]
                if _facts(log) is not None
                else log.channels
                for log in logs
            ]
            report.notes += _merged_notes(logs)
        writer = stack.enter_context(
            LogWriter(
                out,
                force=force,
                limits=limits,
                profile=profiles[0] if len(profiles) == 1 else "",
            )
        )
        copies: list[_Copy] = []
        known: dict[str, int] = {}
        for log, wanted in zip(logs, kept, strict=True):
            copies.append(_Copy(writer, wanted, known))
            _copy_attachments(log, writer, without_checkpoints=not alone)
        streams = [
            _numbered(log.messages([channel.topic for channel in wanted]), number)
            for number, (log, wanted) in enumerate(zip(logs, kept, strict=True))
        ]
        for time_and_number, message in in_order(*streams, key=lambda pair: pair[0]):
            copies[time_and_number[1]].write(message)
        report.messages = sum(copy.count for copy in copies)
        for log in logs:
            _copy_metadata(log, writer, Span(), _Links([]), keeps_digests=alone)
    return report


def _numbered(
    messages: Iterable[Message], number: int
) -> Iterator[tuple[tuple[int, int], Message]]:
    for message in messages:
        yield (message.log_time_ns, number), message


def carried(
    log: LogReader, topics: Collection[str], span: Span, notes: list[str] | None = None
) -> list[Message]:
    """What was said before a span and still holds in it, in order: the last message of topics
    that are latched, all fixed transforms, and the packets of a video that its first picture
    needs.

    Args:
        log: the whole log.
        topics: the topics that are wanted.
        span: which part.
        notes: gets a line for each video that cannot be decoded from the span's start on.

    Raises:
        LimitError: a video has no key frame for longer than the limits allow.
    """
    if span.from_ns is None or span.from_ns <= 0:
        return []
    found: list[Message] = []
    for channel in log.channels:
        topic = channel.topic
        if topic not in topics:
            continue
        if topic.endswith("/tf_static"):
            found += (
                message
                for message in log.messages([topic], end_ns=span.from_ns)
                if message.channel == channel
            )
        elif _is_latched(channel):
            last = log.latched(topic, span.from_ns - 1)
            found += [last] if last is not None and last.channel == channel else []
        elif channel.schema is not None and channel.schema.name.endswith(
            ("CompressedVideo", "FFMPEGPacket")
        ):
            found += _group_before(log, topic, span, [] if notes is None else notes)
    return sorted(found, key=lambda m: m.order)


def _is_latched(channel: ChannelInfo) -> bool:
    if channel.schema is not None and channel.schema.name in _LATCHED:
        return True
    quality = channel.metadata.get("offered_qos_profiles", "")
    return channel.metadata.get("latching") == "1" or any(x in quality for x in _TRANSIENT)


def _group_before(
    log: LogReader, topic: str, span: Span, notes: list[str]
) -> list[Message]:
    """The packets since the last key frame before the span."""
    first = next(log.messages([topic], span.from_ns, span.to_ns), None)
    if first is None or not is_video(first) or starts_group(first):
        return []
    found: list[Message] = []
    held = 0
    for message in log.messages([topic], end_ns=span.from_ns, reverse=True):
        found.append(message)
        held += len(message.data)
        check_group(held, log.limits, message, log.path)
        if starts_group(message):
            return found
    notes.append(f"{topic}: there is no key frame before the span: it begins undecodable")
    return []


class _Copy:
    """Messages of one log on their way into another. Channels that are the same become one."""

    def __init__(
        self,
        writer: LogWriter,
        wanted: Iterable[ChannelInfo],
        known: dict[str, int] | None = None,
    ) -> None:
        known = {} if known is None else known
        self._writer = writer
        self._ids: dict[int, int] = {}
        self.count = 0
        for c in wanted:
            facts = sorted(c.metadata.items())
            key = repr((c.topic, c.schema, c.message_encoding, facts))
            if key not in known:
                picture = c.schema is not None and c.schema.name in PICTURE_SCHEMAS
                known[key] = writer.channel(
                    c.topic, c.schema, c.message_encoding, c.metadata, picture=picture
                )
            self._ids[c.id] = known[key]

    def write(self, message: Message) -> None:
        if message.channel.id not in self._ids:
            return
        self._writer.write(
            self._ids[message.channel.id],
            message.data,
            message.log_time_ns,
            message.publish_time_ns,
            message.sequence,
        )
        self.count += 1


class _Links:
    """The digest chain's part that is in a piece."""

    def __init__(self, kept: Iterable[ChannelInfo]) -> None:
        self._topics = {
            channel.topic
            for channel in kept
            if channels.split(channel.topic)[1] == "digest"
        }
        self.first_frame = -1
        self.frames = 0
        self.last = ""

    def see(self, message: Message) -> None:
        if message.topic in self._topics:
            found: Digest = channels.decode("digest", message.data)
            self.first_frame = found.frame if not self.frames else self.first_frame
            self.frames += 1
            self.last = found.link


def _facts(log: LogReader) -> dict[str, str] | None:
    """What an annotated log with digests says of its making; None of any other log."""
    if not any(channels.split(channel.topic)[1] == "digest" for channel in log.channels):
        return None
    for name, values in log.metadata():
        if name == METADATA and DIGESTS in values and "camera" in values:
            return values
    return None


def _lacks_only_what_may(log: LogReader, kept: Collection[ChannelInfo]) -> bool:
    """Whether the digests stay true: everything annotated is there, and all or nothing of what
    was recorded.
    """
    facts = _facts(log)
    if facts is None or len(annotated_cameras(log)) != 1:
        return False
    ids = {channel.id for channel in kept}
    annotated = {
        channel.id
        for channel in log.channels
        if channels.split(channel.topic)[1] in channels.ANNOTATED
    }
    recorded = {channel.id for channel in log.channels} - annotated
    return annotated <= ids and (recorded <= ids or not recorded & ids)


def _copy_attachments(
    log: LogReader, writer: LogWriter, *, without_checkpoints: bool
) -> None:
    for attachment in log.attachments():
        if not (without_checkpoints and attachment.name.startswith(f"{PREFIX}/")):
            writer.attach(
                attachment.name,
                attachment.media_type,
                attachment.data,
                attachment.log_time_ns,
                attachment.create_time_ns,
            )


def _copy_metadata(
    log: LogReader, writer: LogWriter, span: Span, links: _Links, *, keeps_digests: bool
) -> None:
    facts = _facts(log)
    for name, values in log.metadata():
        if name != METADATA or values != facts:
            writer.metadata(name, values)
        elif not keeps_digests:
            kept = {fact: values[fact] for fact in _KEPT_FACTS if fact in values}
            writer.metadata(name, {**kept, "kind": "piece"})
        elif span == Span():
            writer.metadata(name, values)
        else:
            writer.metadata(name, _facts_of_piece(log, values, span, links))


def _facts_of_piece(
    log: LogReader, values: dict[str, str], span: Span, links: _Links
) -> dict[str, str]:
    """What a replay of the span alone would say: frames, span, the chain's ends."""
    facts = {name: value for name, value in values.items() if name != DIGESTS}
    facts |= {"checkpoints": canonical({}), "checkpoint_ns": ""}
    camera = values.get("camera", "")
    recorded = [
        channel.topic
        for channel in log.channels
        if channels.split(channel.topic)[1] not in channels.ANNOTATED
        and span.keeps(channel.topic)
    ]
    if not recorded:
        facts["annotations_only"] = "true"
    starts = [
        time_ns
        for time_ns in (span.from_ns, _number(values.get("from_ns")))
        if time_ns is not None
    ]
    ends = [
        time_ns
        for time_ns in (span.to_ns, _number(values.get("to_ns")))
        if time_ns is not None
    ]
    facts["from_ns"] = str(max(starts)) if starts else ""
    facts["to_ns"] = str(min(ends)) if ends else ""
    if span.from_ns is not None:
        topic = channels.topic(camera, "digest")
        before = log.latched(topic, span.from_ns - 1) if span.from_ns else None
        if before is not None:
            facts["link_before"] = channels.decode("digest", before.data).link
    facts["first_frame"] = str(links.first_frame)
    facts["frames"] = str(links.frames)
    facts["output_digest"] = links.last or "0" * 64
    return with_fact_digests(facts)


def _number(text: str | None) -> int | None:
    return int(text) if text else None


def _merged_notes(logs: Sequence[LogReader]) -> list[str]:
    notes = []
    if any(_facts(log) is not None for log in logs):
        notes.append(
            "the digests of annotated logs are taken out: they are those of one log alone"
        )
    seen: dict[str, LogReader] = {}
    for log in logs:
        for topic in log.topics():
            other = seen.setdefault(topic, log)
            if other is log or channels.split(topic)[1] != "detections":
                continue
            if _overlap(other, log):
                notes.append(
                    f"{topic} of {other.path.name} and {log.path.name} lie in the same time:"
                    " a replay takes them for one camera; record them under names of their"
                    " own (--camera)"
                )
    return notes


def _overlap(a: LogReader, b: LogReader) -> bool:
    ends = (a.start_ns, a.end_ns, b.start_ns, b.end_ns)
    if None in ends:
        return False
    return a.start_ns <= b.end_ns and b.start_ns <= a.end_ns  # type: ignore[operator]
