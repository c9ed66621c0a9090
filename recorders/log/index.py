"""Where everything stands in a log, from its summary where that can be trusted, else from one scan.

The summary is trusted when its CRC is there and right, when its statistics count what it lists (chunks, attachments,
metadata records, no more channels and schemas than there are), and when what it lists tiles the data section: every
byte between the header and the end of the data belongs to a listed record, or to records that hold no messages.
Anything else is scanned: once through the whole file, checking every CRC on the way.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

from recorders.errors import RecordingError
from recorders.log import wire
from recorders.log.blocks import Block, records
from recorders.log.model import ChannelInfo, LogHeader, Schema
from recorders.log.storage import RawRecord, RecordFile

_RUN_BYTES = 1 << 20
_DATA_END_BYTES = wire.PREFIX_BYTES + 4
_RECOVER = "`scenetrace recover` keeps what is whole"


@dataclass(slots=True)
class Definitions:
    """Schemas and channels as they are met in a file, held to their rules."""

    file: RecordFile
    schemas: dict[int, wire.SchemaRecord] = field(default_factory=dict)
    channels: dict[int, wire.ChannelRecord] = field(default_factory=dict)

    def schema(self, found: wire.SchemaRecord, offset: int) -> None:
        """Take in a Schema record."""
        if self.schemas.setdefault(found.id, found) != found:
            raise self.file.error(f"schema {found.id} is defined a second time, differently", offset, "Schema")
        self.file.check_limit(len(self.schemas), "max_channels", "the number of schemas", offset, "Schema")

    def channel(self, found: wire.ChannelRecord, offset: int) -> None:
        """Take in a Channel record."""
        if found.schema_id and found.schema_id not in self.schemas:
            raise self.file.error(
                f"channel {found.id} ({found.topic}) names schema {found.schema_id}, which no record before it defines",
                offset,
                "Channel",
            )
        if self.channels.setdefault(found.id, found) != found:
            raise self.file.error(f"channel {found.id} is defined a second time, differently", offset, "Channel")
        self.file.check_limit(len(self.channels), "max_channels", "the number of channels", offset, "Channel")

    def infos(self, counts: dict[int, int] | None) -> dict[int, ChannelInfo]:
        """The channels by id, in the order of ids."""
        schemas = {s.id: Schema(s.name, s.encoding, s.data) for s in self.schemas.values()}
        return {
            identity: ChannelInfo(
                topic=c.topic,
                schema=schemas.get(c.schema_id),
                message_encoding=c.message_encoding,
                metadata=c.metadata,
                message_count=None if counts is None else counts.get(identity, 0),
                id=identity,
            )
            for identity, c in sorted(self.channels.items())
        }


@dataclass(slots=True)
class LogIndex:
    """Where everything stands in a log. ``data_crc`` is 0 where the file has none."""

    header: LogHeader
    header_record: RawRecord
    footer: wire.FooterRecord
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
    attachment_indexes: list[wire.AttachmentIndexRecord] = field(default_factory=list)


@dataclass(slots=True)
class Summary:
    """The summary section's records."""

    definitions: Definitions
    statistics: wire.StatisticsRecord | None = None
    chunks: list[wire.ChunkIndexRecord] = field(default_factory=list)
    attachments: list[wire.AttachmentIndexRecord] = field(default_factory=list)
    metadata: list[wire.MetadataIndexRecord] = field(default_factory=list)
    checksums: dict[tuple[int, int], int] = field(default_factory=dict)

    @property
    def is_complete(self) -> bool:
        """Its statistics are there and count what it lists, and every channel that is counted or indexed is listed.

        More channels and schemas than counted are fine: some writers list those without messages too.
        """
        counts = self.statistics
        if counts is None:
            return False
        by_channel = counts.channel_message_counts
        mentioned = set(by_channel).union(*(chunk.message_index_offsets for chunk in self.chunks))
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
        raise file.error("this is not an MCAP file (its first bytes are not MCAP's)", 0)
    raw = file.record_at(len(wire.MAGIC))
    if raw.opcode != wire.HEADER:
        raise file.error("the file does not start with a Header record", raw.offset, raw.name)
    return raw


