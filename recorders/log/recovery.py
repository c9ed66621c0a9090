"""Recovering a log: everything up to the last whole record, damaged chunks left out, and all of
it said.
"""

from __future__ import annotations

from bisect import bisect_right
from dataclasses import dataclass, field
from pathlib import Path

from recorders.errors import LimitError, RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import records, wire
from recorders.log.blocks import walk_records
from recorders.log.layout import Definitions, what_else
from recorders.log.mending import Mended
from recorders.log.model import Schema
from recorders.log.reader import read_attachment
from recorders.log.salvage import Damage, Ending, Joint, read_ending, walk
from recorders.log.storage import RawRecord, RecordFile
from recorders.log.writer import LogWriter

# Not the suffix that writers use: `x.mcap.part` is recovered to `x.mcap`, and must not be written
# over meanwhile.
_PART_SUFFIX = ".recovering.part"
_DATA = frozenset({wire.CHUNK, wire.MESSAGE, wire.ATTACHMENT, wire.METADATA})
PICTURE_SCHEMAS = frozenset(
    {
        "foxglove.CompressedImage",
        "foxglove.CompressedVideo",
        "foxglove.RawImage",
        "sensor_msgs/msg/CompressedImage",
        "sensor_msgs/msg/Image",
    }
)


@dataclass(frozen=True, slots=True)
class Loss:
    """Something that is not in the recovered log: from which byte of the damaged one, what, and
    why.
    """

    offset: int
    record: str
    reason: str


@dataclass(slots=True)
class RecoveryReport:
    """What a recovery kept and what it could not.

    ``messages_expected`` is what the damaged file's statistics count, None where they are lost;
    ``notes`` what a reader should know though nothing was lost by it.
    """

    path: Path
    out: Path
    messages: int = 0
    channels: int = 0
    metadata: int = 0
    attachments: int = 0
    messages_expected: int | None = None
    losses: list[Loss] = field(default_factory=list)
    notes: list[Loss] = field(default_factory=list)

    @property
    def is_complete(self) -> bool:
        """Nothing was lost."""
        return not self.losses


def recover(
    path: str | Path, out: str | Path, force: bool = False, limits: Limits = DEFAULT_LIMITS
) -> RecoveryReport:
    """Write what is whole in the log at ``path`` to ``out``: messages with their times and
    sequence numbers.

    Works on logs that were cut short, on part files of a killed writer, and around damaged bytes.
    A message is kept when its chunk's CRC is right, or when it stands in no chunk.

    Raises:
        RecordingError: ``path`` is not a log at all, or ``out`` cannot be written.
        OutputExistsError: ``out`` exists and ``force`` was not given.
    """
    with RecordFile(path, limits) as file:
        if Path(out).exists() and Path(out).samefile(file.path):
            raise file.error(
                "a recovery never writes over the log that it reads; name another output"
            )
        report = RecoveryReport(file.path, Path(out))
        start, profile = _start(file, report)
        ending = read_ending(file)
        with LogWriter(
            out, force=force, limits=limits, profile=profile, part_suffix=_PART_SUFFIX
        ) as log:
            _Recovery(file, ending, log, report).run(start)
    return report


def _start(file: RecordFile, report: RecoveryReport) -> tuple[int, str]:
    """Where the data section starts, and the profile."""
    if file.size == 0:
        raise file.error("the file is empty: there is nothing to recover")
    size = len(wire.MAGIC)
    if file.read(0, min(size, file.size)) != wire.MAGIC:
        if file.size < 2 * size or file.read(file.size - size, size) != wire.MAGIC:
            raise file.error(
                f"this is not an MCAP file{what_else(file)}; there is nothing to recover", 0
            )
        report.losses.append(Loss(0, "magic bytes", "the first bytes are damaged"))
    try:
        raw = file.record_at(size)
        if raw.opcode != wire.HEADER:
            raise file.error("the header is damaged", size, "Header")
        profile, library = file.parse(records.parse_header, raw)
    except RecordingError as error:
        report.losses.append(Loss(size, "Header", error.reason))
        return size, ""
    end = size + len(records.encode_header(profile, library))
    if end < raw.end and _stands_at(file, end):
        report.losses.append(Loss(size, "Header", "its length is damaged"))
        return end, profile
    return raw.end, profile


