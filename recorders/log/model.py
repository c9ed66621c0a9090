"""What a log holds, as its readers and writers see it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from msgspec import Struct

Order = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Schema:
    """How a channel's payloads are laid out: ``encoding`` names the language that ``data`` is
    written in.
    """

    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    """A channel of a log.

    ``message_count`` is None where the file does not say and was not scanned.
    """

    topic: str
    schema: Schema | None
    message_encoding: str
    metadata: Mapping[str, str] = field(default_factory=dict)
    message_count: int | None = None
    id: int = 0


class Message(Struct, frozen=True):
    """One recorded message.

    Attributes:
        topic: the channel's topic.
        log_time_ns: when it was captured, integer nanoseconds.
        publish_time_ns: when it was published, integer nanoseconds.
        sequence: the channel's own counter, 32 bits.
        data: the payload, undecoded.
        channel: the channel that it came by.
        order: its place in the log's total order: log time, then file position (offset of the
            chunk in the file, offset of the message in the chunk). No two messages of a file
            share it.
    """

    topic: str
    log_time_ns: int
    publish_time_ns: int
    sequence: int
    data: bytes
    channel: ChannelInfo
    order: Order


@dataclass(frozen=True, slots=True)
class Attachment:
    """A file kept inside the log."""

    name: str
    media_type: str
    log_time_ns: int
    create_time_ns: int
    data: bytes = field(repr=False)


@dataclass(frozen=True, slots=True)
class LogHeader:
    """What the file says of itself: its profile and the library that wrote it."""

    profile: str
    library: str
