"""ROS bags that are no MCAP: ROS 2's SQLite files and ROS 1's bags, by the library ``rosbags``."""

from __future__ import annotations

import heapq
import re
import weakref
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import Attachment, ChannelInfo, Message, Schema
from recorders.names import by_number
from recorders.payloads.ros_known import known_definition
from recorders.sources.log_files import summed
from recorders.sources.unpacking import PACKED, Unpacker, is_packed, unpacked_message

EXTRA = "pip install 'scenetrace[ros]'"
METADATA = "metadata.yaml"
"""What a bag folder of ROS 2 says of its files."""
_SQLITE = ".db3"
_ROS1 = (".bag", ".active")
_MOST_METADATA = 1 << 22
_LISTED = re.compile(r"relative_file_paths:\s*\n((?:\s*-[^\n]*\n?)+)")
_ITEM = re.compile(r"^\s*-\s*[\"']?([^\"'\n]+?)[\"']?\s*$", re.MULTILINE)


class BagFiles:
    """Bag files that ``rosbags`` reads: messages by log time, files in the given order where times
    are equal.

    The files are read as they are; ``metadata.yaml`` is not needed, nor believed.

    Args:
        path: where they were found, for messages.
        files: ROS 1 bags, ROS 2's ``.db3`` or ``.db3.zstd``.
        limits: what a message may take.

    Raises:
        SourceError: the library is not installed, or it cannot read a file.
    """

    def __init__(
        self, path: Path, files: Sequence[Path], limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = path
        self._files = list(files)
        self._limits = limits
        self._unpacker = Unpacker(limits)
        self._readers: list[Any] = []
        # A source is dropped, not closed: its files are given back with it.
        self._closing = weakref.finalize(self, _close_all, self._readers, self._unpacker)
        self.losses = [loss for file in files for loss in _beside(file)]
        try:
            for number, file in enumerate(files):
                self._readers.append(_opened(self._unpacker.file(file, number), file))
        except BaseException:
            self.close()
            raise
        self.name = " and ".join(
            dict.fromkeys("ROS 1 bag" if _is_ros1(f) else "ROS 2 bag" for f in files)
        )
        self._channels: dict[tuple[int, int], ChannelInfo] = {}
        for number, reader in enumerate(self._readers):
            for one in reader.connections:
                key = number, one.id
                self._channels[key] = _channel(one, len(self._channels), self._readers)
        by_topic = sorted(self._channels.values(), key=lambda c: (c.topic, c.id))
        self.channels = summed(by_topic)
        filled = [reader for reader in self._readers if reader.message_count > 0]
        self.start_ns = min((max(0, r.start_time) for r in filled), default=None)
        # The library's end lies behind the last message.
        self.end_ns = max((max(0, r.end_time - 1) for r in filled), default=None)

    def messages(
        self,
        topics: Collection[str] | None = None,
        stored: bool = False,  # noqa: ARG002 (the library reads by time alone)
    ) -> Iterator[Message]:
        """See `recorders.sources.log_files.LogFiles`."""
        streams = [self._of(number, topics) for number in range(len(self._readers))]
        counts: dict[int, int] = {}
        merged = heapq.merge(*streams, key=lambda entry: entry[1])
        for number, (channel, time_ns, data) in enumerate(merged):
            sequence = counts[channel.id] = counts.get(channel.id, -1) + 1
            yield Message(
                channel.topic,
                time_ns,
                time_ns,
                sequence,
                data,
                channel,
                (time_ns, 0, number),
            )

    def _of(
        self, number: int, topics: Collection[str] | None
    ) -> Iterator[tuple[ChannelInfo, int, bytes]]:
        """Channel, time and payload of the messages of one file."""
        reader, file = self._readers[number], self._files[number]
        wanted = [c for c in reader.connections if topics is None or c.topic in topics]
        if not wanted:
            return
        try:
            for connection, time_ns, data in reader.messages(connections=wanted):
                channel = self._channels[number, connection.id]
                now = max(0, time_ns)
                yield channel, now, self._payload(bytes(data), channel, now)
        except (LimitError, SourceError):
            raise
        except Exception as error:  # whatever the library meets in a damaged bag
            raise SourceError(
                f"the bag cannot be read on ({_reason(error)}); {_advice(file)}", file
            ) from error

    def _payload(self, data: bytes, channel: ChannelInfo, time_ns: int) -> bytes:
        limit = self._limits.max_message_bytes
        if len(data) > limit:
            raise LimitError(
                f"a message of {len(data)} bytes at {time_ns} ns, over the limit of {limit}"
                " (max_message_bytes)",
                self.path,
                record=channel.topic,
            )
        if channel.message_encoding == "cdr" and is_packed(data):
            return unpacked_message(data, channel.topic, time_ns, self.path, self._limits)
        return data

    def attachments(self) -> Iterator[Attachment]:
        """None: these bags have no attachments."""
        return iter(())

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """None: what ``metadata.yaml`` says is of files that are not passed on."""
        return []

    def again(self) -> BagFiles:
        """See `recorders.sources.log_files.LogFiles`."""
        return BagFiles(self.path, self._files, self._limits)

    def files(self) -> list[Path]:
        """See `recorders.sources.log_files.LogFiles`."""
        return list(self._files)

    def close(self) -> None:
        """Release the files."""
        self._closing()


def _close_all(readers: list[Any], unpacker: Unpacker) -> None:
    for reader in readers:
        reader.close()
    unpacker.close()


def _opened(path: Path, given: Path) -> Any:
    """The library's reader of a file."""
    try:
        from rosbags.rosbag1 import Reader as Reader1
        from rosbags.rosbag2 import Reader as Reader2
    except ImportError:
        raise SourceError(
            f"this is a ROS bag in SQLite or ROS 1's format; `{EXTRA}` reads it", given
        ) from None
    try:
        reader: Any = Reader1(path) if _is_ros1(given) else Reader2(path)
        reader.open()
    except Exception as error:  # whatever the library meets in a damaged bag
        raise SourceError(
            f"not a bag that can be read ({_reason(error)}); {_advice(given)}", given
        ) from error
    return reader


def _reason(error: Exception) -> str:
    return str(error).splitlines()[0][:200] if str(error) else type(error).__name__


def _advice(path: Path) -> str:
    if _is_ros1(path):
        return "`rosbag reindex` writes the index of a bag anew that was not closed"
    return f"`sqlite3 {path.name} .recover | sqlite3 whole.db3` saves what is there"


def _beside(path: Path) -> list[str]:
    """What lies beside a file and is missing in it."""
    waiting = path.with_name(f"{path.name}-wal")
    if path.suffix != _SQLITE or not waiting.exists() or not waiting.stat().st_size:
        return []
    return [
        f"{waiting.name} holds messages that its recorder did not bring into the bag;"
        f" `sqlite3 {path.name} 'PRAGMA wal_checkpoint(TRUNCATE)'` does it"
    ]


def _channel(connection: Any, identity: int, readers: Sequence[Any]) -> ChannelInfo:
    ros1 = not hasattr(connection.ext, "serialization_format")
    return ChannelInfo(
        connection.topic,
        _schema(connection, ros1, readers),
        "ros1" if ros1 else connection.ext.serialization_format,
        _said_of(connection.ext, ros1),
        connection.msgcount,
        identity,
    )


def _schema(connection: Any, ros1: bool, readers: Sequence[Any]) -> Schema:
    """The bag's own definition, one of another file of it, or one that is known."""
    name = connection.msgtype
    for one in (connection, *(c for reader in readers for c in reader.connections)):
        if one.msgtype == name and one.msgdef.data:
            idl = one.msgdef.format.name == "IDL"
            language = "ros1msg" if ros1 else "ros2idl" if idl else "ros2msg"
            return Schema(name, language, one.msgdef.data.encode())
    text = known_definition(name) or _of_the_library(name)
    return Schema(name, "ros2msg" if text else "", text.encode())


def _of_the_library(name: str) -> str:
    """Bags before ROS 2 Iron hold no definitions: those that Humble had."""
    from rosbags.typesys import Stores, get_typestore

    try:
        return str(
            get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(name, ros_version=2)[0]
        )
    except Exception:  # a type of somebody's own: it is passed on without a definition
        return ""


def _said_of(ext: Any, ros1: bool) -> dict[str, str]:
    """What a channel says of itself, as in bags that are MCAP."""
    if ros1:
        said = {"callerid": ext.callerid, "latching": ext.latching}
        return {name: str(value) for name, value in said.items() if value is not None}
    if not ext.offered_qos_profiles:
        return {}
    from rosbags.rosbag2.metadata import dump_qos_v8

    return {"offered_qos_profiles": dump_qos_v8(ext.offered_qos_profiles)}


def _is_ros1(path: Path) -> bool:
    return path.suffix.lower() in _ROS1


def is_bag(path: Path) -> bool:
    """Whether a file is a bag that is no MCAP, by its name."""
    name = path.name.lower()
    plain = name.removesuffix(next((end for end in PACKED if name.endswith(end)), ""))
    return plain.endswith(_SQLITE) or name.endswith((".bag", ".bag.active"))


def missing_files(path: Path) -> list[str]:
    """What a bag folder's ``metadata.yaml`` names and is not there, in a line."""
    folder = path if path.is_dir() else path.parent
    if not (path.is_dir() or path.name == METADATA) or not (folder / METADATA).is_file():
        return []
    text = (folder / METADATA).read_bytes()[:_MOST_METADATA].decode("utf-8", "replace")
    listed = _LISTED.search(text)
    names = [] if listed is None else _ITEM.findall(listed[1])
    gone = [Path(n).name for n in names if not _is_there(folder / Path(n).name)]
    if not gone:
        return []
    more = f" and {len(gone) - 3} more" if len(gone) > 3 else ""
    return [f"{METADATA} names files that are not there: {', '.join(gone[:3])}{more}"]


def _is_there(path: Path) -> bool:
    """Also where the file was packed or unpacked since."""
    names = [path.name, *(path.name + end for end in PACKED)]
    if path.suffix in PACKED:
        names.append(path.stem)
    return any(path.with_name(name).exists() for name in names)


def bag_files(folder: Path) -> list[Path]:
    """The bags in a folder that are no MCAP, by the numbers in their names."""
    found = [p for p in folder.iterdir() if p.is_file() and is_bag(p) and p.name[0] != "."]
    return sorted(found, key=lambda p: by_number(p.name))
