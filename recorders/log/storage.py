"""The file under a log: bounded reads at given places, whole records, every error with its
offset.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from recorders.closing import Closing
from recorders.errors import LimitError, RecordingError
from recorders.limits import Limits
from recorders.log import records, wire
from recorders.log.compression import KNOWN, TooLargeError, decompress, unpacked

Parsed = TypeVar("Parsed")
_STEP = 1 << 20
_WINDOW = 1 << 16
_CHUNK_HEAD_BYTES = 4096


@dataclass(frozen=True, slots=True)
class RawRecord:
    """Where a record stands: ``offset`` of its opcode, ``length`` of its content."""

    opcode: int
    offset: int
    length: int

    @property
    def content(self) -> int:
        """Offset of its content."""
        return self.offset + wire.PREFIX_BYTES

    @property
    def end(self) -> int:
        """Offset of what follows it."""
        return self.offset + wire.PREFIX_BYTES + self.length

    @property
    def name(self) -> str:
        """Its type, for messages."""
        return wire.opcode_name(self.opcode)


def _of_a_folder(path: Path) -> str:
    """Why a folder is no log, and what to do with it."""
    logs = sorted((path / "annotated").glob("*.mcap"))
    if not (path / "tables" / "recordings").is_dir():
        return "this is a folder, not a log; `scenetrace record` reads the folder of a bag"
    one = f"name one of its recordings, as {logs[0]}, or " if logs else ""
    return (
        f"this is a case of `scenetrace batch`, not a log: {one}ask all of them by"
        f" `scenetrace query {path}`"
    )


class RecordFile(Closing):
    """A log file opened for reading.

    Every method raises `RecordingError` with path and byte offset where the file does not hold
    what it should, `LimitError` where it asks for more than ``limits`` allows; nothing is
    allocated before it was checked against the file's size and the limits.
    """

    def __init__(self, path: str | Path, limits: Limits) -> None:
        self.path = Path(path)
        self.limits = limits
        try:
            if self.path.is_dir():
                raise RecordingError(_of_a_folder(self.path), self.path)
            self._file = self.path.open("rb", buffering=_WINDOW)
            self.size = self._file.seek(0, 2)
        except FileNotFoundError as error:
            raise RecordingError("there is no such file", self.path) from error
        except OSError as error:
            raise RecordingError(
                f"cannot be opened: {error.strerror or error}", self.path
            ) from error

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    @property
    def descriptor(self) -> int:
        """The system's number of the open file."""
        return self._file.fileno()

    def grown(self) -> int:
        """The file's size now, where somebody still writes it."""
        self.size = self._file.seek(0, 2)
        return self.size

    def error(
        self, reason: str, offset: int | None = None, record: str | None = None
    ) -> RecordingError:
        """An error about this file."""
        return RecordingError(reason, self.path, offset, record)

    def check_limit(
        self, value: int, limit: str, what: str, offset: int, record: str | None = None
    ) -> None:
        """Raise `LimitError` when ``value`` is over the limit of that name."""
        allowed: int = getattr(self.limits, limit)
        if value > allowed:
            raise LimitError(
                f"{what} is {value}, over the limit {limit} = {allowed}; --limit"
                f" {limit}={value} allows it",
                self.path,
                offset,
                record,
            )

    def read(self, offset: int, length: int, record: str | None = None) -> bytes:
        """Exactly ``length`` bytes from ``offset``; the caller has checked ``length`` against a
        limit.
        """
        if offset + length > self.size:
            raise self.error(
                f"{length} bytes are said to be here, but the file ends at byte"
                f" {self.size}",
                offset,
                record,
            )
        try:
            self._file.seek(offset)
            data = self._file.read(length)
        except (OSError, ValueError) as error:
            raise self.error(f"cannot be read: {error}", offset, record) from error
        if len(data) != length:
            raise self.error(
                f"the file became shorter while it was read ({len(data)} of {length})",
                offset,
                record,
            )
        return data

    def pieces(self, start: int, end: int) -> Iterator[bytes]:
        """The bytes from ``start`` to ``end``, in pieces of bounded size."""
        while start < end:
            piece = self.read(start, min(_STEP, end - start))
            start += len(piece)
            yield piece

    def crc(self, start: int, end: int, crc: int = 0) -> int:
        """CRC-32 of the bytes from ``start`` to ``end``, continuing ``crc``."""
        for piece in self.pieces(start, end):
            crc = zlib.crc32(piece, crc)
        return crc

    def record_at(self, offset: int, end: int | None = None) -> RawRecord:
        """The record that starts at ``offset`` and must end at or before ``end`` (default: the
        file's end).
        """
        end = self.size if end is None else end
        if offset + wire.PREFIX_BYTES > end:
            raise self.error(
                "the file ends within a record; `scenetrace recover` keeps what is whole",
                offset,
            )
        opcode, length = wire.PREFIX.unpack(self.read(offset, wire.PREFIX_BYTES))
        if length > end - offset - wire.PREFIX_BYTES:
            raise self.error(
                f"a record of {length} bytes reaches past byte {end}: the file is cut short"
                " or damaged; `scenetrace recover` keeps what is whole",
                offset,
                wire.opcode_name(opcode),
            )
        return RawRecord(opcode, offset, length)

    def walk(self, start: int, end: int) -> Iterator[RawRecord]:
        """The records from ``start`` on, until exactly ``end``."""
        while start < end:
            found = self.record_at(start, end)
            yield found
            start = found.end

    def content(self, raw: RawRecord, limit: str = "max_record_bytes") -> bytes:
        """A record's content, if its length is within the limit of that name."""
        self.check_limit(raw.length, limit, "the record's length", raw.offset, raw.name)
        return self.read(raw.content, raw.length, raw.name)

    def parse(self, parser: Callable[[bytes], Parsed], raw: RawRecord) -> Parsed:
        """A record's content through one of the parsers of `recorders.log.wire`."""
        return self.parsed(parser, self.content(raw), raw.offset, raw.name)

    def parsed(
        self, parser: Callable[[bytes], Parsed], content: bytes, offset: int, record: str
    ) -> Parsed:
        """Like `parse`, for content already read."""
        try:
            return parser(content)
        except wire.WireError as error:
            raise self.error(str(error), offset, record) from error

    def chunk_head(self, raw: RawRecord) -> records.ChunkHead:
        """A chunk's head, its sizes checked against the limits and its compression known."""
        content = self.read(raw.content, min(raw.length, _CHUNK_HEAD_BYTES), raw.name)
        head = self.parsed(
            lambda c: records.parse_chunk_head(c, raw.length), content, raw.offset, raw.name
        )
        if head.compression not in KNOWN:
            raise self.error(
                f"compression {head.compression[:40]!r} is unknown; known are none, lz4 and"
                " zstd",
                raw.offset,
                raw.name,
            )
        self.check_limit(
            head.data_size,
            "max_chunk_bytes",
            "the chunk's stored size",
            raw.offset,
            raw.name,
        )
        self.check_limit(
            head.uncompressed_size,
            "max_chunk_bytes",
            "the chunk's size",
            raw.offset,
            raw.name,
        )
        return head

    def holds_sound_chunk(self, raw: RawRecord) -> bool:
        """Whether a chunk that is over a limit is sound: it unpacks to the size and the CRC that
        it states. Read in pieces, in bounded memory; without a CRC nobody can tell, and it counts
        as sound.
        """
        try:
            content = self.read(raw.content, min(raw.length, _CHUNK_HEAD_BYTES), raw.name)
            head = records.parse_chunk_head(content, raw.length)
            if head.uncompressed_size > self.limits.max_unpacked_bytes:
                return False
            size = crc = 0
            packed = self.pieces(
                raw.content + head.data_start,
                raw.content + head.data_start + head.data_size,
            )
            for piece in unpacked(head.compression, packed):
                size, crc = size + len(piece), zlib.crc32(piece, crc)
                if size > head.uncompressed_size:
                    return False
        except (RecordingError, wire.WireError):
            return False
        return size == head.uncompressed_size and crc == (head.uncompressed_crc or crc)

    def unpack(self, raw: RawRecord, head: records.ChunkHead) -> bytes:
        """A chunk's records, unpacked within their declared size, CRC checked where there is one."""
        packed = self.read(raw.content + head.data_start, head.data_size, raw.name)
        try:
            data = decompress(head.compression, packed, head.uncompressed_size)
        except TooLargeError as error:
            raise LimitError(
                f"the chunk unpacks to more than the {head.uncompressed_size} bytes that it"
                " declares",
                self.path,
                raw.offset,
                raw.name,
            ) from error
        except wire.WireError as error:
            raise self.error(str(error), raw.offset, raw.name) from error
        if head.uncompressed_crc and zlib.crc32(data) != head.uncompressed_crc:
            raise self.error(
                "the chunk's CRC differs: its data is damaged; `scenetrace recover` keeps what"
                " is whole",
                raw.offset,
                raw.name,
            )
        return data
