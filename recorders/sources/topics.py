"""Which topics of a log are the camera's pictures and its detections: the only ones, or asked for."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

from recorders import channels
from recorders.errors import SceneTraceError, SourceError, UsageError
from recorders.log import ChannelInfo
from recorders.payloads import (
    DETECTIONS,
    PICTURES,
    PayloadError,
    RawPicture,
    Still,
    payload_kind,
    read_picture,
)
from recorders.sources.log_files import LogFiles
from recorders.stills import still_header

_OURS = frozenset({"foreground", "membership", "annotations"})
_MOST_LISTED = 12
_LONGEST = 60


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of one camera; None where there is none."""

    image: str | None
    detections: str | None


def choose_topics(
    log: LogFiles, image: str | None = None, detections: str | None = None
) -> Topics:
    """The topics of pictures and of detections: those that are named, else the only ones.

    Raises:
        UsageError: a named topic is not there, or holds something else; or there are several to
            choose from: they are listed with type, size and rate.
        SourceError: there is nothing to record.
    """
    pictures = _candidates(log, PICTURES, image, "--image-topic")
    found = _candidates(log, DETECTIONS, detections, "--detections-topic")
    if not pictures and not found:
        raise SourceError(
            "no pictures and no detections of a kind that can be read; it holds"
            f" {_listed_shortly(log.channels)}",
            log.path,
        )
    chosen = _only(log, pictures, "pictures", "--image-topic")
    if chosen is not None and len(found) > 1:
        # Topics of one camera stand under one name: /front/image, /front/detections.
        beside = [c for c in found if _space(c.topic) == _space(chosen) != "/"]
        found = beside if len({c.topic for c in beside}) == 1 else found
    return Topics(chosen, _only(log, found, "detections", "--detections-topic"))


def _space(topic: str) -> str:
    return topic.rsplit("/", 1)[0] + "/"


def _candidates(
    log: LogFiles, kinds: Collection[str], named: str | None, option: str
) -> list[ChannelInfo]:
    if named is None:
        return [
            channel
            for channel in log.channels
            if payload_kind(channel) in kinds
            and channel.message_count != 0
            and channels.split(channel.topic)[1] not in _OURS
        ]
    if named == "none":
        return []
    there = [channel for channel in log.channels if channel.topic == named]
    if not there:
        offered = [
            channel for channel in log.channels if payload_kind(channel) in kinds
        ] or log.channels
        raise UsageError(
            f"{option} {named}: {log.path} has no such topic; it has"
            f" {_listed_shortly(offered)}"
        )
    kind = payload_kind(there[0])
    if kind not in kinds:
        raise UsageError(
            f"{option} {named}: messages of {kind or 'no schema'}; wanted one of"
            f" {', '.join(sorted(kinds))}"
        )
    return there[:1]


def _only(log: LogFiles, found: list[ChannelInfo], what: str, option: str) -> str | None:
    topics = sorted({c.topic for c in found})
    if len(topics) < 2:
        return topics[0] if topics else None
    raise UsageError(
        f"{log.path}: {len(topics)} topics of {what}; choose one with {option}",
        *[f"  {line}" for line in describe(log, found[:_MOST_LISTED])],
    )


def describe(log: LogFiles, found: Collection[ChannelInfo]) -> list[str]:
    """A line for each channel: topic, type, picture size, number and rate of its messages."""
    lines = []
    span_s = ((log.end_ns or 0) - (log.start_ns or 0)) / 1e9
    for c in found:
        count = c.message_count
        rate = ""
        if count and span_s > 0:
            rate = f", {(count - 1) / span_s:.3g}/s"
        lines.append(
            f"{c.topic}  {payload_kind(c)} ({c.message_encoding}){_size(log, c)},"
            f" {'?' if count is None else count} messages{rate}"
        )
    return lines


def _size(log: LogFiles, channel: ChannelInfo) -> str:
    if payload_kind(channel) not in PICTURES:
        return ""
    message = next(log.messages([channel.topic]), None)
    if message is None:
        return ""
    try:
        picture = read_picture(message.channel, message.data)
        if isinstance(picture, RawPicture):
            return f", {picture.width}x{picture.height} {picture.encoding}"
        if isinstance(picture, Still):
            header = still_header(picture.data)
            return f", {header.width}x{header.height} {header.format}"
    except (PayloadError, SceneTraceError):
        return ", cannot be decoded"
    return f", {picture.codec}"


def _listed_shortly(found: Collection[ChannelInfo]) -> str:
    listed = list(found)
    names = [
        f"{c.topic[:_LONGEST]} ({payload_kind(c) or 'no schema'})"
        for c in listed[:_MOST_LISTED]
    ]
    more = len(listed) - len(names)
    return (", ".join(names) or "no channels at all") + (
        f" and {more} more" if more > 0 else ""
    )