def read_footer(file: RecordFile) -> tuple[wire.FooterRecord, int]:
    """The footer and its offset; an error that speaks of a cut file where there is none."""
    offset = file.size - len(wire.MAGIC) - wire.FOOTER_BYTES
    cut = f"the file has no end: it was cut short, or its writer was killed; {_RECOVER}"
    if offset < len(wire.MAGIC) or file.read(file.size - 8, 8) != wire.MAGIC:
        raise file.error(cut, file.size)
    opcode, length = wire.PREFIX.unpack(file.read(offset, wire.PREFIX_BYTES))
    if opcode != wire.FOOTER or length != wire.FOOTER_BODY.size:
        raise file.error(cut, offset)
    footer = wire.FooterRecord(*wire.FOOTER_BODY.unpack(file.read(offset + wire.PREFIX_BYTES, length)))
    if footer.summary_start > offset or footer.summary_offset_start > offset:
        raise file.error("the footer places the summary after itself", offset, "Footer")
    return footer, offset


def read_summary(file: RecordFile, footer: wire.FooterRecord, footer_offset: int) -> Summary:
    """The summary's records, its CRC checked where there is one."""
    start = footer.summary_start
    summary = Summary(Definitions(file))
    if not start:
        return summary
    file.check_limit(footer_offset - start, "max_summary_bytes", "the summary's size", start)
    if footer.summary_crc:
        crc = file.crc(start, footer_offset + wire.FOOTER_BYTES - 4)
        if crc != footer.summary_crc:
            raise file.error(f"the summary's CRC differs: it is damaged; {_RECOVER}", start, "Footer")
    for raw in file.walk(start, footer_offset):
        _take_summary_record(file, summary, raw)
    return summary


def _take_summary_record(file: RecordFile, summary: Summary, raw: RawRecord) -> None:
    if raw.opcode == wire.SCHEMA:
        summary.definitions.schema(file.parse(wire.parse_schema, raw), raw.offset)
    elif raw.opcode == wire.CHANNEL:
        found = file.parse(wire.parse_channel, raw)
        # Some writers repeat channels but not schemas: such a channel is found by scanning.
        if not found.schema_id or found.schema_id in summary.definitions.schemas:
            summary.definitions.channel(found, raw.offset)
    elif raw.opcode == wire.STATISTICS:
        summary.statistics = file.parse(wire.parse_statistics, raw)
    elif raw.opcode == wire.CHUNK_INDEX:
        summary.chunks.append(file.parse(wire.parse_chunk_index, raw))
    elif raw.opcode == wire.ATTACHMENT_INDEX:
        summary.attachments.append(file.parse(wire.parse_attachment_index, raw))
    elif raw.opcode == wire.METADATA_INDEX:
        summary.metadata.append(file.parse(wire.parse_metadata_index, raw))
    elif raw.opcode == wire.CHECKSUMS:
        summary.checksums = file.parse(wire.parse_checksums, raw)


def build_index(file: RecordFile) -> LogIndex:
    """Find everything in the log; raises `RecordingError` where it cannot be read as a whole."""
    header_record = check_start(file)
    footer, footer_offset = read_footer(file)
    summary = read_summary(file, footer, footer_offset)
    profile, library = file.parse(wire.parse_header, header_record)
    header = LogHeader(profile, library)
    if footer.summary_crc and summary.is_complete:
        data_end = _data_end_before(file, footer.summary_start)
        if data_end is not None and _tiles(file, summary, header_record.end, data_end.offset):
            return _from_summary(file, summary, header, header_record, footer, footer_offset, data_end)
    return _Scan(file, summary).run(header, header_record, footer, footer_offset)


def _data_end_before(file: RecordFile, summary_start: int) -> RawRecord | None:
    offset = summary_start - _DATA_END_BYTES
    if offset < len(wire.MAGIC) or file.read(offset, wire.PREFIX_BYTES) != wire.PREFIX.pack(wire.DATA_END, 4):
        return None
    return RawRecord(wire.DATA_END, offset, 4)


