"""The bytes that MCAP records are made of (mcap.dev/spec, version 0): opcodes, numbers, strings and
maps, written and strictly read with bounds. `recorders.log.records` makes records of them.

The `mcap` package's parsers read past a record's end, or overrun a map's declared length, without
an error; these do not, and say what is wrong. Bytes after a record's known fields are allowed
(the specification reserves them for extensions).
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

MAGIC = b"\x89MCAP0\r\n"

HEADER = 0x01
FOOTER = 0x02
SCHEMA = 0x03
CHANNEL = 0x04
MESSAGE = 0x05
CHUNK = 0x06
MESSAGE_INDEX = 0x07
CHUNK_INDEX = 0x08
ATTACHMENT = 0x09
ATTACHMENT_INDEX = 0x0A
STATISTICS = 0x0B
METADATA = 0x0C
METADATA_INDEX = 0x0D
SUMMARY_OFFSET = 0x0E
DATA_END = 0x0F
CHECKSUMS = 0x81
"""This project's own record in the summary (`records.encode_checksums`); other readers skip what
they do not know.
"""

OPCODE_NAMES = {
    HEADER: "Header",
    FOOTER: "Footer",
    SCHEMA: "Schema",
    CHANNEL: "Channel",
    MESSAGE: "Message",
    CHUNK: "Chunk",
    MESSAGE_INDEX: "MessageIndex",
    CHUNK_INDEX: "ChunkIndex",
    ATTACHMENT: "Attachment",
    ATTACHMENT_INDEX: "AttachmentIndex",
    STATISTICS: "Statistics",
    METADATA: "Metadata",
    METADATA_INDEX: "MetadataIndex",
    SUMMARY_OFFSET: "SummaryOffset",
    DATA_END: "DataEnd",
    CHECKSUMS: "Checksums",
}

PREFIX = struct.Struct("<BQ")
PREFIX_BYTES = PREFIX.size
MESSAGE_HEAD = struct.Struct("<BQHIQQ")
"""Opcode, record length, channel id, sequence, log time, publish time: 31 bytes before a
message's payload.
"""
MESSAGE_FIELDS_BYTES = MESSAGE_HEAD.size - PREFIX_BYTES
CHUNK_HEAD = struct.Struct("<QQQI")
FOOTER_BODY = struct.Struct("<QQI")
FOOTER_BYTES = PREFIX_BYTES + FOOTER_BODY.size
U16 = struct.Struct("<H")
U32 = struct.Struct("<I")
U64 = struct.Struct("<Q")
FOUR_U64 = struct.Struct("<QQQQ")
CHANNEL_OFFSET = struct.Struct("<HQ")


def opcode_name(opcode: int) -> str:
    """The record type's name, or its number where it has none."""
    return OPCODE_NAMES.get(opcode, f"record type 0x{opcode:02x}")


class WireError(Exception):
    """A record's content does not fit its type; `recorders.log.storage.RecordFile` adds path and
    offset.
    """


class Cursor:
    """Reads fields one after the other from a record's content; raises `WireError` at its end."""

    __slots__ = ("content", "end", "position")

    def __init__(
        self, content: bytes | memoryview, position: int = 0, end: int | None = None
    ) -> None:
        self.content = content
        self.position = position
        self.end = len(content) if end is None else end

    def take(self, count: int, what: str) -> bytes:
        """The next ``count`` bytes, copied."""
        start = self.position
        if count > self.end - start:
            raise WireError(f"{what} of {count} bytes reaches past the end of the record")
        self.position = start + count
        return bytes(self.content[start : start + count])

    def _unpack(self, layout: struct.Struct, what: str) -> int:
        start = self.position
        if layout.size > self.end - start:
            raise WireError(f"the record ends before its {what}")
        self.position = start + layout.size
        value: int = layout.unpack_from(self.content, start)[0]
        return value

    def numbers(self, layout: struct.Struct, what: str) -> tuple[int, ...]:
        """Several numbers at once."""
        start = self.position
        if layout.size > self.end - start:
            raise WireError(f"the record ends before its {what}")
        self.position = start + layout.size
        return layout.unpack_from(self.content, start)

    def u16(self, what: str) -> int:
        """An unsigned 16-bit number."""
        return self._unpack(U16, what)

    def u32(self, what: str) -> int:
        """An unsigned 32-bit number."""
        return self._unpack(U32, what)

    def u64(self, what: str) -> int:
        """An unsigned 64-bit number."""
        return self._unpack(U64, what)

    def text(self, what: str) -> str:
        """A string with its length before it."""
        raw = self.take(self.u32(f"length of {what}"), what)
        try:
            return raw.decode("utf-8")
        except UnicodeDecodeError as error:
            raise WireError(f"{what} is not UTF-8: {error.reason}") from error

    def within(self, what: str) -> Cursor:
        """A cursor over the next array or map, which has its length in bytes before it."""
        length = self.u32(f"length of {what}")
        if length > self.end - self.position:
            raise WireError(f"{what} of {length} bytes reaches past the end of the record")
        inner = Cursor(self.content, self.position, self.position + length)
        self.position += length
        return inner

    def texts(self, what: str) -> dict[str, str]:
        """A map from strings to strings; a key that stands twice is an error."""
        inner = self.within(what)
        values: dict[str, str] = {}
        while inner.position < inner.end:
            key = inner.text(f"key in {what}")
            if key in values:
                raise WireError(f"key {key!r} stands twice in {what}")
            values[key] = inner.text(f"value in {what}")
        return values


def record(opcode: int, *fields: bytes) -> bytes:
    """A whole record from its serialised fields."""
    content = b"".join(fields)
    return PREFIX.pack(opcode, len(content)) + content


def text(value: str) -> bytes:
    """A string with its length before it."""
    raw = value.encode("utf-8")
    return U32.pack(len(raw)) + raw


def texts(values: Mapping[str, str]) -> bytes:
    """A map from strings to strings, keys sorted."""
    content = b"".join(text(key) + text(values[key]) for key in sorted(values))
    return U32.pack(len(content)) + content
