"""ROS bags that are no MCAP: ROS 2's SQLite files and ROS 1's bags, by the library ``rosbags``."""

from __future__ import annotations

import weakref
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import Attachment, ChannelInfo, Message, Schema

EXTRA = "pip install 'scenetrace[ros]'"


class BagFiles:
    """A bag that ``rosbags`` reads: messages by log time.

    Args:
        path: a ROS 1 bag, a ROS 2 ``.db3``, or the folder with ``metadata.yaml``.
        limits: what a message may take.

    Raises:
        SourceError: the library is not installed, or it cannot read the bag.
    """

    def __init__(self, path: Path, limits: Limits = DEFAULT_LIMITS) -> None:
        self.path = path
        self._limits = limits
        try:
            from rosbags.highlevel import AnyReader
            from rosbags.typesys import Stores, get_typestore
        except ImportError:
            raise SourceError(
                f"this is a ROS bag in SQLite or ROS 1's format; `{EXTRA}` reads it", path
            ) from None
        ros1 = path.suffix.lower() == ".bag"
        self.name = "ROS 1 bag" if ros1 else "ROS 2 bag"
        self._encoding = "ros1" if ros1 else "cdr"
        folder = path if ros1 or path.is_dir() else path.parent
        self._files = [path] if ros1 else sorted(folder.glob("*.db3*"))
        try:
            self._reader: Any = AnyReader(
                [folder], default_typestore=get_typestore(Stores.ROS2_HUMBLE)
            )
            self._reader.open()
        except Exception as error:  # whatever the library meets in a damaged bag
            raise SourceError(f"not a bag that can be read ({error})", path) from error
        self._connections = {
            id(connection): self._channel(connection)
            for connection in self._reader.connections
        }
        self.channels = sorted(self._connections.values(), key=lambda c: (c.topic, c.id))
        # A source is dropped, not closed: its files are given back with it.
        self._closing = weakref.finalize(self, self._reader.close)
        filled = self._reader.message_count > 0
        self.start_ns: int | None = max(0, self._reader.start_time) if filled else None
        self.end_ns: int | None = max(0, self._reader.end_time) if filled else None

    def _channel(self, connection: Any) -> ChannelInfo:
        definition, _ = self._reader.typestore.generate_msgdef(
            connection.msgtype, ros_version=1 if self._encoding == "ros1" else 2
        )
        language = "ros1msg" if self._encoding == "ros1" else "ros2msg"
        return ChannelInfo(
            connection.topic,
            Schema(connection.msgtype, language, definition.encode()),
            self._encoding,
            {},
            connection.msgcount,
            connection.id,
        )

    def messages(
        self,
        topics: Collection[str] | None = None,
        stored: bool = False,  # noqa: ARG002 (the library reads by time alone)
    ) -> Iterator[Message]:
        """See `recorders.sources.log_files.LogFiles`."""
        wanted = [
            connection
            for connection in self._reader.connections
            if topics is None or connection.topic in topics
        ]
        if not wanted:
            return
        counts: dict[int, int] = {}
        try:
            for number, (connection, time_ns, data) in enumerate(
                self._reader.messages(connections=wanted)
            ):
                channel = self._connections[id(connection)]
                if len(data) > self._limits.max_message_bytes:
                    limit = self._limits.max_message_bytes
                    raise LimitError(
                        f"a message of {len(data)} bytes at {time_ns} ns, over the limit of"
                        f" {limit} (max_message_bytes)",
                        self.path,
                        record=channel.topic,
                    )
                sequence = counts[channel.id] = counts.get(channel.id, -1) + 1
                now = max(0, time_ns)
                yield Message(
                    channel.topic,
                    now,
                    now,
                    sequence,
                    bytes(data),
                    channel,
                    (now, 0, number),
                )
        except LimitError:
            raise
        except Exception as error:  # whatever the library meets in a damaged bag
            raise SourceError(f"the bag cannot be read on ({error})", self.path) from error

    def attachments(self) -> Iterator[Attachment]:
        """None: these bags have no attachments."""
        return iter(())

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """None: what ``metadata.yaml`` says is of files that are not passed on."""
        return []

    def again(self) -> BagFiles:
        """See `recorders.sources.log_files.LogFiles`."""
        return BagFiles(self.path, self._limits)

    def files(self) -> list[Path]:
        """See `recorders.sources.log_files.LogFiles`."""
        return list(self._files)

    def close(self) -> None:
        """Release the files."""
        self._closing()
