"""Blocks of messages: a chunk, or a run of records that stand in the data section without a
chunk.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from typing import IO

from msgspec import structs

from recorders.errors import LimitError, RecordingError
from recorders.log import records, wire
from recorders.log.model import ChannelInfo, Message
from recorders.log.storage import RawRecord, RecordFile

_HEAD = wire.MESSAGE_HEAD
_HEAD_BYTES = wire.MESSAGE_HEAD.size


@dataclass(frozen=True, slots=True)
class Block:
    """Where messages stand together: what a reader opens at once.

    Attributes:
        offset: of the chunk record, or of the run's first record.
        length: of the whole chunk record, or of the run.
        start_ns: log time of its earliest message.
        end_ns: log time of its latest message.
        channels: ids of the channels with messages in it, None if not known.
        chunked: a chunk, not a run.
        index: what the summary says of the chunk; the chunk's own head must agree.
    """

    offset: int
    length: int
    start_ns: int
    end_ns: int
    channels: frozenset[int] | None
    chunked: bool
    index: records.ChunkIndexRecord | None = None


def walk_records(data: bytes) -> Iterator[tuple[int, int, int]]:
    """(opcode, offset, content length) of each record in ``data``, which must end with the last
    of them.
    """
    position, size = 0, len(data)
    unpack = wire.PREFIX.unpack_from
    while position < size:
        if size - position < wire.PREFIX_BYTES:
            raise wire.WireError(f"its data ends within a record, at {position} of {size}")
        opcode, length = unpack(data, position)
        if length > size - position - wire.PREFIX_BYTES:
            raise wire.WireError(
                f"a record of {length} bytes at {position} reaches past its {size} bytes"
            )
        yield opcode, position, length
        position += wire.PREFIX_BYTES + length


def read_block(file: RecordFile, block: Block) -> bytes:
    """The block's records, unpacked and checked."""
    if not block.chunked:
        return file.read(block.offset, block.length, "Message")
    raw, head = checked_chunk(file, block)
    return file.unpack(raw, head)


def checked_chunk(file: RecordFile, block: Block) -> tuple[RawRecord, records.ChunkHead]:
    """Where a chunk stands and its head, held against what the summary says of it."""
    raw = file.record_at(block.offset)
    if raw.opcode != wire.CHUNK or raw.end != block.offset + block.length:
        raise file.error(
            "the summary says that a chunk is here, but there is none of that length",
            block.offset,
        )
    head = file.chunk_head(raw)
    index = block.index
    if index is not None and (
        (
            index.start_ns,
            index.end_ns,
            index.compression,
            index.compressed_size,
            index.uncompressed_size,
        )
        != (
            head.start_ns,
            head.end_ns,
            head.compression,
            head.data_size,
            head.uncompressed_size,
        )
    ):
        raise file.error(
            "the chunk's head and its index in the summary differ: one is damaged",
            raw.offset,
            raw.name,
        )
    return raw, head


def read_messages(
    file: RecordFile,
    block: Block,
    wanted: dict[int, ChannelInfo | None],
    start_ns: int,
    end_ns: int,
) -> list[Message]:
    """The block's messages from ``start_ns`` to before ``end_ns``, by log time, then place in the
    block.

    ``wanted`` holds every channel of the log by id: its `ChannelInfo`, or None where its messages
    are not wanted.
    """
    data = read_block(file, block)
    try:
        found, in_order = _collect(file, block, data, wanted, start_ns, end_ns)
    except wire.WireError as error:
        raise file.error(
            str(error), block.offset, "Chunk" if block.chunked else None
        ) from error
    if not in_order:
        found.sort(key=_order)
    return found


def _order(message: Message) -> tuple[int, int, int]:
    return message.order


