"""MCAP's records, each parsed and encoded in one place.

Parsing is strict: the `mcap` package's parsers read past a record's end, or overrun a map's
declared length, without an error; these do not, and say what is wrong. Bytes after a record's known
fields are allowed (the specification reserves them for extensions).
"""

from __future__ import annotations

import struct
import sys
import zlib
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from recorders.log import wire
from recorders.log.model import Attachment


def parse_header(content: bytes | memoryview) -> tuple[str, str]:
    """Header: profile and library."""
    cursor = wire.Cursor(content)
    return cursor.text("profile"), cursor.text("library")


def encode_header(profile: str, library: str) -> bytes:
    """A Header record."""
    return wire.record(wire.HEADER, wire.text(profile), wire.text(library))


@dataclass(frozen=True, slots=True)
class SchemaRecord:
    """A Schema record."""

    id: int
    name: str
    encoding: str
    data: bytes


def parse_schema(content: bytes | memoryview) -> SchemaRecord:
    """Schema: id (never 0), name, encoding, data."""
    cursor = wire.Cursor(content)
    identity = cursor.u16("id")
    if identity == 0:
        raise wire.WireError("schema id 0 is reserved for channels without a schema")
    name = cursor.text("name")
    encoding = cursor.text("encoding")
    return SchemaRecord(
        identity, name, encoding, cursor.take(cursor.u32("length of data"), "data")
    )


def encode_schema(identity: int, name: str, encoding: str, data: bytes) -> bytes:
    """A Schema record."""
    return wire.record(
        wire.SCHEMA,
        wire.U16.pack(identity),
        wire.text(name),
        wire.text(encoding),
        wire.U32.pack(len(data)),
        data,
    )


@dataclass(frozen=True, slots=True)
class ChannelRecord:
    """A Channel record."""

    id: int
    schema_id: int
    topic: str
    message_encoding: str
    metadata: dict[str, str]


def parse_channel(content: bytes | memoryview) -> ChannelRecord:
    """Channel: id, schema id, topic, message encoding, metadata."""
    cursor = wire.Cursor(content)
    return ChannelRecord(
        cursor.u16("id"),
        cursor.u16("schema id"),
        cursor.text("topic"),
        cursor.text("message encoding"),
        cursor.texts("metadata"),
    )


def encode_channel(
    identity: int, schema_id: int, topic: str, encoding: str, metadata: Mapping[str, str]
) -> bytes:
    """A Channel record."""
    return wire.record(
        wire.CHANNEL,
        wire.U16.pack(identity),
        wire.U16.pack(schema_id),
        wire.text(topic),
        wire.text(encoding),
        wire.texts(metadata),
    )


class MessageHead(NamedTuple):
    """A Message record without its payload.

    Where messages are read or written by the million, `wire.MESSAGE_HEAD` is used directly.
    """

    channel_id: int
    sequence: int
    log_time_ns: int
    publish_time_ns: int


def parse_message_head(content: bytes | memoryview) -> MessageHead:
    """The fields before a message's payload."""
    cursor = wire.Cursor(content)
    return MessageHead(
        cursor.u16("channel id"),
        cursor.u32("sequence"),
        cursor.u64("log time"),
        cursor.u64("publish time"),
    )


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


def parse_chunk_head(content: bytes | memoryview, length: int) -> ChunkHead:
    """The fields before a chunk's data; ``length`` is the whole record's, ``content`` may hold
    less than that.
    """
    cursor = wire.Cursor(content)
    start, end = cursor.u64("start time"), cursor.u64("end time")
    size, crc = cursor.u64("uncompressed size"), cursor.u32("uncompressed CRC")
    compression = cursor.text("compression")
    data_size = cursor.u64("length of the data")
    if data_size > length - cursor.position:
        raise wire.WireError(
            f"data of {data_size} bytes reaches past the end of the record"
        )
    return ChunkHead(start, end, size, crc, compression, cursor.position, data_size)


def encode_chunk_head(
    start_ns: int, end_ns: int, data: bytes | bytearray, compression: str, packed_size: int
) -> bytes:
    """A Chunk record up to its packed data, for the unpacked ``data``."""
    head = wire.CHUNK_HEAD.pack(start_ns, end_ns, len(data), zlib.crc32(data))
    head += wire.text(compression) + wire.U64.pack(packed_size)
    return wire.PREFIX.pack(wire.CHUNK, len(head) + packed_size) + head


def parse_message_index(content: bytes | memoryview) -> tuple[int, list[tuple[int, int]]]:
    """MessageIndex: channel id and (log time, offset in the chunk) of each message."""
    cursor = wire.Cursor(content)
    channel = cursor.u16("channel id")
    inner = cursor.within("records")
    entries: list[tuple[int, int]] = []
    while inner.position < inner.end:
        time = inner.u64("log time")
        entries.append((time, inner.u64("offset")))
    return channel, entries


