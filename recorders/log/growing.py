"""A log that another process is still writing: its messages as they come.

Messages are in the order in which a reader of the finished log finds them. Whoever writes frames
in the order of their times (`recorders.log.writer`) lets the small channels never overtake the
pictures of their time: once a chunk of frames is there, so is everything up to its end.
"""

from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from pathlib import Path
from threading import Event

from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import records, wire
from recorders.log.blocks import Block, read_messages
from recorders.log.layout import Definitions, LogIndex, Summary, check_start
from recorders.log.model import Attachment, ChannelInfo, Message
from recorders.log.output import PART_SUFFIX
from recorders.log.reader import LogReader, read_attachment
from recorders.log.scan import Scan
from recorders.log.storage import RecordFile

try:
    import fcntl
except ImportError:  # not a POSIX system: nobody can tell whether the file is still written
    fcntl = None  # type: ignore[assignment]

_POLL_S = 0.02
_LONGEST_WAIT_S = 60.0
_FRAMES_FIRST = 64
_FOREVER_NS = 1 << 64
_LEAST_BYTES = 256
"""So much a log has once its header is written, and more."""


def growing_path(
    path: Path, stop: Event, tell: Callable[[str], None] | None = None
) -> Path:
    """The log, or the part file that it is written as, waited for a minute.

    Raises:
        RecordingError: neither is there.
    """
    part = path.with_name(path.name + PART_SUFFIX)
    until = time.monotonic() + _LONGEST_WAIT_S
    told = False
    while not stop.is_set() and time.monotonic() < until:
        if part.exists() and (not path.exists() or _is_written(part)):
            return part
        if path.exists():
            return path
        if not path.parent.is_dir():
            break
        if not told and tell is not None:
            tell(f"{path}: not there yet; waiting a minute for it")
        told = True
        stop.wait(_POLL_S)
    raise RecordingError("there is no such file, nor does anybody write it", path)


def _is_written(path: Path) -> bool:
    """Whether somebody writes a file now; an old part file nobody does."""
    try:
        with path.open("rb") as file:
            return not _is_free(file.fileno())
    except OSError:
        return False


def _is_free(descriptor: int) -> bool:
    """Whether nobody writes an open file: whoever writes a log holds its lock."""
    if fcntl is not None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            return False  # it is held, or the file system has no locks
        fcntl.flock(descriptor, fcntl.LOCK_UN)
    return fcntl is not None


class _Tail:
    """The end of a file that grows.

    Attributes:
        file: the file.
        complete: the log's end was read.
        abandoned: its writer is gone, and it has no end.
    """

    def __init__(self, file: RecordFile, stop: Event) -> None:
        self.file = file
        self._stop = stop
        self.complete = self.abandoned = False

    def wait(self) -> bool:
        """Wait a moment for more; False where there will be none."""
        if self._stop.is_set():
            return False
        size, gone = self.file.size, _is_free(self.file.descriptor)
        if self.file.grown() > size:
            return True
        if gone:
            self.abandoned = True
            return False
        self._stop.wait(_POLL_S)
        return True


class _Cursor:
    """One reading of a growing file, block by block.

    Attributes:
        scan: what was found so far.
    """

    def __init__(self, tail: _Tail, start: int) -> None:
        self.scan = Scan(tail.file, Summary(Definitions(tail.file)))
        self._tail = tail
        self._at = start

    def blocks(self) -> Iterator[Block]:
        """The blocks of messages as they come."""
        while self._take_next():
            yield from self.scan.blocks
            self.scan.blocks.clear()

    def _take_next(self) -> bool:
        """The next record, waited for; False at the end."""
        while not self._is_there():
            if not self._tail.wait():
                return False
        raw = self._tail.file.record_at(self._at)
        self._at = raw.end
        if self.scan.take(raw):
            return True
        self._tail.complete = True
        return False

    def _is_there(self) -> bool:
        """The next record is whole."""
        file = self._tail.file
        room = file.size - self._at - wire.PREFIX_BYTES
        if room < 0:
            return False
        _, length = wire.PREFIX.unpack(file.read(self._at, wire.PREFIX_BYTES))
        return bool(length <= room)

    def frame_channels(self) -> frozenset[int]:
        """The channels that have a message for each frame."""
        return frozenset(
            identity
            for identity, channel in self.scan.definitions.channels.items()
            if channel.topic.endswith("/detections")
        )

    def messages(self, block: Block, topics: frozenset[str] | None) -> list[Message]:
        """A block's messages of these topics."""
        infos: dict[int, ChannelInfo] = self.scan.definitions.infos(None)
        wanted = {
            identity: info if topics is None or info.topic in topics else None
            for identity, info in infos.items()
        }
        if not any(wanted[identity] for identity in block.channels or ()):
            return []
        return read_messages(self._tail.file, block, wanted, 0, _FOREVER_NS)


