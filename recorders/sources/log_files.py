"""Logs of others as one stream of messages: one file or many, MCAP or ROS bags."""

from __future__ import annotations

import heapq
import weakref
from collections.abc import Collection, Iterator, Sequence
from itertools import chain
from pathlib import Path
from typing import Protocol

import msgspec

from recorders.errors import LimitError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import Attachment, ChannelInfo, LogReader, Message
from recorders.names import by_number
from recorders.sources.unpacking import Unpacker, is_packed, unpacked_message

_MOST_FILES = 4096
_MAGIC = b"\x89MCAP0\r\n"


class LogFiles(Protocol):
    """Messages of one recording, wherever they lie.

    Attributes:
        path: where it was opened.
        name: what it is, in words.
        channels: all of them, by topic.
        start_ns, end_ns: log times of the first and the last message, None without messages.
        losses: what of it is known to be missing.
    """

    path: Path
    name: str
    channels: list[ChannelInfo]
    start_ns: int | None
    end_ns: int | None
    losses: list[str]

    def messages(
        self, topics: Collection[str] | None = None, stored: bool = False
    ) -> Iterator[Message]:
        """The messages of these topics by log time, or in the order in which they are stored."""
        ...

    def attachments(self) -> Iterator[Attachment]:
        """The attachments of all files."""
        ...

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """The metadata records of all files."""
        ...

    def again(self) -> LogFiles:
        """The same recording opened a second time, to be read at another place at once."""
        ...

    def files(self) -> list[Path]:
        """The files that were read."""
        ...

    def close(self) -> None:
        """Release the files."""
        ...


