"""Bytes flipped and lengths cut: an answer is the undamaged one, or an error; whatever chunk is
whole is recovered, and what is lost is told.
"""

from __future__ import annotations

import hashlib
import struct
import sys
import tempfile
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, Future
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from random import Random
from time import monotonic
from typing import Any
from unittest.mock import patch

from mcap.data_stream import ReadDataStream
from mcap.records import Chunk, Message
from mcap.stream_reader import breakup_chunk

from reasoning.questions.ingest import read_recordings
from recorders.errors import SceneTraceError
from recorders.log import LogReader
from recorders.log.recovery import recover
from tests.faults.small import annotated, memory, run, said
from tests.faults.tally import Tally

COMPRESSIONS = ("", "lz4", "zstd")
FRAMES, CHUNK_NS = 2, 40_000_000
AT_ONCE = ("events.confirm_s=0", "events.confirm_hits=1", "events.hindsight=false")
"""So that there are tracks and events in two frames."""
_CHUNK_OPCODE = 6
_TOLD_EVERY_S = 60
_COMMANDS_EVERY = 499
"""A prime: the places at which whole commands run differ from log to log."""

Written = tuple[str, int, int, bytes]
"""A message as it was written: topic, log time, sequence, data."""


def answers(path: Path) -> str:
    """A digest of all rows that can be asked for, of the metadata, and of what is attached."""
    found = hashlib.sha256()

    def take(table: str, rows: Sequence[tuple[Any, ...]]) -> None:
        found.update(repr((table, rows)).encode())

    read_recordings(path, take, name="recording")
    with LogReader(path) as log:
        found.update(repr(log.metadata()).encode())
        for extra in log.attachments():
            found.update(repr(extra).encode())
    return found.hexdigest()


def messages_of(path: Path) -> set[Written]:
    """The messages that can be read, each with its topic and times."""
    with LogReader(path) as log:
        return {(m.topic, m.log_time_ns, m.sequence, m.data) for m in log.messages()}


@dataclass(frozen=True)
class Sound:
    """The undamaged log: its bytes, what it answers, what commands say, and its chunks, read by
    the MCAP project's own library."""

    data: bytes
    answers: str
    commands: list[tuple[int, str]]
    messages: set[Written]
    chunks: list[tuple[int, int, set[Written]]]
    opcodes: list[int]


def sound(path: Path) -> Sound:
    """All that is compared with."""
    data = path.read_bytes()
    messages = messages_of(path)
    topics = {}
    with LogReader(path) as log:
        topics = {channel.id: channel.topic for channel in log.channels}
    chunks, opcodes, place = [], [], 8
    while place < len(data) - 8:
        opcode, length = struct.unpack_from("<BQ", data, place)
        opcodes.append(place)
        if opcode == _CHUNK_OPCODE:
            with path.open("rb") as file:
                file.seek(place + 9)
                chunk = Chunk.read(ReadDataStream(file))
            held = {
                (topics[m.channel_id], m.log_time, m.sequence, m.data)
                for m in breakup_chunk(chunk)
                if isinstance(m, Message)
            }
            # Its opcode and length can be made out again.
            chunks.append((place + 9, place + 9 + length, held))
        place += 9 + length
    assert messages == {m for _, _, held in chunks for m in held}
    return Sound(data, answers(path), _commands(path), messages, chunks, opcodes)


def _commands(path: Path) -> list[tuple[int, str]]:
    """What whole commands answer of a log: exit code and stdout, or the file's text."""
    out = path.with_name("out.txt")
    told = [
        said("query", str(path), "SELECT * FROM tracks ORDER BY ALL", "--format", "csv"),
        said("query", str(path), "SELECT * FROM events ORDER BY ALL", "--json"),
        said("verify", str(path)),
    ]
    code, _ = run("export", str(path), "--to", "mot", "-o", str(out), "--force")
    told.append((code, out.read_text() if code == 0 else ""))
    out.unlink(missing_ok=True)
    return told


def flips(long: bool, seed: int = 0) -> Iterator[Tally]:
    """Each byte of three logs (or some of them) with one bit turned over, and each bit of the
    bytes that say what a record is."""
    for name in COMPRESSIONS:
        yield _each_log(name, long, seed, cuts=False)


def cuts(long: bool, seed: int = 0) -> Iterator[Tally]:
    """Each length of three logs (or some of them)."""
    for name in COMPRESSIONS:
        yield _each_log(name, long, seed, cuts=True)


