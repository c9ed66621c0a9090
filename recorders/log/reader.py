"""The one read layer: a log's messages in one total order, whatever way the file is written."""

from __future__ import annotations

import heapq
from bisect import bisect_left
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing
from pathlib import Path

from recorders.closing import Closing
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import records
from recorders.log.blocks import Block, BlockCursor, Shelf, read_messages
from recorders.log.index import build_index
from recorders.log.layout import LogIndex
from recorders.log.model import Attachment, ChannelInfo, LogHeader, Message
from recorders.log.storage import RawRecord, RecordFile

FOREVER_NS = 1 << 64


class LogReader(Closing):
    """A log opened for reading; use it as a context manager.

    Messages come in the total order (log time, file position), where the file position is that of
    the chunk, then that in the chunk: equal times stay as they are in the file. Chunks that
    overlap in time are merged; a chunk is opened only when it may hold the next message, and not
    at all when its index names none of the wanted channels. Memory does not grow with the file
    (one entry per chunk).

    What is checked: the summary's CRC, on opening; a chunk's CRC and its head against the
    summary, when it is opened; an attachment's, when it is read; a metadata record's and the
    header's, when they are read: by the checksums that our writer adds to the summary, or by the
    CRC of the whole data section in files of others (one pass, once). A file whose summary is
    missing, incomplete or without CRC is scanned on opening, every CRC in it checked. Where a
    file has no CRC, there is nothing to check. After all messages of a file were read, their
    number is held against the statistics.

    Raises:
        RecordingError: from every method, the only exception about the file; `LimitError` where a
            limit is reached.
    """

    def __init__(self, path: str | Path, limits: Limits = DEFAULT_LIMITS) -> None:
        self.path = Path(path)
        self.limits = limits
        self._file = RecordFile(path, limits)
        try:
            self._index = build_index(self._file)
        except BaseException:
            self._file.close()
            raise
        self.channels: list[ChannelInfo] = sorted(
            self._index.channels.values(), key=lambda channel: (channel.topic, channel.id)
        )

    def close(self) -> None:
        """Release the file."""
        self._file.close()

    @property
    def index(self) -> LogIndex:
        """Where everything stands in the file."""
        return self._index

    @property
    def header(self) -> LogHeader:
        """Profile and library."""
        self._check_record(self._index.header_record)
        return self._index.header

    @property
    def start_ns(self) -> int | None:
        """Log time of the earliest message, None without messages."""
        return self._index.start_ns

    @property
    def end_ns(self) -> int | None:
        """Log time of the latest message, None without messages."""
        return self._index.end_ns

    @property
    def message_count(self) -> int:
        """Number of messages in the file."""
        return self._index.message_count

    def topics(self) -> list[str]:
        """The topics, each once, sorted."""
        return sorted({channel.topic for channel in self.channels})

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        reverse: bool = False,
    ) -> Iterator[Message]:
        """The messages in total order, or exactly reversed.

        Args:
            topics: only these topics; None for all.
            start_ns: only messages at or after this log time.
            end_ns: only messages before this log time.
            reverse: from the last to the first.
        """
        chosen = (
            None
            if topics is None
            else frozenset((topics,) if isinstance(topics, str) else topics)
        )
        low = 0 if start_ns is None else start_ns
        high = FOREVER_NS if end_ns is None else end_ns
        wanted = {
            identity: channel if chosen is None or channel.topic in chosen else None
            for identity, channel in self._index.channels.items()
        }
        given = 0
        for batch in self._merge(wanted, low, high, reverse):
            given += len(batch)
            yield from batch
        everything = chosen is None and low <= 0 and high >= FOREVER_NS
        if everything and given != self._index.message_count:
            raise self._file.error(
                f"the statistics count {self._index.message_count} messages, the file holds"
                f" {given}",
                self._index.footer.summary_start,
                "Statistics",
            )

    def stored(self, topics: Collection[str] | None = None) -> Iterator[Message]:
        """The messages in the order in which they are stored, whatever their times.

        Where the recorder's clock was set back, this order is what is left of the truth.
        """
        chosen = None if topics is None else frozenset(topics)
        wanted = {
            identity: channel if chosen is None or channel.topic in chosen else None
            for identity, channel in self._index.channels.items()
        }
        blocks = self._blocks(wanted, 0, FOREVER_NS)
        for block in sorted(blocks, key=lambda b: b.offset):
            found = read_messages(self._file, block, wanted, 0, FOREVER_NS)
            yield from sorted(found, key=lambda m: m.order[1:])

    def latched(self, topic: str, time_ns: int) -> Message | None:
        """The topic's last message at or before ``time_ns``, None if there is none."""
        return next(self.messages([topic], end_ns=time_ns + 1, reverse=True), None)

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """Name and values of each metadata record, in file order."""
        found: list[tuple[str, dict[str, str]]] = []
        for raw in self._index.metadata:
            self._expect(raw)
            self._check_record(raw)
            found.append(self._file.parse(records.parse_metadata, raw))
        return found

    def attachments(self, names: Sequence[str] | None = None) -> Iterator[Attachment]:
        """The attachments in file order; with ``names``, only those."""
        listed = {entry.offset: entry.name for entry in self._index.attachment_indexes}
        for raw in self._index.attachments:
            if (
                names is not None
                and raw.offset in listed
                and listed[raw.offset] not in names
            ):
                continue
            self._expect(raw)
            attachment = read_attachment(self._file, raw)
            if names is None or attachment.name in names:
                yield attachment

    def check_data(self) -> None:
        """Hold the CRC of the whole data section against the file, once; does nothing where there
        is no CRC.
        """
        index = self._index
        if index.data_checked:
            return
        if index.data_crc and self._file.crc(0, index.data_end.offset) != index.data_crc:
            raise self._file.error(
                "the CRC of the data section differs: the file is damaged",
                index.data_end.offset,
                "DataEnd",
            )
        index.data_checked = True

    def _expect(self, raw: RawRecord) -> None:
        """The summary says that this record is there."""
        found = self._file.record_at(raw.offset)
        if (found.opcode, found.length) != (raw.opcode, raw.length):
            raise self._file.error(
                "the summary says that a record is here, but there is another",
                raw.offset,
                raw.name,
            )

    def _check_record(self, raw: RawRecord) -> None:
        checksum = self._index.checksums.get((raw.offset, raw.end - raw.offset))
        if checksum is None:
            self.check_data()
        elif self._file.crc(raw.offset, raw.end) != checksum:
            raise self._file.error(
                "the record's checksum differs: it is damaged", raw.offset, raw.name
            )

    def _blocks(
        self, wanted: dict[int, ChannelInfo | None], low: int, high: int
    ) -> list[Block]:
        ids = {identity for identity, channel in wanted.items() if channel is not None}
        return [
            block
            for block in self._index.blocks
            if block.start_ns < high
            and block.end_ns >= low
            and (block.channels is None or block.channels & ids)
        ]

    def _merge(
        self, wanted: dict[int, ChannelInfo | None], low: int, high: int, reverse: bool
    ) -> Iterator[list[Message]]:
        """Batches of messages: the blocks' messages merged into the total order, blocks opened as
        late as possible.

        Keys are negated for the reverse direction, so that one loop serves both.
        """
        sign = -1 if reverse else 1

        def load(block: Block) -> list[Message]:
            found = read_messages(self._file, block, wanted, low, high)
            if reverse:
                found.reverse()
            return found

        def first_key(block: Block) -> tuple[int, int]:
            return (
                (-block.end_ns, -block.offset)
                if reverse
                else (block.start_ns, block.offset)
            )

        waiting = sorted(self._blocks(wanted, low, high), key=first_key, reverse=True)
        heap: list[tuple[tuple[int, int, int], BlockCursor]] = []
        with closing(Shelf()) as shelf:
            while heap or waiting:
                while waiting and (not heap or first_key(waiting[-1])[0] <= heap[0][0][0]):
                    cursor = BlockCursor(load(waiting.pop()), shelf)
                    if cursor.messages:
                        heapq.heappush(heap, (_key(cursor, sign), cursor))
                        self._stay_in_memory(heap)
                if heap:
                    cursor = heapq.heappop(heap)[1]
                    until = heap[0][0] if heap else None
                    if waiting:
                        border = (first_key(waiting[-1])[0], -FOREVER_NS, 0)
                        until = border if until is None else min(until, border)
                    yield self._take(cursor, until, sign)
                    if cursor.position < len(cursor.messages):
                        heapq.heappush(heap, (_key(cursor, sign), cursor))

    @staticmethod
    def _take(
        cursor: BlockCursor, until: tuple[int, int, int] | None, sign: int
    ) -> list[Message]:
        """The cursor's next messages before the key ``until``."""
        end = len(cursor.messages)
        if until is not None:
            end = bisect_left(
                cursor.messages,
                until,
                cursor.position,
                key=lambda m: _signed(m.order, sign),
            )
        return cursor.taken(end)

    def _stay_in_memory(self, heap: list[tuple[tuple[int, int, int], BlockCursor]]) -> None:
        """Put the payloads aside of the blocks whose turn comes last, while they are more than
        half of what the limit allows.
        """
        held = sum(cursor.bytes_held for _, cursor in heap)
        if held <= self.limits.max_open_bytes:
            return
        for _, cursor in sorted(heap, key=lambda entry: entry[0], reverse=True)[:-1]:
            held -= cursor.bytes_held
            cursor.put_aside()
            if held <= self.limits.max_open_bytes // 2:
                return


def _signed(order: tuple[int, int, int], sign: int) -> tuple[int, int, int]:
    return order if sign > 0 else (-order[0], -order[1], -order[2])


def _key(cursor: BlockCursor, sign: int) -> tuple[int, int, int]:
    return _signed(cursor.messages[cursor.position].order, sign)


def read_attachment(file: RecordFile, raw: RawRecord) -> Attachment:
    """An attachment, its CRC checked where it has one."""
    return file.parsed(
        records.parse_attachment,
        file.content(raw, "max_attachment_bytes"),
        raw.offset,
        raw.name,
    )
