"""Walking a damaged file: every record that still stands, and every place where none can be made
out.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass

from recorders.errors import RecordingError
from recorders.log import records, wire
from recorders.log.layout import Summary, read_footer, read_summary
from recorders.log.mending import ChunkMender, Mended
from recorders.log.storage import RawRecord, RecordFile

_OVERLAP = 64
_WINDOW = 1 << 20
_LONGEST_DATA_END = 4096
_CHAIN = 3
_CHUNK_PATTERN = re.compile(
    rb"(?=\x06.{36}(?:\x00{4}|\x03\x00{3}lz4|\x04\x00{3}zstd))", re.DOTALL
)
_MESSAGE_PATTERN = re.compile(rb"(?=[\x03\x04\x05\x09\x0c\x0f].{4}\x00{4})", re.DOTALL)
_MAGIC_PATTERN = re.compile(re.escape(wire.MAGIC))
_PLAUSIBLE = frozenset(range(wire.HEADER, wire.DATA_END + 1)) | frozenset(
    range(0x80, 0x100)
)
_UNCHUNKED = frozenset(
    {wire.SCHEMA, wire.CHANNEL, wire.MESSAGE, wire.ATTACHMENT, wire.METADATA, wire.DATA_END}
)


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes that hold no record: from ``offset`` up to ``end``."""

    offset: int
    end: int
    reason: str


@dataclass(frozen=True, slots=True)
class Joint:
    """Another log begins here: its magic bytes stand behind the end of the one before."""

    offset: int


@dataclass(slots=True)
class Ending:
    """What a file's end says: its summary, where that is whole, and where the data section must
    end.
    """

    summary: Summary | None
    footer: records.FooterRecord | None
    data_limit: int
    problem: RecordingError | None

    @property
    def is_known(self) -> bool:
        """Whether a summary says where the data end."""
        return self.summary is not None and bool(self.footer and self.footer.summary_start)

    def chunk_offsets(self) -> frozenset[int] | None:
        """Where the summary places chunks; None where there is no whole summary."""
        if self.summary is None or not self.is_known:
            return None
        return frozenset(entry.offset for entry in self.summary.chunks)

    def known_offsets(self) -> list[int]:
        """Where records stand, according to the summary."""
        if self.summary is None:
            return []
        return sorted(
            [entry.offset for entry in self.summary.chunks]
            + [entry.offset for entry in self.summary.attachments]
            + [entry.offset for entry in self.summary.metadata]
        )


def read_ending(file: RecordFile) -> Ending:
    """Footer and summary, as far as they are whole."""
    try:
        footer, footer_offset = read_footer(file)
    except RecordingError as error:
        return Ending(None, None, file.size, error)
    try:
        summary = read_summary(file, footer, footer_offset)
    except RecordingError as error:
        return Ending(None, footer, file.size, error)
    return Ending(summary, footer, footer.summary_start or footer_offset, None)


def walk(
    file: RecordFile, start: int, ending: Ending
) -> Iterator[RawRecord | Damage | Joint | Mended]:
    """The records of the data section from ``start`` to its DataEnd, and the damage between them.

    Where no whole summary says that the data end there, a DataEnd may be a damaged record of
    another kind, or other logs may follow: then it goes on to the end of the file, and gives the
    summary's records, too.

    After a place where no record can be made out, it goes on at the next record that the summary
    places, or else at the next bytes that look like a chunk, or, in a file without chunks, like a
    chain of records. A chunk whose opcode or length alone is damaged is found by its head.
    """
    mender = ChunkMender(file, ending.chunk_offsets())
    known = ending.known_offsets()
    position, limit, chunked = start, ending.data_limit, False
    while position < limit:
        reason = ""
        if not ending.is_known and _is_magic(file, position, limit):
            position += len(wire.MAGIC)
            if position < limit and _is_header(file, position, limit):
                yield Joint(position - len(wire.MAGIC))
            continue
        mended = mender.mended(position, limit)
        if mended is not None:
            yield mended
            position, chunked = mended.raw.end, True
            continue
        try:
            raw = file.record_at(position, limit)
            if raw.opcode not in _PLAUSIBLE or not _ends_well(raw, ending, limit):
                reason = f"no record can start with byte 0x{raw.opcode:02x} here"
            elif bisect_left(known, raw.end) > bisect_right(known, raw.offset):
                reason = (
                    f"a {raw.name} of {raw.length} bytes would reach over a record that the"
                    " summary places"
                )
        except RecordingError as error:
            reason = error.reason
        if not reason:
            yield raw
            chunked = chunked or raw.opcode == wire.CHUNK
            if ending.is_known and raw.opcode in (wire.DATA_END, wire.FOOTER):
                return
            position = raw.end
            continue
        resumed = _resume(file, position + 1, limit, known, chunked)
        yield Damage(position, resumed, reason)
        position = resumed


