"""Bytes flipped and lengths cut: an answer is the undamaged one, or an error."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from random import Random
from typing import Any

from reasoning.questions.ingest import read_recordings
from recorders.errors import SceneTraceError
from recorders.log import LogReader
from recorders.log.recovery import recover
from tests.faults.small import annotated
from tests.faults.tally import Tally

COMPRESSIONS = ("", "lz4", "zstd")


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


def whole_chunks(path: Path) -> set[tuple[str, int, int, bytes]]:
    """The messages that can be read, each with its topic and times."""
    with LogReader(path) as log:
        return {(m.topic, m.log_time_ns, m.sequence, m.data) for m in log.messages()}


def flips(long: bool, seed: int = 0) -> list[Tally]:
    """Each byte of three logs (or some of them) with one bit turned over."""
    return [_each_log(name, long, seed, cuts=False) for name in COMPRESSIONS]


def cuts(long: bool, seed: int = 0) -> list[Tally]:
    """Each length of three logs (or some of them)."""
    return [_each_log(name, long, seed, cuts=True) for name in COMPRESSIONS]


def _each_log(compression: str, long: bool, seed: int, *, cuts: bool) -> Tally:
    what = "cut" if cuts else "byte flipped"
    tally = Tally(f"{what}, log of {compression or 'no compression'}")
    # Where files lie in memory, thousands of them cost little.
    with tempfile.TemporaryDirectory(dir=_memory()) as name:
        folder = Path(name)
        log = annotated(folder, compression)
        data, messages = log.read_bytes(), whole_chunks(log)
        bad = folder / "bad.mcap"
        bad.write_bytes(data)
        right = answers(bad)  # which name the file
        for place in _places(len(data), long, seed):
            if cuts:
                bad.write_bytes(data[:place])
            else:
                byte = data[place] ^ (1 << place % 8)
                bad.write_bytes(data[:place] + bytes([byte]) + data[place + 1 :])
            _judge(tally, bad, right, messages, f"{what} at {place}")
    return tally


def _judge(
    tally: Tally,
    bad: Path,
    right: str,
    messages: set[tuple[str, int, int, bytes]],
    where: str,
) -> None:
    tally.tries += 1
    try:
        same = answers(bad) == right
    except SceneTraceError:
        same = True
    except Exception as error:  # what is counted here
        tally.foreign += 1
        tally.note(f"{where}: {type(error).__name__}: {error}")
        return
    if not same:
        tally.silent += 1
        tally.note(f"{where}: another answer")
        return
    out = bad.with_name("recovered.mcap")
    try:
        recover(bad, out, force=True)
        if not whole_chunks(out) <= messages:
            tally.silent += 1
            tally.note(f"{where}: recovered what was never written")
            return
    except SceneTraceError:
        pass
    except Exception as error:
        tally.foreign += 1
        tally.note(f"{where}: recover: {type(error).__name__}: {error}")
        return
    tally.survived += 1


def _places(size: int, long: bool, seed: int) -> Iterable[int]:
    if long:
        return range(size)
    return sorted(Random(seed).sample(range(size), min(size, 60)))


def _memory() -> str | None:
    return "/dev/shm" if Path("/dev/shm").is_dir() else None