class McapFiles:
    """MCAP files as one recording: by log time, files in the given order where times are equal.

    Files with ``.zstd`` behind their name are unpacked into a temporary folder first; messages that
    were compressed one by one (ROS 2's compression mode MESSAGE) are unpacked as they are read.

    Raises:
        RecordingError: a file cannot be read.
        LimitError: too many files, or one unpacks to too much.
    """

    def __init__(
        self, path: Path, files: Sequence[Path], limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = path
        self.losses: list[str] = []
        self._given = list(files)
        self._limits = limits
        self._unpacker = Unpacker(limits)
        if len(files) > _MOST_FILES:
            raise LimitError(f"{len(files)} files, at most {_MOST_FILES} are read", path)
        self._readers: list[LogReader] = []
        # A source is dropped, not closed: its files are given back with it.
        self._closing = weakref.finalize(self, _close_all, self._readers, self._unpacker)
        try:
            for index, file in enumerate(files):
                self._readers.append(LogReader(self._unpacker.file(file, index), limits))
            self._packed = [_compresses_messages(reader) for reader in self._readers]
        except BaseException:
            self.close()
            raise
        found = {
            (channel.topic, index): channel
            for index, reader in enumerate(self._readers)
            for channel in reader.channels
        }
        self.channels = summed([found[key] for key in sorted(found)])
        profiles = {reader.index.header.profile for reader in self._readers}
        self.name = "ROS 2 bag (MCAP)" if profiles == {"ros2"} else "MCAP log"
        starts = [
            reader.start_ns for reader in self._readers if reader.start_ns is not None
        ]
        ends = [reader.end_ns for reader in self._readers if reader.end_ns is not None]
        self.start_ns = min(starts, default=None)
        self.end_ns = max(ends, default=None)

    def messages(
        self, topics: Collection[str] | None = None, stored: bool = False
    ) -> Iterator[Message]:
        """See `LogFiles`."""
        if stored:
            for reader in self._readers:
                for one in reader.stored(topics):
                    yield self._plain(one)
            return
        # A file is begun when its turn comes: until then it stands for its first message.
        heap: list[tuple[int, int, Message | None]] = [
            (reader.start_ns, number, None)
            for number, reader in enumerate(self._readers)
            if reader.start_ns is not None
        ]
        heapq.heapify(heap)
        running: dict[int, Iterator[Message]] = {}
        while heap:
            _, number, message = heapq.heappop(heap)
            if message is None:
                running[number] = self._readers[number].messages(topics)
            else:
                yield self._plain(message)
            following = next(running[number], None)
            if following is not None:
                heapq.heappush(heap, (following.log_time_ns, number, following))

    def _plain(self, message: Message) -> Message:
        # Neither CDR nor JSON begins as zstd does; of protobuf nobody can tell.
        known = message.channel.message_encoding in ("cdr", "json")
        if not known or not is_packed(message.data):
            return message
        data = unpacked_message(
            message.data, message.topic, message.log_time_ns, self.path, self._limits
        )
        return msgspec.structs.replace(message, data=data)

    def attachments(self) -> Iterator[Attachment]:
        """See `LogFiles`."""
        for reader in self._readers:
            yield from reader.attachments()

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """See `LogFiles`; without the record that says that messages are compressed."""
        return [
            entry
            for reader, packed in zip(self._readers, self._packed, strict=True)
            for entry in reader.metadata()
            if not (packed and entry[0] == "rosbag2")
        ]

    def again(self) -> McapFiles:
        """See `LogFiles`."""
        return McapFiles(self.path, self._given, self._limits)

    def files(self) -> list[Path]:
        """See `LogFiles`."""
        return list(self._given)

    def close(self) -> None:
        """See `LogFiles`."""
        self._closing()


def _close_all(readers: list[LogReader], unpacker: Unpacker) -> None:
    for reader in readers:
        reader.close()
    unpacker.close()


def _compresses_messages(reader: LogReader) -> bool:
    return any(
        name == "rosbag2"
        and "compression_mode: MESSAGE" in values.get("serialized_metadata", "")
        for name, values in reader.metadata()
    )


def summed(channels: list[ChannelInfo]) -> list[ChannelInfo]:
    """Channels of several files as one each: those that differ in nothing but id and count."""
    found: dict[str, ChannelInfo] = {}
    for channel in channels:
        key = repr((channel.topic, channel.schema, channel.message_encoding))
        before = found.get(key)
        if before is None:
            found[key] = channel
            continue
        known = before.message_count is not None and channel.message_count is not None
        total = (
            (before.message_count or 0) + (channel.message_count or 0) if known else None
        )
        found[key] = ChannelInfo(
            channel.topic,
            channel.schema,
            channel.message_encoding,
            before.metadata,
            total,
            before.id,
        )
    return list(found.values())


class SeveralLogs:
    """Logs of different kinds as one recording, by log time; in the given order where times are
    equal.
    """

    def __init__(self, parts: Sequence[LogFiles]) -> None:
        self._parts = list(parts)
        self.path = parts[0].path
        self.name = " and ".join(dict.fromkeys(part.name for part in parts))
        self.channels = summed([c for part in parts for c in part.channels])
        self.losses = [loss for part in parts for loss in part.losses]
        starts = [part.start_ns for part in parts if part.start_ns is not None]
        ends = [part.end_ns for part in parts if part.end_ns is not None]
        self.start_ns = min(starts, default=None)
        self.end_ns = max(ends, default=None)

    def messages(
        self, topics: Collection[str] | None = None, stored: bool = False
    ) -> Iterator[Message]:
        """See `LogFiles`."""
        streams = [part.messages(topics, stored) for part in self._parts]
        if stored:
            return chain.from_iterable(streams)
        return heapq.merge(*streams, key=lambda message: message.log_time_ns)

    def attachments(self) -> Iterator[Attachment]:
        """See `LogFiles`."""
        return chain.from_iterable(part.attachments() for part in self._parts)

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """See `LogFiles`."""
        return [entry for part in self._parts for entry in part.metadata()]

    def again(self) -> SeveralLogs:
        """See `LogFiles`."""
        return SeveralLogs([part.again() for part in self._parts])

    def files(self) -> list[Path]:
        """See `LogFiles`."""
        return [path for part in self._parts for path in part.files()]

    def close(self) -> None:
        """See `LogFiles`."""
        for part in self._parts:
            part.close()


def is_mcap(path: Path) -> bool:
    """Whether a file starts as MCAP does, or bears its name."""
    name = path.name.lower()
    if name.endswith((".mcap", ".mcap.zstd", ".mcap.zst")):
        return True
    try:
        with path.open("rb") as file:
            return file.read(len(_MAGIC)) == _MAGIC
    except OSError:
        return False


def mcap_files(folder: Path) -> list[Path]:
    """The MCAP files in a folder, by the numbers in their names."""
    found = [p for p in folder.iterdir() if p.is_file() and is_mcap(p) and p.name[0] != "."]
    return sorted(found, key=lambda p: by_number(p.name))
