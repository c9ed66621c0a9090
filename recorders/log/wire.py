"""The bytes of MCAP records: constants, types, strict parsing with bounds (mcap.dev/spec, version
0).

The `mcap` package's parsers read past a record's end, or overrun a map's declared length, without
an error; these do not, and say what is wrong. Bytes after a record's known fields are allowed
(the specification reserves them for extensions).
"""

from __future__ import annotations

import struct
from dataclasses import dataclass

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
"""This project's own record in the summary (`encoding.encode_checksums`); other readers skip what
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


@dataclass(frozen=True, slots=True)
class SchemaRecord:
    """A Schema record."""

    id: int
    name: str
    encoding: str
    data: bytes


@dataclass(frozen=True, slots=True)
class ChannelRecord:
    """A Channel record."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


@dataclass(frozen=True, slots=True)
class ChunkHead:
    """A Chunk record without its data; ``data_start`` counts from the record's content."""

    start_ns: int
    end_ns: int
    uncompressed_size: int
    uncompressed_crc: int
    compression: str
    data_start: int
    data_size: int


@dataclass(frozen=True, slots=True)
class ChunkIndexRecord:
    """A ChunkIndex record."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    message_index_offsets: dict[int, int]
    message_index_length: int
    compression: str
    compressed_size: int
    uncompressed_size: int


@dataclass(frozen=True, slots=True)
class AttachmentIndexRecord:
    """An AttachmentIndex record."""

    offset: int
    length: int
    log_time_ns: int
    create_time_ns: int
    data_size: int
    name: str
    media_type: str


@dataclass(frozen=True, slots=True)
class MetadataIndexRecord:
    """A MetadataIndex record."""

    offset: int
    length: int
    name: str


@dataclass(frozen=True, slots=True)
class StatisticsRecord:
    """A Statistics record."""

    message_count: int
    schema_count: int
    channel_count: int
    attachment_count: int
    metadata_count: int
    chunk_count: int
    start_ns: int
    end_ns: int
    channel_message_counts: dict[int, int]


@dataclass(frozen=True, slots=True)
class FooterRecord:
    """The Footer record."""

    summary_start: int
    summary_offset_start: int
    summary_crc: int


def parse_schema(content: bytes | memoryview) -> SchemaRecord:
    """Schema: id (never 0), name, encoding, data."""
    cursor = Cursor(content)
    identity = cursor.u16("id")
    if identity == 0:
        raise WireError("schema id 0 is reserved for channels without a schema")
    name = cursor.text("name")
    encoding = cursor.text("encoding")
    return SchemaRecord(
        identity, name, encoding, cursor.take(cursor.u32("length of data"), "data")
    )


def parse_channel(content: bytes | memoryview) -> ChannelRecord:
    """Channel: id, schema id, topic, message encoding, metadata."""
    cursor = Cursor(content)
    return ChannelRecord(
        cursor.u16("id"),
        cursor.u16("schema id"),
        cursor.text("topic"),
        cursor.text("message encoding"),
        cursor.texts("metadata"),
    )


def parse_chunk_head(content: bytes | memoryview, length: int) -> ChunkHead:
    """The fields before a chunk's data; ``length`` is the whole record's, ``content`` may hold
    less than that.
    """
    cursor = Cursor(content)
    start, end = cursor.u64("start time"), cursor.u64("end time")
    size, crc = cursor.u64("uncompressed size"), cursor.u32("uncompressed CRC")
    compression = cursor.text("compression")
    data_size = cursor.u64("length of the data")
    if data_size > length - cursor.position:
        raise WireError(f"data of {data_size} bytes reaches past the end of the record")
    return ChunkHead(start, end, size, crc, compression, cursor.position, data_size)


def parse_chunk_index(content: bytes | memoryview) -> ChunkIndexRecord:
    """ChunkIndex: times, place, message index offsets by channel, sizes."""
    cursor = Cursor(content)
    start, end = cursor.u64("start time"), cursor.u64("end time")
    offset, length = cursor.u64("chunk offset"), cursor.u64("chunk length")
    inner = cursor.within("message index offsets")
    offsets: dict[int, int] = {}
    while inner.position < inner.end:
        channel = inner.u16("channel id")
        offsets[channel] = inner.u64("offset")
    return ChunkIndexRecord(
        start,
        end,
        offset,
        length,
        offsets,
        cursor.u64("message index length"),
        cursor.text("compression"),
        cursor.u64("compressed size"),
        cursor.u64("uncompressed size"),
    )


def parse_message_index(content: bytes | memoryview) -> tuple[int, list[tuple[int, int]]]:
    """MessageIndex: channel id and (log time, offset in the chunk) of each message."""
    cursor = Cursor(content)
    channel = cursor.u16("channel id")
    inner = cursor.within("records")
    entries: list[tuple[int, int]] = []
    while inner.position < inner.end:
        time = inner.u64("log time")
        entries.append((time, inner.u64("offset")))
    return channel, entries


def parse_attachment_index(content: bytes | memoryview) -> AttachmentIndexRecord:
    """AttachmentIndex: place, times, size, name, media type."""
    cursor = Cursor(content)
    return AttachmentIndexRecord(
        cursor.u64("offset"),
        cursor.u64("length"),
        cursor.u64("log time"),
        cursor.u64("create time"),
        cursor.u64("data size"),
        cursor.text("name"),
        cursor.text("media type"),
    )


def parse_metadata(content: bytes | memoryview) -> tuple[str, dict[str, str]]:
    """Metadata: name and values."""
    cursor = Cursor(content)
    return cursor.text("name"), cursor.texts("metadata")


def parse_metadata_index(content: bytes | memoryview) -> MetadataIndexRecord:
    """MetadataIndex: place and name."""
    cursor = Cursor(content)
    return MetadataIndexRecord(
        cursor.u64("offset"), cursor.u64("length"), cursor.text("name")
    )


def parse_statistics(content: bytes | memoryview) -> StatisticsRecord:
    """Statistics: counts and times."""
    cursor = Cursor(content)
    messages, schemas = cursor.u64("message count"), cursor.u16("schema count")
    channels, attachments = cursor.u32("channel count"), cursor.u32("attachment count")
    metadata, chunks = cursor.u32("metadata count"), cursor.u32("chunk count")
    start, end = cursor.u64("start time"), cursor.u64("end time")
    inner = cursor.within("channel message counts")
    counts: dict[int, int] = {}
    while inner.position < inner.end:
        channel = inner.u16("channel id")
        counts[channel] = inner.u64("message count")
    return StatisticsRecord(
        messages, schemas, channels, attachments, metadata, chunks, start, end, counts
    )


def parse_header(content: bytes | memoryview) -> tuple[str, str]:
    """Header: profile and library."""
    cursor = Cursor(content)
    return cursor.text("profile"), cursor.text("library")


def parse_data_end(content: bytes | memoryview) -> int:
    """DataEnd: the CRC of everything before it, 0 where there is none."""
    return Cursor(content).u32("data section CRC")


def parse_checksums(content: bytes | memoryview) -> dict[tuple[int, int], int]:
    """Checksums (see `recorders.log.encoding.encode_checksums`): CRC-32 by (offset, length)."""
    cursor = Cursor(content)
    checksums: dict[tuple[int, int], int] = {}
    while cursor.position < cursor.end:
        place = cursor.u64("offset"), cursor.u64("length")
        checksums[place] = cursor.u32("CRC")
    return checksums