def _each_log(compression: str, long: bool, seed: int, *, cuts: bool) -> Tally:
    what = "cut" if cuts else "byte flipped"
    tally = Tally(f"{what}, log of {compression or 'no compression'}")
    # Where files lie in memory and nobody waits for a thread, thousands of them cost little.
    with (
        tempfile.TemporaryDirectory(dir=memory()) as name,
        patch("recorders.log.writer.ThreadPoolExecutor", _AtOnce),
    ):
        folder = Path(name)
        log = annotated(folder, compression, FRAMES, CHUNK_NS, AT_ONCE, bare=True)
        bad = folder / "bad.mcap"  # which name the rows bear
        log.rename(bad)
        right = sound(bad)
        data = right.data
        begun = monotonic()
        for number, (place, bit) in enumerate(_places(right, long, seed, cuts=cuts)):
            if cuts:
                bad.write_bytes(data[:place])
                spoilt = range(place, len(data))
            else:
                byte = data[place] ^ (1 << bit)
                bad.write_bytes(data[:place] + bytes([byte]) + data[place + 1 :])
                spoilt = range(place, place + 1)
            with_commands = number % (_COMMANDS_EVERY if long else 20) == 0
            wrong = _judged(bad, right, spoilt, with_commands)
            tally.tries += 1
            if monotonic() - begun > _TOLD_EVERY_S:
                begun = monotonic()
                print(f"... {tally.row()}, {len(data)} bytes", file=sys.stderr, flush=True)
            if wrong is None:
                tally.survived += 1
            else:
                kind, text = wrong
                setattr(tally, kind, getattr(tally, kind) + 1)
                tally.note(f"{tally.kind}: {what} at {place} (bit {bit}): {text}")
                print(f"... {tally.notes[-1]}", file=sys.stderr, flush=True)
    return tally


class _AtOnce(Executor):
    """Does what it is given before it answers."""

    def __init__(self, max_workers: int, thread_name_prefix: str) -> None:
        del max_workers, thread_name_prefix

    def submit(self, work: Any, /, *args: Any, **options: Any) -> Future[Any]:
        done: Future[Any] = Future()
        try:
            done.set_result(work(*args, **options))
        except Exception as error:
            done.set_exception(error)
        return done


def _judged(
    bad: Path, right: Sound, spoilt: range, with_commands: bool
) -> tuple[str, str] | None:
    """What went wrong: which kind, and what; None if nothing did."""
    try:
        try:
            if answers(bad) != right.answers:
                return "silent", "another answer"
        except SceneTraceError:
            pass
        if with_commands:
            for told, expected in zip(_commands(bad), right.commands, strict=True):
                if told[0] == 0 and told != expected:
                    return "silent", f"another answer of a command: {told[1][:100]}"
        return _recovered(bad, right, spoilt)
    except Exception as error:  # what is counted here
        return "foreign", f"{type(error).__name__}: {error}"


@lru_cache(maxsize=64)
def _held(digest: bytes, path: Path) -> set[Written]:
    """The messages of a log of this digest: most places come to one of a few logs."""
    del digest
    return messages_of(path)


def _recovered(bad: Path, right: Sound, spoilt: range) -> tuple[str, str] | None:
    out = bad.with_name("recovered.mcap")
    try:
        report = recover(bad, out, force=True)
        kept = _held(hashlib.sha256(out.read_bytes()).digest(), out)
    except SceneTraceError as error:
        kept, report = set(), None
        refused = str(error)
    if not kept <= right.messages:
        return "silent", "recovered what was never written"
    if report is not None and kept != right.messages and report.is_complete:
        return "silent", "recovered less, and said nothing of it"
    for start, end, held in right.chunks:
        whole = end <= spoilt.start or start >= spoilt.stop
        if whole and not held <= kept:
            why = f"only {len(kept)} messages" if report is not None else refused
            return "lost", f"the whole chunk before byte {end} was not recovered: {why}"
    return None


def _places(
    right: Sound, long: bool, seed: int, *, cuts: bool
) -> Iterator[tuple[int, int]]:
    """Bytes and bits."""
    size, rng = len(right.data), Random(seed)
    for place in range(size) if long else sorted(rng.sample(range(size), 50)):
        yield place, place % 8
    opcodes = right.opcodes if long else rng.sample(right.opcodes, 2)
    if not cuts:
        for place in opcodes:
            for bit in range(8):
                yield place, bit
