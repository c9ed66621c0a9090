"""Chunks whose first bytes are damaged, opcode or length, and whose data are whole."""

from __future__ import annotations

from dataclasses import dataclass

from recorders.errors import RecordingError
from recorders.log import records, wire
from recorders.log.compression import KNOWN
from recorders.log.storage import RawRecord, RecordFile

_HEAD_BYTES = 256
_MOST_PASSES = 2
_FOLLOWS = frozenset(
    {
        wire.MESSAGE_INDEX,
        wire.CHUNK,
        wire.SCHEMA,
        wire.CHANNEL,
        wire.ATTACHMENT,
        wire.METADATA,
        wire.DATA_END,
    }
)


@dataclass(frozen=True, slots=True)
class Mended:
    """A chunk as it must have been: ``raw`` with the right opcode and length, and what was wrong."""

    raw: RawRecord
    reason: str


class ChunkMender:
    """Finds chunks behind damaged opcodes and lengths: their own head says how long they are, and
    their CRC proves it. What it unpacks in vain is bounded by the file's size.

    Args:
        file: the log.
        chunks: where the summary places chunks; None where there is no whole summary, and then
            only a single flipped bit of the opcode is believed.
    """

    def __init__(self, file: RecordFile, chunks: frozenset[int] | None) -> None:
        self._file = file
        self._chunks = chunks
        self._left = _MOST_PASSES * file.size

    def mended(self, offset: int, limit: int) -> Mended | None:
        """The chunk at this byte, if one begins there and its first nine bytes are not as they
        must be.
        """
        start = offset + wire.PREFIX_BYTES
        if start >= limit:
            return None
        opcode, length = wire.PREFIX.unpack(self._file.read(offset, wire.PREFIX_BYTES))
        head = self._head(start, limit) if self._may_be_chunk(opcode, offset) else None
        if head is None:
            return None
        raw = RawRecord(wire.CHUNK, offset, head.data_start + head.data_size)
        wrong_opcode, wrong_length = opcode != wire.CHUNK, length != raw.length
        # Two damages at once are none that anybody could tell from other data.
        if wrong_opcode == wrong_length or (wrong_length and not self._follows(raw, limit)):
            return None
        self._left -= head.data_size + head.uncompressed_size
        if self._left < 0 or not self._file.holds_sound_chunk(raw):
            return None
        what = f"opcode is 0x{opcode:02x}" if wrong_opcode else f"length is {length}"
        return Mended(raw, f"its {what}, which is damaged; its data are whole")

    def _may_be_chunk(self, opcode: int, offset: int) -> bool:
        if opcode == wire.CHUNK or self._chunks is not None:
            return opcode == wire.CHUNK or offset in (self._chunks or ())
        return (opcode ^ wire.CHUNK).bit_count() == 1

    def _head(self, start: int, limit: int) -> records.ChunkHead | None:
        """The head of a chunk whose data a CRC proves."""
        try:
            content = self._file.read(start, min(_HEAD_BYTES, limit - start))
            head = records.parse_chunk_head(content, limit - start)
        except (RecordingError, wire.WireError):
            return None
        return head if head.uncompressed_crc and head.compression in KNOWN else None

    def _follows(self, raw: RawRecord, limit: int) -> bool:
        """Whether a record of the data section follows it."""
        if raw.end == limit:
            return True
        try:
            return self._file.record_at(raw.end, limit).opcode in _FOLLOWS
        except RecordingError:
            return False
