"""Finding everything in a log by reading it once from front to back."""

from __future__ import annotations

from collections.abc import Iterable

from recorders.log import records, wire
from recorders.log.blocks import Block, walk_records
from recorders.log.layout import Definitions, LogIndex, Summary
from recorders.log.model import LogHeader
from recorders.log.storage import RawRecord, RecordFile

_RUN_BYTES = 1 << 20


class Scan:
    """One pass over the data section. Memory: one chunk, and one entry per chunk or run of
    messages.
    """

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
        self,
        header: LogHeader,
        header_record: RawRecord,
        footer: records.FooterRecord,
        footer_offset: int,
    ) -> LogIndex:
        """Scan, check the CRC of the data section, and put the index together."""
        data_end = self._walk(header_record.end, footer.summary_start or footer_offset)
        crc = self.file.parse(records.parse_data_end, data_end)
        if crc and self.file.crc(0, data_end.offset) != crc:
            raise self.file.error(
                "the CRC of the data section differs: the file is damaged",
                data_end.offset,
                "DataEnd",
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
            if not self.take(raw):
                return raw
        raise self.file.error("the data section has no DataEnd record", end)

    def take(self, raw: RawRecord) -> bool:
        """Take in the next record of the data section; False where it is its end."""
        if raw.opcode == wire.MESSAGE:
            self._loose_message(raw)
        elif raw.opcode == wire.SCHEMA:
            self.definitions.schema(self.file.parse(records.parse_schema, raw), raw.offset)
        elif raw.opcode == wire.CHANNEL:
            self.definitions.channel(
                self.file.parse(records.parse_channel, raw), raw.offset
            )
        else:
            self._close_run(raw.offset)
            if raw.opcode == wire.CHUNK:
                self._chunk(raw)
            elif raw.opcode == wire.ATTACHMENT:
                self.attachments.append(raw)
            elif raw.opcode == wire.METADATA:
                self.metadata.append(raw)
        return raw.opcode != wire.DATA_END

    def _loose_message(self, raw: RawRecord) -> None:
        if raw.length < wire.MESSAGE_FIELDS_BYTES:
            raise self.file.error(
                "a message shorter than its fields", raw.offset, "Message"
            )
        limit = self.file.limits.max_message_bytes + wire.MESSAGE_FIELDS_BYTES
        if raw.length > limit:
            self.file.check_limit(
                raw.length - wire.MESSAGE_FIELDS_BYTES,
                "max_message_bytes",
                "a message's size",
                raw.offset,
                "Message",
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
                f"a message is of channel {channel_id}, which no Channel record before it defines",
                offset,
                "Message",
            )
        self.counts[channel_id] = self.counts.get(channel_id, 0) + 1

    def _close_run(self, end: int) -> None:
        if self._run_start is not None:
            self._add(
                self._run_start,
                end - self._run_start,
                self._run_times,
                self._run_channels,
                chunked=False,
            )
        self._run_start = None
        self._run_times = []
        self._run_channels = set()

    def _add(
        self,
        offset: int,
        length: int,
        times: list[int],
        channels: Iterable[int],
        *,
        chunked: bool,
    ) -> None:
        low, high = (min(times), max(times)) if times else (0, 0)
        self.blocks.append(Block(offset, length, low, high, frozenset(channels), chunked))

    def _chunk(self, raw: RawRecord) -> None:
        head = self.file.chunk_head(raw)
        data = self.file.unpack(raw, head)
        times: list[int] = []
        channels: set[int] = set()
        try:
            for opcode, position, length in walk_records(data):
                if opcode == wire.MESSAGE:
                    if length < wire.MESSAGE_FIELDS_BYTES:
                        raise wire.WireError(
                            f"the message at {position} is shorter than its fields"
                        )
                    fields = wire.MESSAGE_HEAD.unpack_from(data, position)
                    self._count(fields[2], raw.offset)
                    channels.add(fields[2])
                    times.append(fields[4])
                elif opcode in (wire.SCHEMA, wire.CHANNEL):
                    content = data[
                        position + wire.PREFIX_BYTES : position + wire.PREFIX_BYTES + length
                    ]
                    self._define(opcode, content, raw.offset)
        except wire.WireError as error:
            raise self.file.error(str(error), raw.offset, raw.name) from error
        self._add(raw.offset, raw.end - raw.offset, times, channels, chunked=True)

    def _define(self, opcode: int, content: bytes, offset: int) -> None:
        if opcode == wire.SCHEMA:
            self.definitions.schema(records.parse_schema(content), offset)
        else:
            self.definitions.channel(records.parse_channel(content), offset)