def _tiles(file: RecordFile, summary: Summary, start: int, end: int) -> bool:
    """Whether what the summary lists leaves no message, attachment or metadata record unlisted."""
    spans = sorted(
        [(c.offset, c.offset + c.length + c.message_index_length) for c in summary.chunks]
        + [(a.offset, a.offset + a.length) for a in summary.attachments]
        + [(m.offset, m.offset + m.length) for m in summary.metadata]
    )
    position = start
    for low, high in [*spans, (end, end)]:
        if low < position or high > end:
            return False
        try:
            for raw in file.walk(position, low):
                if raw.opcode not in (wire.SCHEMA, wire.CHANNEL, wire.MESSAGE_INDEX):
                    return False
        except RecordingError:
            return False
        position = high
    return True


def _from_summary(
    file: RecordFile,
    summary: Summary,
    header: LogHeader,
    header_record: RawRecord,
    footer: wire.FooterRecord,
    footer_offset: int,
    data_end: RawRecord,
) -> LogIndex:
    statistics = summary.statistics
    assert statistics is not None
    blocks = [
        Block(
            offset=c.offset,
            length=c.length,
            start_ns=c.start_ns,
            end_ns=c.end_ns,
            channels=frozenset(c.message_index_offsets) if c.message_index_length else None,
            chunked=True,
            index=c,
        )
        for c in summary.chunks
    ]
    some = statistics.message_count > 0
    return LogIndex(
        header=header,
        header_record=header_record,
        footer=footer,
        footer_offset=footer_offset,
        data_end=data_end,
        data_crc=file.parse(wire.parse_data_end, data_end),
        channels=summary.definitions.infos(statistics.channel_message_counts),
        blocks=blocks,
        attachments=[_placed(wire.ATTACHMENT, a.offset, a.length) for a in summary.attachments],
        metadata=[_placed(wire.METADATA, m.offset, m.length) for m in summary.metadata],
        message_count=statistics.message_count,
        start_ns=statistics.start_ns if some else None,
        end_ns=statistics.end_ns if some else None,
        checksums=summary.checksums,
        data_checked=False,
        scanned=False,
        attachment_indexes=summary.attachments,
    )


def _placed(opcode: int, offset: int, length: int) -> RawRecord:
    return RawRecord(opcode, offset, length - wire.PREFIX_BYTES)