def encode_message_index(identity: int, entries: array[int]) -> bytes:
    """A MessageIndex record of a channel: log times and offsets in turns."""
    if sys.byteorder == "big":
        entries = array("Q", entries)
        entries.byteswap()
    raw = entries.tobytes()
    return wire.record(
        wire.MESSAGE_INDEX, wire.U16.pack(identity), wire.U32.pack(len(raw)), raw
    )


@dataclass(frozen=True, slots=True)
class ChunkIndexRecord:
    """A ChunkIndex record; ``offsets`` are those of the message indexes, as they stand in it."""

    start_ns: int
    end_ns: int
    offset: int
    length: int
    offsets: bytes
    message_index_length: int
    compression: str
    compressed_size: int
    uncompressed_size: int

    @property
    def message_index_offsets(self) -> dict[int, int]:
        """Where each channel's message index stands, by channel id."""
        return dict(wire.CHANNEL_OFFSET.iter_unpack(self.offsets))


def packed_offsets(places: Mapping[int, int]) -> bytes:
    """``offsets`` of a `ChunkIndexRecord`."""
    return b"".join(wire.CHANNEL_OFFSET.pack(k, places[k]) for k in sorted(places))


def parse_chunk_index(content: bytes | memoryview) -> ChunkIndexRecord:
    """ChunkIndex: times, place, message index offsets by channel, sizes."""
    # Long logs have a hundred thousand of them: what each holds is small.
    cursor = wire.Cursor(content)
    start, end, offset, length = cursor.numbers(wire.FOUR_U64, "times and place")
    inner = cursor.within("message index offsets")
    offsets = bytes(content[inner.position : inner.end])
    if len(offsets) % wire.CHANNEL_OFFSET.size:
        raise wire.WireError("its message index offsets end within an entry")
    return ChunkIndexRecord(
        start,
        end_ns=end,
        offset=offset,
        length=length,
        offsets=offsets,
        message_index_length=cursor.u64("message index length"),
        compression=sys.intern(cursor.text("compression")),
        compressed_size=cursor.u64("compressed size"),
        uncompressed_size=cursor.u64("uncompressed size"),
    )


def encode_chunk_index(index: ChunkIndexRecord) -> bytes:
    """A ChunkIndex record."""
    return wire.record(
        wire.CHUNK_INDEX,
        struct.pack(
            "<QQQQI",
            index.start_ns,
            index.end_ns,
            index.offset,
            index.length,
            len(index.offsets),
        ),
        index.offsets,
        wire.U64.pack(index.message_index_length),
        wire.text(index.compression),
        struct.pack("<QQ", index.compressed_size, index.uncompressed_size),
    )


def encode_attachment_head(
    name: str, media_type: str, data: bytes, log_time_ns: int, create_time_ns: int
) -> bytes:
    """An Attachment record up to its data; the data and `encode_attachment_crc` follow."""
    fields = struct.pack("<QQ", log_time_ns, create_time_ns)
    fields += wire.text(name) + wire.text(media_type) + wire.U64.pack(len(data))
    length = len(fields) + len(data) + wire.U32.size
    return wire.PREFIX.pack(wire.ATTACHMENT, length) + fields


def encode_attachment_crc(head: bytes, data: bytes) -> bytes:
    """What stands behind an attachment's data: the CRC-32 of all fields before it."""
    fields = memoryview(head)[wire.PREFIX_BYTES :]
    return wire.U32.pack(zlib.crc32(data, zlib.crc32(fields)))


def parse_attachment(content: bytes) -> Attachment:
    """Attachment: times, name, media type, data, the CRC checked where there is one."""
    cursor = wire.Cursor(content)
    log_time, create_time = cursor.u64("log time"), cursor.u64("create time")
    name, media_type = cursor.text("name"), cursor.text("media type")
    data = cursor.take(cursor.u64("length of the data"), "data")
    fields_end = cursor.position
    crc = cursor.u32("CRC")
    if crc and zlib.crc32(memoryview(content)[:fields_end]) != crc:
        raise wire.WireError("the attachment's CRC differs: it is damaged")
    return Attachment(name, media_type, log_time, create_time, data)


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


def parse_attachment_index(content: bytes | memoryview) -> AttachmentIndexRecord:
    """AttachmentIndex: place, times, size, name, media type."""
    cursor = wire.Cursor(content)
    return AttachmentIndexRecord(
        cursor.u64("offset"),
        cursor.u64("length"),
        cursor.u64("log time"),
        cursor.u64("create time"),
        cursor.u64("data size"),
        cursor.text("name"),
        cursor.text("media type"),
    )