def _collect(
    file: RecordFile,
    block: Block,
    data: bytes,
    wanted: dict[int, ChannelInfo | None],
    start_ns: int,
    end_ns: int,
) -> tuple[list[Message], bool]:
    """One pass over the records: the hot loop of reading, so it calls nothing that it need not."""
    found: list[Message] = []
    add = found.append
    unpack = _HEAD.unpack_from
    position, size, base = 0, len(data), block.offset
    low, high, known = block.start_ns, block.end_ns, block.channels
    limit = file.limits.max_message_bytes + wire.MESSAGE_FIELDS_BYTES
    last, in_order, count = -1, True, 0
    most = file.limits.max_messages_per_chunk
    while size - position >= _HEAD_BYTES:
        opcode, length, channel_id, sequence, log_time, publish_time = unpack(
            data, position
        )
        end = position + wire.PREFIX_BYTES + length
        if end > size:
            raise wire.WireError(
                f"a record of {length} bytes at {position} reaches past the chunk's {size}"
                " bytes"
            )
        if opcode == wire.MESSAGE:
            if not wire.MESSAGE_FIELDS_BYTES <= length <= limit:
                raise _bad_length(file, block, position, length)
            if not low <= log_time <= high:
                raise wire.WireError(
                    f"a message has log time {log_time}, outside the {low} to {high} that"
                    " the index states"
                )
            if channel_id not in wanted or (known is not None and channel_id not in known):
                raise _unknown_channel(channel_id, wanted)
            count += 1
            if count > most:
                file.check_limit(
                    count,
                    "max_messages_per_chunk",
                    "the number of messages",
                    block.offset,
                    "Chunk",
                )
            channel = wanted[channel_id]
            if channel is not None and start_ns <= log_time < end_ns:
                if log_time < last:
                    in_order = False
                last = log_time
                payload = data[position + _HEAD_BYTES : end]
                order = (log_time, base, position)
                add(
                    Message(
                        channel.topic,
                        log_time,
                        publish_time,
                        sequence,
                        payload,
                        channel,
                        order,
                    )
                )
        position = end
    _check_tail(file, block, data, position)
    return found, in_order


def _check_tail(file: RecordFile, block: Block, data: bytes, position: int) -> None:
    """What is left is shorter than a message can be: records of other types, or damage."""
    for opcode, offset, length in walk_records(data[position:]):
        if opcode == wire.MESSAGE:
            raise _bad_length(file, block, position + offset, length)


def _bad_length(
    file: RecordFile, block: Block, position: int, length: int
) -> RecordingError:
    where = (
        f"in the chunk at {position}"
        if block.chunked
        else f"at byte {block.offset + position}"
    )
    if length < wire.MESSAGE_FIELDS_BYTES:
        return file.error(
            f"a message of {length} bytes {where} is shorter than its fields",
            block.offset,
            "Message",
        )
    limit = file.limits.max_message_bytes
    size = length - wire.MESSAGE_FIELDS_BYTES
    return LimitError(
        f"a message {where} has {size} bytes, over the limit max_message_bytes = {limit}",
        file.path,
        block.offset,
        "Message",
    )


def _unknown_channel(
    channel_id: int, wanted: dict[int, ChannelInfo | None]
) -> wire.WireError:
    if channel_id not in wanted:
        return wire.WireError(
            f"a message is of channel {channel_id}, which no Channel record before it"
            " defines"
        )
    return wire.WireError(
        f"a message is of channel {channel_id}, which the chunk's index does not mention"
    )


class Shelf:
    """Payloads put aside in a temporary file while chunks that overlap are more than memory
    takes: each is written once and read once, instead of its chunk being unpacked again and again.
    """

    def __init__(self) -> None:
        self._file: IO[bytes] | None = None
        self._end = 0

    def put(self, data: bytes) -> int:
        """Keep a payload; where it is."""
        if self._file is None:
            self._file = tempfile.TemporaryFile(prefix="scenetrace-")  # noqa: SIM115
        self._file.seek(self._end)
        self._file.write(data)
        self._end += len(data)
        return self._end - len(data)

    def get(self, place: int, length: int) -> bytes:
        """The payload that was put there."""
        assert self._file is not None
        self._file.seek(place)
        return self._file.read(length)

    def close(self) -> None:
        """Give the space back."""
        if self._file is not None:
            self._file.close()


class BlockCursor:
    """A block opened for merging: its messages in total order, whose payloads are put aside when
    memory is short.
    """

    __slots__ = ("_places", "_shelf", "bytes_held", "messages", "position")

    def __init__(self, messages: list[Message], shelf: Shelf) -> None:
        self.messages = messages
        self.position = 0
        self.bytes_held = sum(len(message.data) for message in messages)
        self._shelf = shelf
        self._places: list[tuple[int, int]] | None = None

    def taken(self, until: int) -> list[Message]:
        """The next messages, up to that position."""
        start, self.position = self.position, until
        if self._places is None:
            return self.messages[start:until]
        places = self._places[start:until]
        found = self.messages[start:until]
        return [
            structs.replace(message, data=self._shelf.get(*place))
            for message, place in zip(found, places, strict=True)
        ]

    def put_aside(self) -> None:
        """Give the payloads' memory back."""
        if self._places is not None:
            return
        done = self.position
        self._places = [(0, 0)] * done + [
            (self._shelf.put(message.data), len(message.data))
            for message in self.messages[done:]
        ]
        self.messages = self.messages[:done] + [
            structs.replace(message, data=b"") for message in self.messages[done:]
        ]
        self.bytes_held = 0


def raw_chunk(block: Block) -> RawRecord:
    """A chunk block's record."""
    return RawRecord(wire.CHUNK, block.offset, block.length - wire.PREFIX_BYTES)
