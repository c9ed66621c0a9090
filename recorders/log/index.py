"""Where everything stands in a log, from its summary where that can be trusted, else from one scan.

The summary is trusted when its CRC is there and right, when its statistics count what it lists
(chunks, attachments, metadata records, no more channels and schemas than there are), and when
what it lists tiles the data section: every byte between the header and the end of the data
belongs to a listed record, or to records that hold no messages. Anything else is scanned: once
through the whole file, checking every CRC on the way.
"""

from __future__ import annotations

from recorders.errors import RecordingError
from recorders.log import records, wire
from recorders.log.blocks import Block
from recorders.log.layout import LogIndex, Summary, check_start, read_footer, read_summary
from recorders.log.model import LogHeader
from recorders.log.scan import Scan
from recorders.log.storage import RawRecord, RecordFile

_DATA_END_BYTES = wire.PREFIX_BYTES + 4


def build_index(file: RecordFile) -> LogIndex:
    """Find everything in the log; raises `RecordingError` where it cannot be read as a whole."""
    header_record = check_start(file)
    footer, footer_offset = read_footer(file)
    summary = read_summary(file, footer, footer_offset)
    profile, library = file.parse(records.parse_header, header_record)
    header = LogHeader(profile, library)
    if footer.summary_crc and summary.is_complete:
        data_end = _data_end_before(file, footer.summary_start)
        if data_end is not None and _tiles(
            file, summary, header_record.end, data_end.offset
        ):
            return _from_summary(
                file, summary, header, header_record, footer, footer_offset, data_end
            )
    return Scan(file, summary).run(header, header_record, footer, footer_offset)


def _data_end_before(file: RecordFile, summary_start: int) -> RawRecord | None:
    offset = summary_start - _DATA_END_BYTES
    if offset < len(wire.MAGIC) or file.read(offset, wire.PREFIX_BYTES) != wire.PREFIX.pack(
        wire.DATA_END, 4
    ):
        return None
    return RawRecord(wire.DATA_END, offset, 4)


def _tiles(file: RecordFile, summary: Summary, start: int, end: int) -> bool:
    """Whether what the summary lists leaves no message, attachment or metadata record unlisted."""
    spans = sorted(
        [
            (chunk.offset, chunk.offset + chunk.length + chunk.message_index_length)
            for chunk in summary.chunks
        ]
        + [
            (attachment.offset, attachment.offset + attachment.length)
            for attachment in summary.attachments
        ]
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
    footer: records.FooterRecord,
    footer_offset: int,
    data_end: RawRecord,
) -> LogIndex:
    statistics = summary.statistics
    assert statistics is not None
    # Most chunks hold the same channels: one set for all of them.
    shared: dict[frozenset[int], frozenset[int]] = {}

    def channels(chunk: records.ChunkIndexRecord) -> frozenset[int] | None:
        found = frozenset(chunk.message_index_offsets)
        return shared.setdefault(found, found) if chunk.message_index_length else None

    blocks = [
        Block(
            offset=chunk.offset,
            length=chunk.length,
            start_ns=chunk.start_ns,
            end_ns=chunk.end_ns,
            channels=channels(chunk),
            chunked=True,
            index=chunk,
        )
        for chunk in summary.chunks
    ]
    some = statistics.message_count > 0
    start_ns, end_ns = _span(blocks)
    return LogIndex(
        header=header,
        header_record=header_record,
        footer=footer,
        footer_offset=footer_offset,
        data_end=data_end,
        data_crc=file.parse(records.parse_data_end, data_end),
        channels=summary.definitions.infos(statistics.channel_message_counts),
        blocks=blocks,
        attachments=[
            _placed(wire.ATTACHMENT, attachment.offset, attachment.length)
            for attachment in summary.attachments
        ],
        metadata=[_placed(wire.METADATA, m.offset, m.length) for m in summary.metadata],
        message_count=statistics.message_count,
        start_ns=start_ns if some else None,
        end_ns=end_ns if some else None,
        checksums=summary.checksums,
        data_checked=False,
        scanned=False,
        attachment_indexes=summary.attachments,
    )


def _span(blocks: list[Block]) -> tuple[int | None, int | None]:
    """The earliest and the latest log time, by the chunks: statistics may say anything. A chunk
    without messages says 0 of both.
    """
    filled = [block for block in blocks if block.channels or block.end_ns] or blocks
    return (
        min((b.start_ns for b in filled), default=None),
        max((b.end_ns for b in filled), default=None),
    )


def _placed(opcode: int, offset: int, length: int) -> RawRecord:
    return RawRecord(opcode, offset, length - wire.PREFIX_BYTES)