def _ends_well(raw: RawRecord, ending: Ending, limit: int) -> bool:
    """A DataEnd or Footer in the middle of the data is a damaged opcode."""
    if raw.opcode == wire.DATA_END:
        return raw.length <= _LONGEST_DATA_END and (not ending.is_known or raw.end == limit)
    if raw.opcode == wire.FOOTER:
        return raw.length == wire.FOOTER_BODY.size and not ending.is_known
    return True


def _resume(
    file: RecordFile, position: int, limit: int, known: list[int], chunked: bool
) -> int:
    place = bisect_right(known, position - 1)
    if place < len(known) and known[place] < limit:
        return known[place]
    if known:
        return _search(file, position, limit, _MESSAGE_PATTERN, _is_data_end)
    # Another log may begin there, behind what is left of this one.
    limit = _search(file, position, limit, _MAGIC_PATTERN, _is_start)
    found = _search(file, position, limit, _CHUNK_PATTERN, _is_chunk)
    if found < limit or chunked:
        return found
    return _search(file, position, limit, _MESSAGE_PATTERN, _is_chain)


def _search(
    file: RecordFile, start: int, limit: int, pattern: re.Pattern[bytes], holds: object
) -> int:
    assert callable(holds)
    while start < limit:
        window = file.read(start, min(_WINDOW + _OVERLAP, limit - start))
        for match in pattern.finditer(window):
            if match.start() < _WINDOW and holds(file, start + match.start(), limit):
                return start + match.start()
        start += _WINDOW
    return limit


def _is_magic(file: RecordFile, offset: int, limit: int) -> bool:
    size = len(wire.MAGIC)
    return offset + size <= limit and file.read(offset, size) == wire.MAGIC


def _is_start(file: RecordFile, offset: int, limit: int) -> bool:
    return _is_header(file, offset + len(wire.MAGIC), limit)


def _is_header(file: RecordFile, offset: int, limit: int) -> bool:
    try:
        raw = file.record_at(offset, limit)
    except RecordingError:
        return False
    return raw.opcode == wire.HEADER


def _is_chunk(file: RecordFile, offset: int, limit: int) -> bool:
    try:
        raw = file.record_at(offset, limit)
        head = file.chunk_head(raw)
    except RecordingError:
        return False
    return head.data_start + head.data_size == raw.length and head.start_ns <= head.end_ns


def _is_data_end(file: RecordFile, offset: int, limit: int) -> bool:
    try:
        raw = file.record_at(offset, limit)
    except RecordingError:
        return False
    return raw.opcode == wire.DATA_END and raw.end == limit


def _is_chain(file: RecordFile, offset: int, limit: int) -> bool:
    """Some records follow one another from here, or the data ends properly."""
    for _ in range(_CHAIN):
        try:
            raw = file.record_at(offset, limit)
        except RecordingError:
            return False
        if raw.opcode not in _UNCHUNKED or (
            raw.opcode == wire.MESSAGE and raw.length < wire.MESSAGE_FIELDS_BYTES
        ):
            return False
        if raw.opcode == wire.DATA_END:
            return raw.length <= _LONGEST_DATA_END
        offset = raw.end
        if offset == limit:
            return True
    return True
