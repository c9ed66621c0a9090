"""The one write layer: pictures apart from the small channels, every CRC, the same calls giving
the same bytes.
"""

from __future__ import annotations

import struct
import zlib
from array import array
from collections import deque
from collections.abc import Collection, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from copy import copy
from pathlib import Path
from types import TracebackType
from typing import NoReturn, Self

from recorders.errors import LimitError, RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import records, wire
from recorders.log.compression import KNOWN, compress
from recorders.log.model import Schema
from recorders.log.output import PART_SUFFIX, PartFile
from recorders.log.summary import SummaryBuilder

LIBRARY = "scenetrace"
PROFILE = ""
CHUNK_BYTES = 4 << 20
FLUSH_INTERVAL_NS = 1_000_000_000
LIVE_FLUSH_NS = 120_000_000
"""A live recording's frames are in the file so soon: who follows it waits for no more."""

_HEAD = wire.MESSAGE_HEAD
_NEVER = 1 << 65
_MOST_PENDING = 1


class _Chunk:
    """A chunk being filled."""

    __slots__ = ("compression", "data", "end_ns", "entries", "start_ns")

    def __init__(self, compression: str) -> None:
        self.compression = compression
        self._begin()

    def _begin(self) -> None:
        self.data = bytearray()
        self.entries: dict[int, array[int]] = {}
        self.start_ns = _NEVER
        self.end_ns = 0

    def taken(self) -> _Chunk:
        """What was filled in, as a chunk of its own; this one begins anew."""
        filled = copy(self)
        self._begin()
        return filled


class _Channel:
    """A channel being written: its topic, its chunk, the sequence number that comes next."""

    __slots__ = ("chunk", "count", "sequence", "topic")

    def __init__(self, topic: str, chunk: _Chunk) -> None:
        self.topic = topic
        self.chunk = chunk
        self.sequence = 0
        self.count = 0


