"""kill -9 in commands that write: nothing half has an output's name, what can be gone on with is,
and a recording loses at most its last second.

Each command is killed before calls that touch its output (as a power cut between two writes)
and at random moments, in processes forked from a warm one. Those of `batch`, which has workers,
are processes of their own.
"""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from mmap import mmap
from pathlib import Path
from random import Random
from typing import Any

from recorders.log import LogReader, LogWriter
from tests.faults.io_faults import COMMANDS, failing, files_of, forked, served
from tests.faults.small import annotated, boxes, memory, run, said
from tests.faults.tally import Tally

_MAIN = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"
_SECOND, _FRAME = 1_000_000_000, 40_000_000
_ROWS = ["query", "OUT.duckdb", "SELECT * FROM tracks ORDER BY ALL", "--format", "csv"]
_BATCH = ["batch", "../det.txt", "-o", "OUT", "--fps", "25", "--size", "640x480"]


def kills(long: bool, seed: int = 0, tries: int | None = None) -> Iterator[Tally]:
    """Each command that writes; `tries` of each."""
    count = tries or (86 if long else 2)
    yield batch_kills(seed, max(1, count // 8))
    yield from served("tests.faults.kills:all_kills", long, seed, count)


def all_kills(long: bool, seed: int, tries: int, only: str) -> Iterator[Tally]:
    """All but `batch`, in the process that has the library."""
    del long, only
    rng, library = Random(seed), failing()
    with tempfile.TemporaryDirectory(dir=memory()) as name:
        folder = Path(name)
        annotated(folder, frames=60)
        boxes(folder / "long.txt", frames=144)
        commands = COMMANDS | {
            "record": [w.replace("det.txt", "long.txt") for w in COMMANDS["record"]]
        }
        for command, words in commands.items():
            yield _command(command, words, folder, library, rng, tries)


def _command(
    command: str, words: list[str], folder: Path, library: Any, rng: Random, tries: int
) -> Tally:
    """Half of the tries before calls, spread over all of them; half at random moments."""
    tally = Tally(f"kill -9 of `{command}`")
    with tempfile.TemporaryDirectory(dir=folder) as name:
        place, begun = Path(name).resolve(), time.monotonic()
        answer, _ = forked(place, _work(words, library, 0))
        took, files = time.monotonic() - begun, files_of(place)
        rows, _ = forked(place, lambda _: said(*_ROWS))
    code, calls = answer
    assert code in (0, 3), (command, answer)
    for at, after in _moments(calls, took, rng, tries):
        with tempfile.TemporaryDirectory(dir=folder) as name:
            place = Path(name).resolve()
            newest = mmap(-1, 8)
            done, _ = forked(place, _work(words, library, at, newest), after)
            if done is not None:
                assert after is not None  # it was quicker than the kill
                continue
            tally.tries += 1
            wrong = (
                _half(place, files)
                or (command == "record" and _too_much_lost(place, newest))
                or _again(words, place, files, rows)
            )
        if wrong:
            tally.lost += 1
            tally.note(f"{tally.kind} at call {at} of {calls}, {after} s: {wrong}")
        else:
            tally.survived += 1
    return tally


def _moments(
    calls: int, took: float, rng: Random, tries: int
) -> Iterator[tuple[int, float | None]]:
    for number in range(tries):
        if number % 2 == 0:
            yield 1 + (number * calls // tries + rng.randrange(3)) % calls, None
        else:
            yield 0, rng.uniform(0.05, 0.95) * took


def _work(
    words: list[str], library: Any, at: int, newest: mmap | None = None
) -> Callable[[Path], Any]:
    """The command, killed before its call `at`; `newest` holds the log time that was written
    last.
    """

    def work(place: Path) -> Any:
        if newest is not None:
            _watch(newest)
        library.fail_arm(str(place).encode(), at, 1, -1)
        try:
            code, told = run(*words)
            return code if code in (0, 3) else told, library.fail_count()
        finally:
            library.fail_arm(b"", 0, 0, 0)

    return work


def _watch(newest: mmap) -> None:
    write = LogWriter.write

    def watched(
        self: LogWriter, channel: int, data: bytes, log_ns: int, *rest: Any
    ) -> None:
        newest[:8] = struct.pack("<q", log_ns)
        write(self, channel, data, log_ns, *rest)

    LogWriter.write = watched  # type: ignore[assignment, method-assign]


def _half(place: Path, whole: dict[str, str]) -> str:
    """What has an output's name and is not the whole output."""
    for name, digest in files_of(place).items():
        if ".part" in name or name.endswith((".duckdb", ".wal")) or name.startswith("."):
            continue
        if whole.get(name) != digest:
            return f"{name} is not what it is when whole"
    return ""


def _too_much_lost(place: Path, newest: mmap) -> str:
    """Whether what `recover` makes of the part file lacks more than a second."""
    part, out = place / "OUT.mcap.part", place / "RECOVERED.mcap"
    (written,) = struct.unpack("<q", newest[:8])
    if not part.exists() or written == 0:
        return ""
    (code, told), _ = forked(place, lambda _: run("recover", str(part), "-o", str(out)))
    last = 0
    if out.exists():
        with LogReader(out) as log:
            last = max((m.log_time_ns for m in log.messages()), default=0)
        out.unlink()
    if written - last > _SECOND + _FRAME:  # a chunk spans a second; the next frame ends it
        return f"{(written - last) / 1e9:.2f} s lost; recover: exit {code}: {told[-200:]}"
    return ""


def _again(words: list[str], place: Path, files: dict[str, str], rows: Any) -> str:
    """Whether the same command does the rest, or does it anew, and comes to the same."""
    anew = [] if words[0] == "index" else ["--force"]
    answer, raised = forked(place, lambda _: run(*words, *anew))
    code, told = answer or (70, raised)
    if code not in (0, 3):
        return f"again: exit {code}: {told.strip()[-200:]}"
    if words[0] == "index":
        answer, _ = forked(place, lambda _: said(*_ROWS))
        return "" if answer == rows else "again: other rows"
    found = files_of(place)
    return "" if found == files else f"again: {sorted(found)}, not {sorted(files)}"


def batch_kills(seed: int, tries: int) -> Tally:
    """`batch` with its workers, killed at random moments."""
    tally, rng = Tally("kill -9 of `batch`"), Random(seed)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        boxes(folder / "det.txt", frames=60)
        whole = _batch(folder, None)
        for _ in range(tries):
            tally.tries += 1
            after = rng.uniform(0.3, 1.0) * whole
            with tempfile.TemporaryDirectory(dir=folder) as place:
                _started(_BATCH, Path(place), after)
                _started(_BATCH, Path(place), None)
                code, rows = said(
                    "query", f"{place}/OUT", "SELECT count(*) FROM tracks", "--json"
                )
            if code == 0 and '"count_star()": 0' not in rows:
                tally.survived += 1
            else:
                tally.lost += 1
                tally.note(f"{tally.kind} after {after:.2f} s: exit {code}: {rows[:200]}")
    return tally


def _batch(folder: Path, after: float | None) -> float:
    """Seconds that it takes."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        return _started(_BATCH, Path(place), after)


def _started(words: list[str], place: Path, after: float | None) -> float:
    begun = time.monotonic()
    process = subprocess.Popen(
        [sys.executable, "-c", _MAIN, *words],
        cwd=place,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        process.wait(after)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
    return time.monotonic() - begun
