"""A log's outline: header, footer, summary, and the index made of them."""

from __future__ import annotations

from dataclasses import dataclass, field

from recorders.log import records, wire
from recorders.log.blocks import Block
from recorders.log.model import ChannelInfo, LogHeader, Schema
from recorders.log.storage import RawRecord, RecordFile

_FAR = 1 << 20
"""Bytes behind a file's end among which the end is looked for."""
_RECOVER = "`scenetrace recover` keeps what is whole"


@dataclass(slots=True)
class Definitions:
    """Schemas and channels as they are met in a file, held to their rules."""

    file: RecordFile
    schemas: dict[int, records.SchemaRecord] = field(default_factory=dict)
    channels: dict[int, records.ChannelRecord] = field(default_factory=dict)

    def schema(self, found: records.SchemaRecord, offset: int) -> None:
        """Take in a Schema record."""
        if self.schemas.setdefault(found.id, found) != found:
            raise self.file.error(
                f"schema {found.id} is defined a second time, differently", offset, "Schema"
            )
        self.file.check_limit(
            len(self.schemas), "max_channels", "the number of schemas", offset, "Schema"
        )

    def channel(self, found: records.ChannelRecord, offset: int) -> None:
        """Take in a Channel record."""
        if found.schema_id and found.schema_id not in self.schemas:
            raise self.file.error(
                f"channel {found.id} ({found.topic}) names schema {found.schema_id}, which"
                " no record before it defines",
                offset,
                "Channel",
            )
        if self.channels.setdefault(found.id, found) != found:
            raise self.file.error(
                f"channel {found.id} is defined a second time, differently",
                offset,
                "Channel",
            )
        self.file.check_limit(
            len(self.channels), "max_channels", "the number of channels", offset, "Channel"
        )

    def infos(self, counts: dict[int, int] | None) -> dict[int, ChannelInfo]:
        """The channels by id, in the order of ids."""
        schemas = {
            schema.id: Schema(schema.name, schema.encoding, schema.data)
            for schema in self.schemas.values()
        }
        return {
            identity: ChannelInfo(
                topic=channel.topic,
                schema=schemas.get(channel.schema_id),
                message_encoding=channel.message_encoding,
                metadata=channel.metadata,
                message_count=None if counts is None else counts.get(identity, 0),
                id=identity,
            )
            for identity, channel in sorted(self.channels.items())
        }


@dataclass(slots=True)
class LogIndex:
    """Where everything stands in a log. ``data_crc`` is 0 where the file has none."""

    header: LogHeader
    header_record: RawRecord
    footer: records.FooterRecord
    footer_offset: int
    data_end: RawRecord
    data_crc: int
    channels: dict[int, ChannelInfo]
    blocks: list[Block]
    attachments: list[RawRecord]
    metadata: list[RawRecord]
    message_count: int
    start_ns: int | None
    end_ns: int | None
    checksums: dict[tuple[int, int], int]
    data_checked: bool
    scanned: bool
    attachment_indexes: list[records.AttachmentIndexRecord] = field(default_factory=list)


@dataclass(slots=True)
class Summary:
    """The summary section's records."""

    definitions: Definitions
    statistics: records.StatisticsRecord | None = None
    chunks: list[records.ChunkIndexRecord] = field(default_factory=list)
    attachments: list[records.AttachmentIndexRecord] = field(default_factory=list)
    metadata: list[records.MetadataIndexRecord] = field(default_factory=list)
    checksums: dict[tuple[int, int], int] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        """Its statistics are there and count what it lists, and every channel that is counted or
        indexed is listed.

        More channels and schemas than counted are fine: some writers list those without messages
        too.
        """
        counts = self.statistics
        if counts is None:
            return False
        by_channel = counts.channel_message_counts
        mentioned = set(by_channel).union(
            *(chunk.message_index_offsets for chunk in self.chunks)
        )
        return (
            (counts.chunk_count, counts.attachment_count, counts.metadata_count)
            == (len(self.chunks), len(self.attachments), len(self.metadata))
            and counts.channel_count <= len(self.definitions.channels)
            and counts.schema_count <= len(self.definitions.schemas)
            and mentioned <= set(self.definitions.channels)
            and (not by_channel or sum(by_channel.values()) == counts.message_count)
        )


def check_start(file: RecordFile) -> RawRecord:
    """The header record, after the magic bytes."""
    if file.size == 0:
        raise file.error("the file is empty")
    if file.read(0, min(8, file.size)) != wire.MAGIC:
        raise file.error(f"this is not an MCAP file{what_else(file)}", 0)
    raw = file.record_at(len(wire.MAGIC))
    if raw.opcode != wire.HEADER:
        raise file.error(
            "the file does not start with a Header record", raw.offset, raw.name
        )
    return raw


