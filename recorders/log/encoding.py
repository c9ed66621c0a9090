"""The bytes of MCAP records: serialisation."""

from __future__ import annotations

import struct
from collections.abc import Iterable, Mapping

from recorders.log import wire


def record(opcode: int, *fields: bytes) -> bytes:
    """A whole record from its serialised fields."""
    content = b"".join(fields)
    return wire.PREFIX.pack(opcode, len(content)) + content


def text(value: str) -> bytes:
    """A string with its length before it."""
    raw = value.encode("utf-8")
    return wire.U32.pack(len(raw)) + raw


def texts(values: Mapping[str, str]) -> bytes:
    """A map from strings to strings, keys sorted."""
    content = b"".join(text(key) + text(values[key]) for key in sorted(values))
    return wire.U32.pack(len(content)) + content


def encode_schema(identity: int, name: str, encoding: str, data: bytes) -> bytes:
    """A Schema record."""
    return record(
        wire.SCHEMA,
        wire.U16.pack(identity),
        text(name),
        text(encoding),
        wire.U32.pack(len(data)),
        data,
    )


def encode_channel(
    identity: int, schema_id: int, topic: str, encoding: str, metadata: Mapping[str, str]
) -> bytes:
    """A Channel record."""
    return record(
        wire.CHANNEL,
        wire.U16.pack(identity),
        wire.U16.pack(schema_id),
        text(topic),
        text(encoding),
        texts(metadata),
    )


def encode_chunk_index(index: wire.ChunkIndexRecord) -> bytes:
    """A ChunkIndex record."""
    offsets = b"".join(
        wire.U16.pack(k) + wire.U64.pack(v)
        for k, v in sorted(index.message_index_offsets.items())
    )
    return record(
        wire.CHUNK_INDEX,
        struct.pack(
            "<QQQQI", index.start_ns, index.end_ns, index.offset, index.length, len(offsets)
        ),
        offsets,
        wire.U64.pack(index.message_index_length),
        text(index.compression),
        struct.pack("<QQ", index.compressed_size, index.uncompressed_size),
    )


def encode_attachment_index(index: wire.AttachmentIndexRecord) -> bytes:
    """An AttachmentIndex record."""
    head = struct.pack(
        "<QQQQQ",
        index.offset,
        index.length,
        index.log_time_ns,
        index.create_time_ns,
        index.data_size,
    )
    return record(wire.ATTACHMENT_INDEX, head, text(index.name), text(index.media_type))


def encode_statistics(statistics: wire.StatisticsRecord) -> bytes:
    """A Statistics record."""
    counts = b"".join(
        wire.U16.pack(k) + wire.U64.pack(v)
        for k, v in sorted(statistics.channel_message_counts.items())
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
    return record(wire.STATISTICS, head, counts)


def encode_checksums(checksums: Iterable[tuple[int, int, int]]) -> bytes:
    """A Checksums record: (offset, length, CRC-32) of each header and metadata record of the data
    section.

    MCAP gives chunks, attachments and the summary a CRC of their own; a header or metadata record
    has only that of the whole data section, so that checking a few hundred bytes would mean
    reading the whole file. This record closes the gap; it stands in the summary, under the
    summary's CRC.
    """
    return record(
        wire.CHECKSUMS, b"".join(struct.pack("<QQI", *entry) for entry in checksums)
    )