def encode_attachment_index(index: AttachmentIndexRecord) -> bytes:
    """An AttachmentIndex record."""
    head = struct.pack(
        "<QQQQQ",
        index.offset,
        index.length,
        index.log_time_ns,
        index.create_time_ns,
        index.data_size,
    )
    return wire.record(
        wire.ATTACHMENT_INDEX, head, wire.text(index.name), wire.text(index.media_type)
    )


def parse_metadata(content: bytes | memoryview) -> tuple[str, dict[str, str]]:
    """Metadata: name and values."""
    cursor = wire.Cursor(content)
    return cursor.text("name"), cursor.texts("metadata")


def encode_metadata(name: str, values: Mapping[str, str]) -> bytes:
    """A Metadata record, keys sorted."""
    return wire.record(wire.METADATA, wire.text(name), wire.texts(values))


@dataclass(frozen=True, slots=True)
class MetadataIndexRecord:
    """A MetadataIndex record."""

    offset: int
    length: int
    name: str


def parse_metadata_index(content: bytes | memoryview) -> MetadataIndexRecord:
    """MetadataIndex: place and name."""
    cursor = wire.Cursor(content)
    return MetadataIndexRecord(
        cursor.u64("offset"), cursor.u64("length"), cursor.text("name")
    )


def encode_metadata_index(index: MetadataIndexRecord) -> bytes:
    """A MetadataIndex record."""
    return wire.record(
        wire.METADATA_INDEX,
        struct.pack("<QQ", index.offset, index.length),
        wire.text(index.name),
    )


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


def parse_statistics(content: bytes | memoryview) -> StatisticsRecord:
    """Statistics: counts and times."""
    cursor = wire.Cursor(content)
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
        messages,
        schema_count=schemas,
        channel_count=channels,
        attachment_count=attachments,
        metadata_count=metadata,
        chunk_count=chunks,
        start_ns=start,
        end_ns=end,
        channel_message_counts=counts,
    )


def encode_statistics(statistics: StatisticsRecord) -> bytes:
    """A Statistics record."""
    counts = b"".join(
        wire.U16.pack(k) + wire.U64.pack(count)
        for k, count in sorted(statistics.channel_message_counts.items())
    )
    head = struct.pack(
        "<QHIIIIQQI",
        statistics.message_count,
        statistics.schema_count,
        statistics.channel_count,
        statistics.attachment_count,
        statistics.metadata_count,
        statistics.chunk_count,
        statistics.start_ns,
        statistics.end_ns,
        len(counts),
    )
    return wire.record(wire.STATISTICS, head, counts)


def parse_checksums(content: bytes | memoryview) -> dict[tuple[int, int], int]:
    """Checksums (see `encode_checksums`): CRC-32 by (offset, length)."""
    cursor = wire.Cursor(content)
    checksums: dict[tuple[int, int], int] = {}
    while cursor.position < cursor.end:
        place = cursor.u64("offset"), cursor.u64("length")
        checksums[place] = cursor.u32("CRC")
    return checksums


def encode_checksums(checksums: Iterable[tuple[int, int, int]]) -> bytes:
    """A Checksums record: (offset, length, CRC-32) of each header and metadata record of the data
    section.

    MCAP gives chunks, attachments and the summary a CRC of their own; a header or metadata record
    has only that of the whole data section, so that checking a few hundred bytes would mean
    reading the whole file. This record closes the gap; it stands in the summary, under the
    summary's CRC.
    """
    return wire.record(
        wire.CHECKSUMS, b"".join(struct.pack("<QQI", *entry) for entry in checksums)
    )


def encode_summary_offset(opcode: int, start: int, length: int) -> bytes:
    """A SummaryOffset record: where the summary's records of one type stand."""
    return wire.record(wire.SUMMARY_OFFSET, struct.pack("<BQQ", opcode, start, length))


def parse_data_end(content: bytes | memoryview) -> int:
    """DataEnd: the CRC of everything before it, 0 where there is none."""
    return wire.Cursor(content).u32("data section CRC")


def encode_data_end(crc: int) -> bytes:
    """A DataEnd record with the CRC of everything before it."""
    return wire.record(wire.DATA_END, wire.U32.pack(crc))


@dataclass(frozen=True, slots=True)
class FooterRecord:
    """The Footer record."""

    summary_start: int
    summary_offset_start: int
    summary_crc: int


def parse_footer(content: bytes) -> FooterRecord:
    """Footer: where the summary and its offsets begin, and the summary's CRC."""
    return FooterRecord(*wire.FOOTER_BODY.unpack(content))


def encode_footer(summary_start: int, offsets_start: int, before: bytes) -> bytes:
    """A Footer record behind ``before``, the summary's bytes, whose CRC reaches into it."""
    head = wire.PREFIX.pack(wire.FOOTER, wire.FOOTER_BODY.size)
    head += struct.pack("<QQ", summary_start, offsets_start)
    return head + wire.U32.pack(zlib.crc32(head, zlib.crc32(before)))