class GrowingLog(LogReader):
    """A log read while it is written.

    `messages` goes on until the log is complete, its writer is gone, or ``stop`` is set. Opening
    waits for the first frames, so that what the log holds is known.

    Args:
        path: the log; where it is not there yet, its part file.
        limits: as for any log.
        stop: set to end the reading.
        tell: gets a line where the file has to be waited for.

    Raises:
        RecordingError: it is not there, not MCAP, or damaged.
    """

    def __init__(
        self,
        path: str | Path,
        limits: Limits = DEFAULT_LIMITS,
        stop: Event | None = None,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        self.path = Path(path)
        self.limits = limits
        stop = stop or Event()
        found = growing_path(self.path, stop, tell)
        try:
            self._file = RecordFile(found, limits)
        except RecordingError:  # it was completed this very moment
            self._file = RecordFile(self.path, limits)
        self._tail = _Tail(self._file, stop)
        try:
            self._start()
        except BaseException:
            self._file.close()
            raise

    def _start(self) -> None:
        while self._file.size < _LEAST_BYTES and self._tail.wait():
            pass
        self._begin = check_start(self._file).end
        cursor = _Cursor(self._tail, self._begin)
        for _ in cursor.blocks():
            counts = cursor.scan.counts
            if (
                sum(counts.get(channel, 0) for channel in cursor.frame_channels())
                >= _FRAMES_FIRST
            ):
                break
        self._scan = cursor.scan
        infos = cursor.scan.definitions.infos(None)
        self.channels = sorted(infos.values(), key=lambda info: (info.topic, info.id))

    @property
    def complete(self) -> bool:
        """The log's end was read."""
        return self._tail.complete

    @property
    def abandoned(self) -> bool:
        """Its writer is gone, and it has no end."""
        return self._tail.abandoned

    @property
    def index(self) -> LogIndex:
        """There is none yet.

        Raises:
            RecordingError: always.
        """
        raise RecordingError("it is still written: nothing is known of its end", self.path)

    @property
    def start_ns(self) -> int | None:
        """Not known."""
        return None

    @property
    def end_ns(self) -> int | None:
        """Not known."""
        return None

    @property
    def message_count(self) -> int:
        """How many messages have been read."""
        return sum(self._scan.counts.values())

    def messages(
        self,
        topics: Collection[str] | None = None,
        start_ns: int | None = None,
        end_ns: int | None = None,
        reverse: bool = False,
    ) -> Iterator[Message]:
        """The messages from the first on, as they come; each call reads the file anew.

        Raises:
            RecordingError: one comes late, or of a topic that began after the others.
        """
        if reverse or start_ns is not None or end_ns is not None:
            raise RecordingError(
                "it is still written: it is read from its start on", self.path
            )
        chosen = None if topics is None else frozenset(topics)
        known = frozenset(channel.topic for channel in self.channels)
        cursor = _Cursor(self._tail, self._begin)
        self._scan = cursor.scan
        waiting: list[tuple[tuple[int, int, int], Message]] = []
        given = -1
        for block in cursor.blocks():
            self._check_topics(cursor, block, known)
            for message in cursor.messages(block, chosen):
                if message.log_time_ns <= given:
                    raise self._cannot_follow(
                        message.topic,
                        f"a message of {message.log_time_ns} ns comes after those of {given} ns",
                    )
                heapq.heappush(waiting, (message.order, message))
            if block.channels is not None and block.channels & cursor.frame_channels():
                given = max(given, block.end_ns)
            while waiting and waiting[0][0][0] <= given:
                yield heapq.heappop(waiting)[1]
        while waiting and self.complete:
            yield heapq.heappop(waiting)[1]

    def _check_topics(self, cursor: _Cursor, block: Block, known: frozenset[str]) -> None:
        for identity in block.channels or ():
            topic = cursor.scan.definitions.channels[identity].topic
            if topic not in known:
                raise self._cannot_follow(topic, "it begins after the first frames")

    def _cannot_follow(self, topic: str, why: str) -> RecordingError:
        return RecordingError(
            f"{why}: such a log cannot be followed; replay it once it is complete",
            self.path,
            record=topic,
        )

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """The metadata records up to where the messages were read."""
        found = self._scan.metadata
        return [self._file.parse(records.parse_metadata, raw) for raw in found]

    def attachments(self, names: Sequence[str] | None = None) -> Iterator[Attachment]:
        """The attachments up to where the messages were read."""
        for raw in self._scan.attachments:
            found = read_attachment(self._file, raw)
            if names is None or found.name in names:
                yield found