def _stands_at(file: RecordFile, offset: int) -> bool:
    """Whether a record of the data section begins there."""
    try:
        raw = file.record_at(offset)
    except RecordingError:
        return False
    return raw.opcode in _DATA or raw.opcode in (wire.SCHEMA, wire.CHANNEL)


class _Recovery:
    """One pass over the damaged file. Memory: one chunk or one attachment."""

    def __init__(
        self, file: RecordFile, ending: Ending, log: LogWriter, report: RecoveryReport
    ) -> None:
        self.file = file
        self.ending = ending
        self.log = log
        self.report = report
        self.definitions = Definitions(file)
        self.ids: dict[int, int] = {}
        self.checksums: dict[tuple[int, int], int] = {}
        self.proven = True
        self.orphans: dict[int, tuple[int, int]] = {}
        self.by_definition: dict[str, int] = {}
        self.ends = self.joints = self.part_start = 0
        self.behind_end = False
        self.end: RawRecord | None = None
        self.indexes: list[tuple[int, int]] = []
        self.index_is_damaged = False
        self.has_bare_messages = False
        self.counted: int | None = None

    def run(self, start: int) -> None:
        """Keep what is whole from byte ``start`` on."""
        if self.ending.summary is not None:
            self._learn_from_summary()
        for found in walk(self.file, start, self.ending):
            if isinstance(found, Joint):
                self._join(found)
                continue
            if isinstance(found, Damage):
                if self.behind_end and found.end >= self.file.size:
                    continue  # what is left of a summary: it is made anew
                what = (
                    f"{found.end - found.offset} bytes up to byte {found.end} hold no whole"
                    f" record: {found.reason}"
                )
                self._lose(found.offset, "data section", _plain_text(what))
                continue
            if isinstance(found, Mended):
                self.report.notes.append(Loss(found.raw.offset, "Chunk", found.reason))
                found = found.raw  # noqa: PLW2901
            try:
                self._keep(found)
            except RecordingError as error:
                if error.path != self.file.path or self._is_sound(found, error):
                    raise  # about the output, or about a limit that a user can raise
                self._lose(found.offset, found.name, _plain(error))
        for channel, (offset, count) in sorted(self.orphans.items()):
            self._lose(
                offset,
                "Message",
                f"{count} messages of channel {channel}, whose Channel record is lost",
            )
        self._tell_of_end()
        self._compare_counts()

    def _is_sound(self, raw: RawRecord, error: RecordingError) -> bool:
        """Whether only a limit stands against a record; damage may claim any size, too."""
        if not isinstance(error, LimitError):
            return False
        return raw.opcode != wire.CHUNK or self.file.holds_sound_chunk(raw)

    def _join(self, found: Joint) -> None:
        """Another log begins: its ids are its own."""
        self.report.notes.append(
            Loss(found.offset, "magic bytes", "another log begins here; it was joined on")
        )
        self.joints += 1
        self.part_start = found.offset
        self.definitions = Definitions(self.file)
        self.ids = {}
        self.behind_end = False
        self.proven = True

    def _tell_of_end(self) -> None:
        """A damaged end is a loss where the data may go on in what is missing."""
        problem = self.ending.problem
        if self.joints and self.ends == self.joints + 1:
            self.report.messages_expected = self.counted
            return
        if problem is None:
            return
        place = self.file.size if problem.offset is None else problem.offset
        self.report.losses.insert(0, Loss(place, "Footer", _plain(problem)))

    def _lose(self, offset: int, record: str, reason: str) -> None:
        self.report.losses.append(Loss(offset, record, reason))

    def _learn_from_summary(self) -> None:
        """The summary repeats the channels: messages are kept even where the chunk that defines
        theirs is lost.
        """
        summary = self.ending.summary
        assert summary is not None
        self.checksums = summary.checksums
        if summary.statistics is not None:
            self.report.messages_expected = summary.statistics.message_count
        for schema in summary.definitions.schemas.values():
            self.definitions.schema(schema, 0)
        for channel in sorted(summary.definitions.channels.values(), key=lambda c: c.id):
            self._channel(channel, 0)
        footer = self.ending.footer
        if footer is None or not footer.summary_crc:
            return  # nothing proves where it places the chunks' indexes
        for chunk in summary.chunks:
            behind = chunk.offset + chunk.length
            self.indexes.append((behind, behind + chunk.message_index_length))
        self.indexes.sort()

    def _keep(self, raw: RawRecord) -> None:
        if raw.opcode in (wire.MESSAGE, wire.METADATA) and self._is_of_index(raw):
            note = "the message index is damaged here; it is made anew"
            self.report.notes.append(Loss(raw.offset, "MessageIndex", note))
            self.index_is_damaged = True
            return
        if raw.opcode in _DATA and self.behind_end:
            if self._is_of_summary(raw):
                return
            # What was taken for the end was another record, damaged.
            self._lose(raw.offset, "DataEnd", "the data go on behind a damaged record")
            self.behind_end = False
        checksum = self.checksums.get((raw.offset, raw.end - raw.offset))
        if checksum is not None and self.file.crc(raw.offset, raw.end) != checksum:
            raise self.file.error(
                "the record's checksum differs: it is damaged", raw.offset, raw.name
            )
        if checksum is None and raw.opcode in (
            wire.MESSAGE,
            wire.METADATA,
            wire.SCHEMA,
            wire.CHANNEL,
        ):
            self.proven = False
        if raw.opcode == wire.CHUNK:
            self._chunk(raw)
        elif raw.opcode in (wire.SCHEMA, wire.CHANNEL, wire.MESSAGE):
            self.has_bare_messages |= raw.opcode == wire.MESSAGE
            self._record(raw.opcode, self.file.content(raw), raw.offset)
        elif raw.opcode == wire.ATTACHMENT:
            found = read_attachment(self.file, raw)
            self.log.attach(
                found.name,
                found.media_type,
                found.data,
                found.log_time_ns,
                found.create_time_ns,
            )
            self.report.attachments += 1
        elif raw.opcode == wire.METADATA:
            self.log.metadata(*self.file.parse(records.parse_metadata, raw))
            self.report.metadata += 1
        elif raw.opcode == wire.STATISTICS and self.behind_end:
            stated = self.file.parse(records.parse_statistics, raw).message_count
            self.counted = (self.counted or 0) + stated
        elif raw.opcode == wire.FOOTER:
            self.ends += 1
        elif raw.opcode == wire.DATA_END:
            self.behind_end = True
            self.end = raw
            self._data_end(raw)

    def _is_of_index(self, raw: RawRecord) -> bool:
        """Whether the summary places a chunk's index where another record seems to be."""
        place = bisect_right(self.indexes, (raw.offset, self.file.size)) - 1
        return place >= 0 and raw.offset < self.indexes[place][1]

    def _is_of_summary(self, raw: RawRecord) -> bool:
        """Whether what looks like data behind the end is a record of the summary, damaged. Chunks
        and attachments have CRCs of their own; of the others, the end is proven by its CRC, or a
        message without a chunk is the first of its kind.
        """
        assert self.end is not None
        if raw.opcode not in (wire.MESSAGE, wire.METADATA):
            return False
        if raw.opcode == wire.MESSAGE and not self.has_bare_messages:
            return True
        crc = self.file.parse(records.parse_data_end, self.end)
        return crc != 0 and self.file.crc(self.part_start, self.end.offset) == crc

    def _chunk(self, raw: RawRecord) -> None:
        head = self.file.chunk_head(raw)
        data = self.file.unpack(raw, head)
        self.proven = self.proven and head.uncompressed_crc != 0
        view = memoryview(data)
        try:
            for opcode, position, length in walk_records(data):
                if opcode in (wire.SCHEMA, wire.CHANNEL, wire.MESSAGE):
                    start = position + wire.PREFIX_BYTES
                    self._record(opcode, view[start : start + length], raw.offset)
        except wire.WireError as error:
            raise self.file.error(
                f"the rest of the chunk: {error}", raw.offset, raw.name
            ) from error

    def _record(self, opcode: int, content: bytes | memoryview, offset: int) -> None:
        try:
            if opcode == wire.SCHEMA:
                self._schema(records.parse_schema(content), offset)
            elif opcode == wire.CHANNEL:
                self._channel(records.parse_channel(content), offset)
            else:
                self._message(content, offset)
        except wire.WireError as error:
            raise self.file.error(str(error), offset, wire.opcode_name(opcode)) from error

    def _schema(self, found: records.SchemaRecord, offset: int) -> None:
        before = self.definitions.schemas.get(found.id)
        if before is not None and before != found:
            note = (
                f"schema {found.id} means {found.name} from here on, {before.name} before"
            )
            self.report.notes.append(Loss(offset, "Schema", note))
            del self.definitions.schemas[found.id]
            for channel in list(self.definitions.channels.values()):
                if channel.schema_id == found.id:
                    # Its messages wait for a Channel record that names the new schema.
                    del self.definitions.channels[channel.id]
                    self.ids.pop(channel.id, None)
        self.definitions.schema(found, offset)

    def _channel(self, found: records.ChannelRecord, offset: int) -> None:
        before = self.definitions.channels.get(found.id)
        if before is not None and before != found:
            # The id means another channel from here on.
            note = f"channel {found.id} means {found.topic} from here on, {before.topic} before"
            self.report.notes.append(Loss(offset, "Channel", note))
            del self.definitions.channels[found.id]
            self.ids.pop(found.id, None)
        self.definitions.channel(found, offset)
        if found.id in self.ids:
            return
        schema = self.definitions.schemas.get(found.schema_id)
        key = repr(
            (found.topic, found.message_encoding, sorted(found.metadata.items()), schema)
        )
        if key not in self.by_definition:
            self.by_definition[key] = self.log.channel(
                found.topic,
                None
                if schema is None
                else Schema(schema.name, schema.encoding, schema.data),
                found.message_encoding,
                found.metadata,
                picture=schema is not None and schema.name in PICTURE_SCHEMAS,
            )
            self.report.channels += 1
        self.ids[found.id] = self.by_definition[key]

    def _message(self, content: bytes | memoryview, offset: int) -> None:
        head = records.parse_message_head(content)
        if head.channel_id not in self.ids:
            first, count = self.orphans.get(head.channel_id, (offset, 0))
            self.orphans[head.channel_id] = (first, count + 1)
            return
        data = bytes(content[wire.MESSAGE_FIELDS_BYTES :])
        self.file.check_limit(
            len(data), "max_message_bytes", "a message's size", offset, "Message"
        )
        self.log.write(
            self.ids[head.channel_id],
            data,
            head.log_time_ns,
            head.publish_time_ns,
            head.sequence,
        )
        self.report.messages += 1

    def _data_end(self, raw: RawRecord) -> None:
        crc = self.file.parse(records.parse_data_end, raw)
        # Where everything that was kept has a CRC of its own, only an index can be wrong, and
        # that is made anew.
        if (
            crc
            and not self.proven
            and not self.report.losses
            and not self.index_is_damaged
            and self.file.crc(self.part_start, raw.offset) != crc
        ):
            self._lose(
                raw.offset,
                "DataEnd",
                "the CRC of the data section differs, though no damaged record shows: a"
                " message outside a chunk, or a metadata record, may be wrong",
            )

    def _compare_counts(self) -> None:
        expected, kept = self.report.messages_expected, self.report.messages
        if expected is None or expected == kept:
            return
        told = Loss(
            self.file.size,
            "Statistics",
            f"the file counted {expected} messages, {kept} are kept",
        )
        (self.report.losses if expected > kept else self.report.notes).append(told)


def _plain(error: RecordingError) -> str:
    return _plain_text(error.reason)


def _plain_text(reason: str) -> str:
    """The reason without the advice to do what is being done."""
    return reason.split("; `scenetrace recover`", maxsplit=1)[0]