class _Scan:
    """One pass over the data section. Memory: one chunk, and one entry per chunk or run of messages."""

    def __init__(self, file: RecordFile, summary: Summary) -> None:
        self.file = file
        self.summary = summary
        self.definitions = Definitions(file)
        self.counts: dict[int, int] = {}
        self.blocks: list[Block] = []
        self.attachments: list[RawRecord] = []
        self.metadata: list[RawRecord] = []
        self._run_start: int | None = None
        self._run_times: list[int] = []
        self._run_channels: set[int] = set()

    def run(
        self, header: LogHeader, header_record: RawRecord, footer: wire.FooterRecord, footer_offset: int
    ) -> LogIndex:
        """Scan, check the CRC of the data section, and put the index together."""
        data_end = self._walk(header_record.end, footer.summary_start or footer_offset)
        crc = self.file.parse(wire.parse_data_end, data_end)
        if crc and self.file.crc(0, data_end.offset) != crc:
            raise self.file.error(
                "the CRC of the data section differs: the file is damaged", data_end.offset, "DataEnd"
            )
        for schema in self.summary.definitions.schemas.values():
            self.definitions.schema(schema, footer.summary_start)
        for channel in self.summary.definitions.channels.values():
            self.definitions.channel(channel, footer.summary_start)
        filled = [block for block in self.blocks if block.channels]
        return LogIndex(
            header=header,
            header_record=header_record,
            footer=footer,
            footer_offset=footer_offset,
            data_end=data_end,
            data_crc=crc,
            channels=self.definitions.infos(self.counts),
            blocks=filled,
            attachments=self.attachments,
            metadata=self.metadata,
            message_count=sum(self.counts.values()),
            start_ns=min((block.start_ns for block in filled), default=None),
            end_ns=max((block.end_ns for block in filled), default=None),
            checksums={},
            data_checked=True,
            scanned=True,
        )

    def _walk(self, start: int, end: int) -> RawRecord:
        for raw in self.file.walk(start, end):
            if raw.opcode == wire.MESSAGE:
                self._loose_message(raw)
                continue
            if raw.opcode == wire.SCHEMA:
                self.definitions.schema(self.file.parse(wire.parse_schema, raw), raw.offset)
                continue
            if raw.opcode == wire.CHANNEL:
                self.definitions.channel(self.file.parse(wire.parse_channel, raw), raw.offset)
                continue
            self._close_run(raw.offset)
            if raw.opcode == wire.DATA_END:
                return raw
            if raw.opcode == wire.CHUNK:
                self._chunk(raw)
            elif raw.opcode == wire.ATTACHMENT:
                self.attachments.append(raw)
            elif raw.opcode == wire.METADATA:
                self.metadata.append(raw)
        raise self.file.error("the data section has no DataEnd record", end)

    def _loose_message(self, raw: RawRecord) -> None:
        if raw.length < wire.MESSAGE_FIELDS_BYTES:
            raise self.file.error("a message shorter than its fields", raw.offset, "Message")
        limit = self.file.limits.max_message_bytes + wire.MESSAGE_FIELDS_BYTES
        if raw.length > limit:
            self.file.check_limit(
                raw.length - wire.MESSAGE_FIELDS_BYTES, "max_message_bytes", "a message's size", raw.offset, "Message"
            )
        if self._run_start is not None and raw.end - self._run_start > _RUN_BYTES:
            self._close_run(raw.offset)
        if self._run_start is None:
            self._run_start = raw.offset
        head = wire.MESSAGE_HEAD.unpack(self.file.read(raw.offset, wire.MESSAGE_HEAD.size))
        self._count(head[2], raw.offset)
        self._run_channels.add(head[2])
        self._run_times.append(head[4])

    def _count(self, channel_id: int, offset: int) -> None:
        if channel_id not in self.definitions.channels:
            raise self.file.error(
                f"a message is of channel {channel_id}, which no Channel record before it defines", offset, "Message"
            )
        self.counts[channel_id] = self.counts.get(channel_id, 0) + 1

    def _close_run(self, end: int) -> None:
        if self._run_start is not None:
            self._add(self._run_start, end - self._run_start, self._run_times, self._run_channels, chunked=False)
        self._run_start = None
        self._run_times = []
        self._run_channels = set()

    def _add(self, offset: int, length: int, times: list[int], channels: Iterable[int], *, chunked: bool) -> None:
        low, high = (min(times), max(times)) if times else (0, 0)
        self.blocks.append(Block(offset, length, low, high, frozenset(channels), chunked))

    def _chunk(self, raw: RawRecord) -> None:
        head = self.file.chunk_head(raw)
        data = self.file.unpack(raw, head)
        times: list[int] = []
        channels: set[int] = set()
        try:
            for opcode, position, length in records(data):
                if opcode == wire.MESSAGE:
                    if length < wire.MESSAGE_FIELDS_BYTES:
                        raise wire.WireError(f"the message at {position} is shorter than its fields")
                    fields = wire.MESSAGE_HEAD.unpack_from(data, position)
                    self._count(fields[2], raw.offset)
                    channels.add(fields[2])
                    times.append(fields[4])
                elif opcode in (wire.SCHEMA, wire.CHANNEL):
                    content = data[position + wire.PREFIX_BYTES : position + wire.PREFIX_BYTES + length]
                    self._define(opcode, content, raw.offset)
        except wire.WireError as error:
            raise self.file.error(str(error), raw.offset, raw.name) from error
        self._add(raw.offset, raw.end - raw.offset, times, channels, chunked=True)

    def _define(self, opcode: int, content: bytes, offset: int) -> None:
        if opcode == wire.SCHEMA:
            self.definitions.schema(wire.parse_schema(content), offset)
        else:
            self.definitions.channel(wire.parse_channel(content), offset)