_OTHERS = (
    (b"\x28\xb5\x2f\xfd", "it is compressed as a whole with zstd: `zstd -d` unpacks it"),
    (b"\x1f\x8b", "it is compressed as a whole with gzip: `gunzip` unpacks it"),
    (b"\x04\x22\x4d\x18", "it is compressed as a whole with LZ4: `lz4 -d` unpacks it"),
    (b"BZh", "it is compressed as a whole with bzip2: `bunzip2` unpacks it"),
    (b"\xfd7zXZ", "it is compressed as a whole with xz: `unxz` unpacks it"),
    (b"7z\xbc\xaf", "it is an archive of 7-Zip: unpack it first"),
    (b"PK\x03\x04", "it is a ZIP archive: `unzip` unpacks it"),
    (b"\x89MCAP0\n", "its line ends were translated, as by FTP in text mode: copy it anew"),
    (
        b"\x89MCAP0\r\r",
        "its line ends were translated, as by FTP in text mode: copy it anew",
    ),
    (b"<", "it is a page or XML, as servers send in place of a file"),
    (
        b"SQLite format 3",
        "it is SQLite, as ROS 2 bags are: `scenetrace record` reads those",
    ),
    (b"#ROSBAG", "it is a ROS 1 bag: `scenetrace record` reads those"),
)


def what_else(file: RecordFile) -> str:
    """What a file that is no MCAP is instead, as the end of a sentence."""
    start = file.read(0, min(16, file.size))
    named = next((name for magic, name in _OTHERS if start.startswith(magic)), None)
    return f": {named}" if named else " (its first bytes are not MCAP's)"


def _end_before(file: RecordFile) -> int | None:
    """Where the file ends before its last byte: a footer with the magic bytes behind it, if one
    is near.
    """
    start = max(len(wire.MAGIC), file.size - _FAR)
    tail = bytes(file.read(start, max(0, file.size - start)))
    footer = wire.PREFIX.pack(wire.FOOTER, wire.FOOTER_BODY.size)
    at = tail.rfind(wire.MAGIC)
    while at >= wire.FOOTER_BYTES:
        if tail.startswith(footer, at - wire.FOOTER_BYTES):
            return start + at + len(wire.MAGIC)
        at = tail.rfind(wire.MAGIC, 0, at)
    return None


def read_footer(file: RecordFile) -> tuple[records.FooterRecord, int]:
    """The footer and its offset; an error that speaks of a cut file where there is none."""
    offset = file.size - len(wire.MAGIC) - wire.FOOTER_BYTES
    cut = f"the file has no end: it was cut short, or its writer was killed; {_RECOVER}"
    ends = offset >= len(wire.MAGIC) and file.read(file.size - 8, 8) == wire.MAGIC
    opcode, length = (
        wire.PREFIX.unpack(file.read(offset, wire.PREFIX_BYTES)) if ends else (0, 0)
    )
    if opcode != wire.FOOTER or length != wire.FOOTER_BODY.size:
        end = _end_before(file)
        if end is not None:
            raise file.error(
                f"{file.size - end} bytes follow the file's end: they are no part of it;"
                f" {_RECOVER}",
                end,
            )
        raise file.error(cut, offset if ends else file.size)
    footer = records.parse_footer(file.read(offset + wire.PREFIX_BYTES, length))
    if footer.summary_start > offset or footer.summary_offset_start > offset:
        raise file.error("the footer places the summary after itself", offset, "Footer")
    return footer, offset


def read_summary(
    file: RecordFile, footer: records.FooterRecord, footer_offset: int
) -> Summary:
    """The summary's records, its CRC checked where there is one."""
    start = footer.summary_start
    summary = Summary(Definitions(file))
    if not start:
        return summary
    file.check_limit(
        footer_offset - start, "max_summary_bytes", "the summary's size", start
    )
    if footer.summary_crc:
        crc = file.crc(start, footer_offset + wire.FOOTER_BYTES - 4)
        if crc != footer.summary_crc:
            raise file.error(
                "the summary's CRC differs: it is damaged, or logs were joined without"
                f" rewriting them; {_RECOVER}",
                start,
                "Footer",
            )
    for raw in file.walk(start, footer_offset):
        _take_summary_record(file, summary, raw)
    return summary


def _take_summary_record(file: RecordFile, summary: Summary, raw: RawRecord) -> None:
    if raw.opcode == wire.SCHEMA:
        summary.definitions.schema(file.parse(records.parse_schema, raw), raw.offset)
    elif raw.opcode == wire.CHANNEL:
        found = file.parse(records.parse_channel, raw)
        # Some writers repeat channels but not schemas: such a channel is found by scanning.
        if not found.schema_id or found.schema_id in summary.definitions.schemas:
            summary.definitions.channel(found, raw.offset)
    elif raw.opcode == wire.STATISTICS:
        summary.statistics = file.parse(records.parse_statistics, raw)
    elif raw.opcode == wire.CHUNK_INDEX:
        summary.chunks.append(file.parse(records.parse_chunk_index, raw))
    elif raw.opcode == wire.ATTACHMENT_INDEX:
        summary.attachments.append(file.parse(records.parse_attachment_index, raw))
    elif raw.opcode == wire.METADATA_INDEX:
        summary.metadata.append(file.parse(records.parse_metadata_index, raw))
    elif raw.opcode == wire.CHECKSUMS:
        summary.checksums = file.parse(records.parse_checksums, raw)
