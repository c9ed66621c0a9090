"""A log held against its own promises (`examine`): every CRC, every index, every count, with byte
offsets.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from recorders.errors import LimitError, RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import records, wire
from recorders.log.blocks import walk_records
from recorders.log.layout import Definitions, Summary
from recorders.log.mending import Mended
from recorders.log.reader import read_attachment
from recorders.log.salvage import Damage, Ending, Joint, read_ending, walk
from recorders.log.storage import RawRecord, RecordFile
from recorders.log.writer import LIBRARY

Severity = Literal["error", "warning"]
MAX_FINDINGS = 1000


@dataclass(frozen=True, slots=True)
class Finding:
    """Something about a log that is wrong (``error``) or that readers may stumble over
    (``warning``).
    """

    severity: Severity
    offset: int
    record: str
    text: str

    def __str__(self) -> str:
        return f"{self.severity}: byte {self.offset} ({self.record}): {self.text}"


def examine(path: str | Path, limits: Limits = DEFAULT_LIMITS) -> list[Finding]:
    """Everything that is wrong with a log, by byte offset; empty for a sound one. Stops at
    `MAX_FINDINGS`.

    Raises:
        RecordingError: there is no such file, or it cannot be opened.
    """
    with RecordFile(path, limits) as file:
        examination = _Examination(file)
        examination.run()
        return sorted(
            examination.findings,
            key=lambda finding: (
                finding.offset,
                finding.severity,
                finding.record,
                finding.text,
            ),
        )[:MAX_FINDINGS]


class _Examination:
    """One pass over the file. Memory: one chunk, one entry per channel, the summary."""

    def __init__(self, file: RecordFile) -> None:
        self.file = file
        self.findings: list[Finding] = []
        self.definitions = Definitions(file)
        self.counts: dict[int, int] = {}
        self.latest: dict[int, int] = {}
        self.backwards: dict[int, tuple[int, int]] = {}
        self.before: dict[int, tuple[int, int]] = {}
        self.repeats: dict[int, tuple[int, int]] = {}
        self.chunks: dict[int, records.ChunkIndexRecord] = {}
        self.found: dict[int, list[RawRecord]] = {
            wire.CHUNK: [],
            wire.ATTACHMENT: [],
            wire.METADATA: [],
        }
        self.pending: dict[int, list[tuple[int, int]]] = {}
        self.pending_chunk: RawRecord | None = None
        self.damaged = False
        self.unread_chunk = False
        self.ours = False
        self.part_start = 0
        self.times: tuple[int, int] | None = None

    def run(self) -> None:
        """Look at the start, the data section, the summary."""
        start = self._start()
        if start is None:
            return
        ending = read_ending(self.file)
        if ending.problem is not None:
            self._error(ending.problem.offset or 0, "Footer", ending.problem.reason)
        elif ending.footer is not None and not ending.footer.summary_start:
            self._warn(
                ending.data_limit,
                "Footer",
                "there is no summary: readers must scan the whole file",
            )
        elif ending.footer is not None and not ending.footer.summary_crc:
            self._no_crc(
                ending.footer.summary_start,
                "Footer",
                "the summary has no CRC: damage in it would not show",
            )
        if ending.summary is not None:
            self.chunks = {entry.offset: entry for entry in ending.summary.chunks}
        ended = False
        for found in walk(self.file, start, ending):
            raw = self._told(found, ended, ending)
            if raw is None:
                continue
            ended = ended or raw.opcode == wire.DATA_END
            self._guarded(raw)
        self._settle_index(None)
        if not ended:
            self._error(self.file.size, "DataEnd", "the data section has no DataEnd record")
        for channel, (offset, count) in sorted(self.backwards.items()):
            topic = self.definitions.channels[channel].topic
            self._warn(
                offset,
                "Message",
                f"log time goes back {count} times on {topic}, here first",
            )
        for channel, (offset, count) in sorted(self.repeats.items()):
            topic = self.definitions.channels[channel].topic
            self._warn(
                offset,
                "Message",
                f"{count} messages on {topic} stand here twice, this one first: recorded"
                " twice, or logs were joined that overlap",
            )
        if (
            ending.summary is not None
            and ending.footer is not None
            and ending.footer.summary_start
        ):
            self._summary(ending.summary, ending.footer)

    def _told(
        self, found: RawRecord | Damage | Joint | Mended, ended: bool, ending: Ending
    ) -> RawRecord | None:
        """The record to look at, after what the walk says of it was told."""
        if isinstance(found, RawRecord):
            return found
        if isinstance(found, Joint):
            self._join(found)
            return None
        if isinstance(found, Mended):
            self._error(found.raw.offset, "Chunk", found.reason)
            return found.raw
        # The rest of a damaged summary was told already.
        if not (ended and ending.problem is not None and found.end >= self.file.size):
            self.damaged = True
            self._error(
                found.offset,
                "data section",
                f"{found.end - found.offset} bytes: {found.reason}",
            )
        return None

    def _error(self, offset: int, record: str, text: str) -> None:
        self._add(Finding("error", offset, record, text))

    def _warn(self, offset: int, record: str, text: str) -> None:
        self._add(Finding("warning", offset, record, text))

    def _no_crc(self, offset: int, record: str, text: str) -> None:
        """CRCs are optional in MCAP, but our writer never leaves one out."""
        self._add(Finding("error" if self.ours else "warning", offset, record, text))

    def _add(self, finding: Finding) -> None:
        if len(self.findings) < MAX_FINDINGS:
            self.findings.append(finding)

    def _start(self) -> int | None:
        size = len(wire.MAGIC)
        if self.file.size == 0:
            self._error(0, "magic bytes", "the file is empty")
            return None
        if self.file.read(0, min(size, self.file.size)) != wire.MAGIC:
            self._error(
                0,
                "magic bytes",
                "this is not an MCAP file (its first bytes are not MCAP's)",
            )
            return None
        try:
            raw = self.file.record_at(size)
            if raw.opcode != wire.HEADER:
                raise self.file.error(
                    "the file does not start with a Header record", size, raw.name
                )
            _, library = self.file.parse(records.parse_header, raw)
            self.ours = library == LIBRARY
        except RecordingError as error:
            self._error(size, "Header", error.reason)
            return size
        return raw.end

    def _join(self, found: Joint) -> None:
        self.damaged = True
        self._error(
            found.offset,
            "magic bytes",
            "another log begins here: logs were joined without rewriting them;"
            " `scenetrace recover` makes one of them",
        )
        self.part_start = found.offset
        self.definitions = Definitions(self.file)
        self.latest = {}

    def _guarded(self, raw: RawRecord) -> None:
        if raw.opcode == wire.MESSAGE_INDEX and self.unread_chunk:
            return  # of a chunk that could not be read, which was told
        self.unread_chunk = False
        try:
            self._record(raw)
        except LimitError as error:
            self.damaged = True
            self.unread_chunk = raw.opcode == wire.CHUNK
            if self.unread_chunk and not self.file.holds_sound_chunk(raw):
                self._error(raw.offset, raw.name, error.reason)
            else:
                text = (
                    f"not damaged, but larger than what is read by default: {error.reason}"
                )
                self._warn(raw.offset, error.record or raw.name, text)
            self.chunks.pop(raw.offset, None)
        except RecordingError as error:
            self.damaged = True
            self.unread_chunk = raw.opcode == wire.CHUNK
            self._error(raw.offset, error.record or raw.name, error.reason)

    def _record(self, raw: RawRecord) -> None:
        if raw.opcode == wire.MESSAGE_INDEX:
            self._message_index(raw)
            return
        self._settle_index(raw)
        if raw.opcode in self.found:
            self.found[raw.opcode].append(raw)
        if raw.opcode == wire.CHUNK:
            self._chunk(raw)
        elif raw.opcode in (wire.SCHEMA, wire.CHANNEL, wire.MESSAGE):
            self._content(raw.opcode, self.file.content(raw), raw.offset)
        elif raw.opcode == wire.ATTACHMENT:
            read_attachment(self.file, raw)
        elif raw.opcode == wire.METADATA:
            self.file.parse(records.parse_metadata, raw)
        elif raw.opcode == wire.DATA_END:
            self._data_end(raw)

    def _data_end(self, raw: RawRecord) -> None:
        crc = self.file.parse(records.parse_data_end, raw)
        if not crc:
            self._no_crc(
                raw.offset,
                "DataEnd",
                "the data section has no CRC: damage outside the chunks would not show",
            )
        elif self.file.crc(self.part_start, raw.offset) != crc:
            self._error(
                raw.offset,
                "DataEnd",
                "the CRC of the data section differs: the file is damaged",
            )

    def _chunk(self, raw: RawRecord) -> None:
        head = self.file.chunk_head(raw)
        self.pending_chunk, self.pending = raw, {}
        data = self.file.unpack(raw, head)
        if not head.uncompressed_crc:
            self._no_crc(
                raw.offset, "Chunk", "the chunk has no CRC: damage in it would not show"
            )
        low: int | None = None
        high = 0
        try:
            for opcode, position, length in walk_records(data):
                content = data[
                    position + wire.PREFIX_BYTES : position + wire.PREFIX_BYTES + length
                ]
                if opcode in (wire.SCHEMA, wire.CHANNEL):
                    self._content(opcode, content, raw.offset)
                elif opcode == wire.MESSAGE:
                    channel, time = self._content(opcode, content, raw.offset)
                    self.pending.setdefault(channel, []).append((time, position))
                    low, high = time if low is None else min(low, time), max(high, time)
        except wire.WireError as error:
            raise self.file.error(str(error), raw.offset, raw.name) from error
        self._chunk_against_index(raw, head, 0 if low is None else low, high)

    def _chunk_against_index(
        self, raw: RawRecord, head: records.ChunkHead, low: int, high: int
    ) -> None:
        if (head.start_ns, head.end_ns) != (low, high):
            self._error(
                raw.offset,
                "Chunk",
                f"the chunk states log times {head.start_ns} to {head.end_ns}, its messages"
                f" have {low} to {high}",
            )
        entry = self.chunks.pop(raw.offset, None)
        if entry is None:
            return
        stated = (
            entry.length,
            entry.start_ns,
            entry.end_ns,
            entry.compression,
            entry.compressed_size,
        )
        real = (
            raw.end - raw.offset,
            head.start_ns,
            head.end_ns,
            head.compression,
            head.data_size,
        )
        if stated != real or entry.uncompressed_size != head.uncompressed_size:
            self._error(
                raw.offset,
                "ChunkIndex",
                "the summary's entry for this chunk differs from the chunk",
            )
        if entry.message_index_length and set(entry.message_index_offsets) != set(
            self.pending
        ):
            self._error(
                raw.offset,
                "ChunkIndex",
                "the summary's entry names other channels than the chunk holds",
            )

    def _content(self, opcode: int, content: bytes, offset: int) -> tuple[int, int]:
        """Take in a schema, channel or message; gives the message's channel and log time."""
        try:
            if opcode == wire.SCHEMA:
                self.definitions.schema(records.parse_schema(content), offset)
                return 0, 0
            if opcode == wire.CHANNEL:
                self.definitions.channel(records.parse_channel(content), offset)
                return 0, 0
            head = records.parse_message_head(content)
            channel, time = head.channel_id, head.log_time_ns
        except wire.WireError as error:
            raise self.file.error(str(error), offset, wire.opcode_name(opcode)) from error
        if channel not in self.definitions.channels:
            raise self.file.error(
                f"a message is of channel {channel}, which no Channel record before it"
                " defines",
                offset,
                "Message",
            )
        self.counts[channel] = self.counts.get(channel, 0) + 1
        self.times = (
            (time, time)
            if self.times is None
            else (min(self.times[0], time), max(self.times[1], time))
        )
        said = len(content), zlib.crc32(content)
        if self.before.get(channel) == said:
            first, count = self.repeats.get(channel, (offset, 0))
            self.repeats[channel] = (first, count + 1)
        self.before[channel] = said
        if time < self.latest.get(channel, 0):
            first, count = self.backwards.get(channel, (offset, 0))
            self.backwards[channel] = (first, count + 1)
        self.latest[channel] = max(time, self.latest.get(channel, 0))
        return channel, time

    def _message_index(self, raw: RawRecord) -> None:
        channel, entries = self.file.parse(records.parse_message_index, raw)
        if self.pending_chunk is None:
            self._error(raw.offset, "MessageIndex", "it follows no chunk")
        elif sorted(self.pending.pop(channel, [])) != sorted(entries):
            self._error(
                raw.offset,
                "MessageIndex",
                f"it does not list the chunk's messages of channel {channel}",
            )
        else:
            self.pending.setdefault(-1, [])  # this chunk has message indexes

    def _settle_index(self, following: RawRecord | None) -> None:
        """After a chunk's message indexes: were all its channels listed?"""
        chunk, pending = self.pending_chunk, self.pending
        self.pending_chunk, self.pending = None, {}
        if chunk is not None and -1 in pending and len(pending) > 1:
            missing = ", ".join(
                str(channel) for channel in sorted(pending) if channel != -1
            )
            offset = chunk.offset if following is None else following.offset
            self._error(
                offset,
                "MessageIndex",
                f"the chunk's messages of channel {missing} are in no message index",
            )

    def _summary(self, summary: Summary, footer: records.FooterRecord) -> None:
        start = footer.summary_start
        places = {
            (raw.opcode, raw.offset): raw.end - raw.offset
            for group in self.found.values()
            for raw in group
        }
        listed = [
            (wire.ATTACHMENT, attachment.offset, attachment.length)
            for attachment in summary.attachments
        ]
        listed += [(wire.METADATA, m.offset, m.length) for m in summary.metadata]
        listed += [(wire.CHUNK, chunk.offset, chunk.length) for chunk in summary.chunks]
        for opcode, offset, length in listed:
            if places.get((opcode, offset)) != length:
                name = wire.opcode_name(opcode)
                self._error(
                    offset,
                    f"{name}Index",
                    f"the summary places a {name} of {length} bytes here; there is none",
                )
        known = {(opcode, offset) for opcode, offset, _ in listed}
        for opcode, members in (
            (wire.CHUNK, summary.chunks),
            (wire.ATTACHMENT, summary.attachments),
        ):
            unlisted = [
                raw for raw in self.found[opcode] if (opcode, raw.offset) not in known
            ]
            if unlisted and members:
                self._error(
                    unlisted[0].offset,
                    wire.opcode_name(opcode),
                    f"{len(unlisted)} are missing in the summary",
                )
            elif unlisted:
                self._warn(
                    start,
                    "Footer",
                    f"the summary has no index of the {len(unlisted)} {_plural(opcode)}",
                )
        missing = sorted(set(self.definitions.channels) - set(summary.definitions.channels))
        if missing:
            self._warn(
                start,
                "Footer",
                f"the summary does not repeat {len(missing)} channels: readers must scan",
            )
        self._statistics(summary, start)

    def _statistics(self, summary: Summary, start: int) -> None:
        statistics = summary.statistics
        if statistics is None:
            self._warn(start, "Statistics", "there are no statistics")
            return
        if self.damaged:
            return  # the counts cannot agree, and that is no finding of its own
        low, high = self.times or (0, 0)
        pairs = [
            ("messages", statistics.message_count, sum(self.counts.values())),
            ("channels", statistics.channel_count, len(self.definitions.channels)),
            ("schemas", statistics.schema_count, len(self.definitions.schemas)),
            ("chunks", statistics.chunk_count, len(self.found[wire.CHUNK])),
            ("attachments", statistics.attachment_count, len(self.found[wire.ATTACHMENT])),
            ("metadata records", statistics.metadata_count, len(self.found[wire.METADATA])),
            ("as the first log time", statistics.start_ns, low),
            ("as the last log time", statistics.end_ns, high),
        ]
        # A channel that nothing came by may stand in the summary alone.
        held = summary.definitions
        unused = {
            ("channels", len(held.channels | self.definitions.channels)),
            ("schemas", len(held.schemas | self.definitions.schemas)),
        }
        for what, stated, real in pairs:
            if stated != real and (what, stated) not in unused:
                self._error(
                    start,
                    "Statistics",
                    f"they state {stated} {what}, the file holds {real}",
                )
        counted = {
            channel: count
            for channel, count in statistics.channel_message_counts.items()
            if count
        }
        if counted and counted != self.counts:
            self._error(
                start, "Statistics", "the message counts by channel differ from the file"
            )


def _plural(opcode: int) -> str:
    return {wire.CHUNK: "chunks", wire.ATTACHMENT: "attachments"}[opcode]