class LogWriter:
    """Writes a log; use it as a context manager: leaving it makes the file appear, an exception
    makes it vanish.

    Two chunks are filled side by side, one for ``picture_topics``, stored as it is, one for
    everything else, stored with ``compression``, so that reading detections never reads pictures.
    Messages of one log time keep their order in what is read back, except that those of picture
    topics come before the others; a chunk ends only where the log time changes (or when it
    reaches four times ``chunk_bytes`` and 1 MiB), so this holds whatever the chunk size.

    A chunk goes to the file when it holds ``chunk_bytes`` or spans ``flush_interval_ns`` of log
    time: what a killed process leaves in ``<path>.part`` lacks no more than that (see
    `recorders.log.recovery`) where ``keep_part`` says that the part counts. Else chunks are
    packed and written by a thread of their own, in order, while the next ones are filled, and
    those on their way are lacking as well.

    Raises:
        OutputExistsError: ``path`` exists and ``force`` was not given.
        RecordingError: the file cannot be written (a full disk, a closed writer), or a value does
            not fit MCAP; what goes wrong with a chunk is raised by one of the next calls, `close`
            at the latest.
        LimitError: more than ``limits`` allows, so that nothing is written that could not be read
            again.
    """

    def __init__(
        self,
        path: str | Path,
        *,
        force: bool = False,
        keep_part: bool = False,
        compression: str = "zstd",
        picture_topics: Collection[str] = (),
        flush_interval_ns: int = FLUSH_INTERVAL_NS,
        chunk_bytes: int = CHUNK_BYTES,
        limits: Limits = DEFAULT_LIMITS,
        profile: str = PROFILE,
        part_suffix: str = PART_SUFFIX,
    ) -> None:
        self.path = Path(path)
        if compression not in KNOWN:
            raise RecordingError(
                f"compression {compression!r} is unknown; known are '', 'lz4' and 'zstd'",
                path,
            )
        self._limits = limits
        self._keep_part = keep_part
        self._picture_topics = frozenset(picture_topics)
        self._flush_interval_ns = flush_interval_ns
        self._chunk_bytes = min(chunk_bytes, limits.max_chunk_bytes // 8)
        self._overfull_bytes = max(4 * self._chunk_bytes, 1 << 20)
        self._max_chunk_bytes = limits.max_chunk_bytes - _HEAD.size
        self._max_message_bytes = min(limits.max_message_bytes, self._max_chunk_bytes)
        # JPEG, PNG and H.264 are compressed already: a second time costs more time than it saves
        # space.
        self._pictures = _Chunk("")
        self._small = _Chunk(compression)
        self._channels: list[_Channel] = []
        self._schemas: dict[Schema, int] = {}
        self._schemas_in: set[tuple[int, int]] = set()
        self._summary = SummaryBuilder()
        self._last_ns = -1
        self._due_ns = _NEVER
        self._offset = 0
        self._crc = 0
        self._file = PartFile(path, force=force, suffix=part_suffix)
        self._storing = ThreadPoolExecutor(max_workers=1, thread_name_prefix="store")
        self._pending: deque[Future[None]] = deque()
        self._cut_off = False
        try:
            self._put(wire.MAGIC)
            self._put_checked(records.encode_header(profile, LIBRARY))
        except BaseException:
            self._file.discard()  # nothing to keep is in it
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self.close()
        else:
            self.abort()

    def channel(
        self,
        topic: str,
        schema: Schema | None,
        message_encoding: str,
        metadata: Mapping[str, str] | None = None,
        *,
        picture: bool | None = None,
    ) -> int:
        """Add a channel and return its id; each call makes a channel of its own, also for a topic
        that exists.

        ``picture`` says whether its messages go with the pictures; None asks ``picture_topics``.
        """
        identity = len(self._channels) + 1
        self._check_limit(identity, "max_channels", "the number of channels", topic)
        if picture is None:
            picture = topic in self._picture_topics
        chunk = self._pictures if picture else self._small
        schema_id = 0
        if schema is not None:
            schema_id = self._schemas.setdefault(schema, len(self._schemas) + 1)
            if (schema_id, id(chunk)) not in self._schemas_in:
                self._schemas_in.add((schema_id, id(chunk)))
                encoded = records.encode_schema(
                    schema_id, schema.name, schema.encoding, schema.data
                )
                self._summary.schemas[schema_id] = encoded
                chunk.data += encoded
        encoded = records.encode_channel(
            identity, schema_id, topic, message_encoding, metadata or {}
        )
        self._summary.channels.append(encoded)
        chunk.data += encoded
        self._channels.append(_Channel(topic, chunk))
        return identity

    def write(
        self,
        channel_id: int,
        data: bytes,
        log_time_ns: int,
        publish_time_ns: int | None = None,
        sequence: int | None = None,
    ) -> None:
        """Add a message; ``publish_time_ns`` defaults to the log time, ``sequence`` to one after
        the channel's last.
        """
        if log_time_ns != self._last_ns:
            self._new_time(log_time_ns)
        try:
            if channel_id < 1:
                raise IndexError
            channel = self._channels[channel_id - 1]
        except IndexError:
            raise RecordingError(
                f"no channel has the id {channel_id!r}", self.path
            ) from None
        if len(data) > self._max_message_bytes:
            self._check_message(len(data), channel.topic)
        number = channel.sequence if sequence is None else sequence
        publish_time = log_time_ns if publish_time_ns is None else publish_time_ns
        length = wire.MESSAGE_FIELDS_BYTES + len(data)
        try:
            head = _HEAD.pack(
                wire.MESSAGE, length, channel_id, number, log_time_ns, publish_time
            )
        except struct.error as error:
            self._bad_numbers(channel.topic, log_time_ns, publish_time, number, error)
        chunk = channel.chunk
        if len(chunk.data) + len(data) > self._max_chunk_bytes:
            self._flush()
        if chunk.start_ns == _NEVER:
            self._due_ns = min(self._due_ns, log_time_ns + self._flush_interval_ns)
        entries = chunk.entries.get(channel_id)
        if entries is None:
            entries = chunk.entries[channel_id] = array("Q")
        buffer = chunk.data
        entries.append(log_time_ns)
        entries.append(len(buffer))
        buffer += head
        buffer += data
        channel.sequence = (number + 1) & 0xFFFFFFFF
        channel.count += 1
        if log_time_ns < chunk.start_ns:  # noqa: PLR1730
            chunk.start_ns = log_time_ns
        if log_time_ns > chunk.end_ns:  # noqa: PLR1730
            chunk.end_ns = log_time_ns
        if len(buffer) > self._overfull_bytes:
            self._flush()

    def attach(
        self,
        name: str,
        media_type: str,
        data: bytes,
        log_time_ns: int = 0,
        create_time_ns: int = 0,
    ) -> None:
        """Keep a file inside the log."""
        self._check_limit(len(data), "max_attachment_bytes", "the attachment's size", name)
        self._settle(0)
        head = records.encode_attachment_head(
            name, media_type, data, log_time_ns, create_time_ns
        )
        crc = records.encode_attachment_crc(head, data)
        entry = records.AttachmentIndexRecord(
            self._offset,
            len(head) + len(data) + len(crc),
            log_time_ns,
            create_time_ns,
            len(data),
            name,
            media_type,
        )
        self._put(head)
        self._put(data)
        self._put(crc)
        self._summary.attachments.append(entry)

    def metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Add a metadata record; its keys are written sorted."""
        encoded = records.encode_metadata(name, values)
        self._settle(0)
        self._summary.metadata.append(
            records.MetadataIndexRecord(self._offset, len(encoded), name)
        )
        self._put_checked(encoded)

    def close(self) -> None:
        """Finish the file: the last chunks, the summary, fsync, rename. Does nothing the second
        time.
        """
        if not self._file.is_open:
            return
        try:
            self._flush()
            self._settle(0)
            data_end = records.encode_data_end(self._crc)
            counts = {
                index: channel.count
                for index, channel in enumerate(self._channels, 1)
                if channel.count
            }
            tail = self._summary.encode(self._offset + len(data_end), counts)
            self._put(data_end)
            self._put(tail)
            self._put(wire.MAGIC)
            self._file.finish()
            self._storing.shutdown()
        except BaseException:
            self.abort()
            raise

    def abort(self) -> None:
        """Give up: remove the part file, or with ``keep_part`` leave in it every chunk that was
        written.
        """
        self._storing.shutdown(cancel_futures=not self._keep_part)
        self._file.discard(keep=self._keep_part)

    def _new_time(self, log_time_ns: int) -> None:
        """Chunks end where the log time changes. The small chunk never overtakes the pictures of
        its time.
        """
        self._last_ns = log_time_ns
        if log_time_ns >= self._due_ns or len(self._small.data) >= self._chunk_bytes:
            self._flush()
        elif len(self._pictures.data) >= self._chunk_bytes:
            self._flush_chunk(self._pictures)

    def _flush(self) -> None:
        self._flush_chunk(self._pictures)
        self._flush_chunk(self._small)
        self._due_ns = _NEVER

    def _flush_chunk(self, chunk: _Chunk) -> None:
        if not chunk.data:
            return
        self._settle(_MOST_PENDING)
        if not self._file.is_open:
            raise RecordingError("is closed already", self.path)
        if self._keep_part:
            self._store(chunk.taken())
        else:
            self._pending.append(self._storing.submit(self._store, chunk.taken()))

    def _settle(self, most: int) -> None:
        """Wait until no more than so many chunks are on their way; raises what went wrong with
        one.
        """
        while len(self._pending) > most:
            self._pending.popleft().result()

    def _store(self, chunk: _Chunk) -> None:
        """Pack a chunk and write it; nothing goes behind one that was cut off."""
        if self._cut_off:
            return
        self._cut_off = True
        start, end = (chunk.start_ns, chunk.end_ns) if chunk.entries else (0, 0)
        packed = compress(chunk.compression, chunk.data)
        head = records.encode_chunk_head(
            start, end, chunk.data, chunk.compression, len(packed)
        )
        offset, length = self._offset, len(head) + len(packed)
        indexes: list[bytes] = []
        places: dict[int, int] = {}
        position = offset + length
        for identity in sorted(chunk.entries):
            entries = chunk.entries[identity]
            places[identity] = position
            indexes.append(records.encode_message_index(identity, entries))
            position += len(indexes[-1])
        index_length = sum(len(index) for index in indexes)
        entry = records.ChunkIndexRecord(
            start,
            end_ns=end,
            offset=offset,
            length=length,
            offsets=records.packed_offsets(places),
            message_index_length=index_length,
            compression=chunk.compression,
            compressed_size=len(packed),
            uncompressed_size=len(chunk.data),
        )
        for piece in (head, packed, b"".join(indexes)):
            self._put(piece)
        self._summary.add_chunk(entry)
        self._cut_off = False

    def _put(self, data: bytes | bytearray) -> None:
        self._file.write(data)
        self._offset += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _put_checked(self, data: bytes) -> None:
        """Write a record that MCAP gives no CRC of its own."""
        self._summary.checksums.append((self._offset, len(data), zlib.crc32(data)))
        self._put(data)

    def _check_limit(self, value: int, limit: str, what: str, record: str) -> None:
        allowed: int = getattr(self._limits, limit)
        if value > allowed:
            raise LimitError(
                f"{what} is {value}, over the limit {limit} = {allowed}",
                self.path,
                record=record,
            )

    def _check_message(self, size: int, topic: str) -> None:
        self._check_limit(size, "max_message_bytes", "a message's size", topic)
        self._check_limit(
            size + _HEAD.size, "max_chunk_bytes", "a message's size in its chunk", topic
        )

    def _bad_numbers(
        self,
        topic: str,
        log_time_ns: int,
        publish_time_ns: int,
        sequence: int,
        error: struct.error,
    ) -> NoReturn:
        raise RecordingError(
            f"log time {log_time_ns} and publish time {publish_time_ns} must be in [0,"
            f" 2^64), sequence {sequence} in [0, 2^32)",
            self.path,
            record=topic,
        ) from error
