"""Each call that writes fails in turn, in each command that writes: the old output or the whole
new one, never half; one line; nothing temporary left behind.

The calls fail by a small C library that is loaded before libc, so this needs a C compiler and
runs in a process of its own, which forks for each try.
"""

from __future__ import annotations

import ctypes
import errno
import hashlib
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import msgspec

from tests.faults.tally import Tally

HERE = Path(__file__).resolve().parent
ERRORS = (errno.ENOSPC, errno.EIO, errno.EMFILE, errno.EINTR)


def compiler() -> str | None:
    """A C compiler, if the machine has one."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def io_faults(long: bool, seed: int = 0) -> list[Tally]:
    """All commands that write, all their calls (or every few), with several errors."""
    del seed
    with tempfile.TemporaryDirectory() as name:
        library = Path(name) / "fail.so"
        built = compiler()
        assert built is not None, "no C compiler"
        subprocess.run(
            [built, "-O2", "-shared", "-fPIC", "-o", library, HERE / "fail.c", "-ldl"],
            check=True,
        )
        done = subprocess.run(
            [sys.executable, "-c", "from tests.faults.io_faults import serve; serve()"],
            env={
                **os.environ,
                "LD_PRELOAD": str(library),
                "SCENETRACE_FAIL": str(library),
                "SCENETRACE_LONG": "1" if long else "",
                "PYTHONPATH": os.pathsep.join([str(HERE.parent.parent), *sys.path]),
            },
            stdout=subprocess.PIPE,
            check=True,
        )
    return msgspec.json.decode(done.stdout.splitlines()[-1], type=list[Tally])


COMMANDS: dict[str, list[str]] = {
    "record": ["record", "../det.txt", "-o", "OUT.mcap", "--fps", "25", "--size", "640x480"],
    "replay": ["replay", "../scene.mcap", "-o", "OUT.mcap"],
    "index": ["index", "../made.mcap", "-o", "OUT.duckdb"],
    "recover": ["recover", "../made.mcap", "-o", "OUT.mcap"],
    "cut": ["cut", "../made.mcap", "--from", "0.1", "--to", "0.3", "-o", "OUT.mcap"],
    "export mot": ["export", "../made.mcap", "--to", "mot", "-o", "OUT.txt"],
    "export graphml": ["export", "../made.mcap", "--to", "graphml", "-o", "OUT.graphml"],
    "export csv": ["export", "../made.mcap", "--to", "csv", "-o", "OUT"],
    "query": ["query", "../made.mcap", "SELECT * FROM tracks", "--format", "csv", "-o", "OUT.csv"],
    "report": ["report", "../made.mcap", "-o", "OUT.html"],
    "batch": ["batch", "../det.txt", "-o", "OUT", "--fps", "25", "--size", "640x480"],
}  # fmt: skip
LASTING = frozenset({"index", "batch"})
"""Commands whose output is added to: what is whole of it may stay."""


def serve() -> None:
    """In the process that has the library: go through all of it, write the tallies."""
    library = ctypes.CDLL(os.environ["SCENETRACE_FAIL"])
    library.fail_arm.argtypes = [
        ctypes.c_char_p,
        ctypes.c_long,
        ctypes.c_long,
        ctypes.c_int,
    ]
    library.fail_count.restype = ctypes.c_long
    long = bool(os.environ["SCENETRACE_LONG"])
    from tests.faults.small import annotated, run

    tallies = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        annotated(folder)
        for command, words in COMMANDS.items():
            if command == "batch":
                continue  # its workers are processes of their own: see `kills`
            # Everything is loaded and every pool warm before the first try.
            tallies.append(_command(command, words, folder, library, long, run))
    sys.stdout.write(msgspec.json.encode([asdict(t) for t in tallies]).decode() + "\n")


def _command(
    command: str,
    words: list[str],
    folder: Path,
    library: Any,
    long: bool,
    run: Callable[..., tuple[int, str]],
) -> Tally:
    tally = Tally(f"a failing call in `{command}`")
    whole, count = _try(words, folder, library, run, 0, 0, 0)
    assert whole.code == 0, (command, whole)
    step = 1 if long else max(1, count // 3)
    for error in ERRORS if long else ERRORS[:1]:
        for at in range(1, count + 1, step):
            for times in (1, 1 << 30) if long else (1 << 30,):
                done, _ = _try(words, folder, library, run, at, times, error)
                tally.tries += 1
                where = f"{errno.errorcode[error]} x {times} at call {at} of {count}"
                _judge(tally, done, whole, where, command in LASTING)
    return tally


class Tried(msgspec.Struct):
    """How a try ended: exit code, stderr, files in the folder with their digests."""

    code: int
    said: str
    files: dict[str, str]


def _try(
    words: list[str],
    folder: Path,
    library: Any,
    run: Callable[..., tuple[int, str]],
    at: int,
    times: int,
    error: int,
) -> tuple[Tried, int]:
    with tempfile.TemporaryDirectory(dir=folder) as name:
        place = Path(name).resolve()
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            code, said, count = 70, "", 0
            try:
                os.chdir(place)
                library.fail_arm(str(place).encode(), at, times, error)
                code, said = run(*words)
                count = library.fail_count()
            except BaseException as raised:
                said = f"{type(raised).__name__}: {raised}"
            finally:
                library.fail_arm(b"", 0, 0, 0)
                os.write(writing, msgspec.json.encode((code, said, count)))
                os._exit(0)
        os.close(writing)
        with os.fdopen(reading, "rb") as pipe:
            told = pipe.read()
        os.waitpid(child, 0)
        code, said, count = msgspec.json.decode(told, type=tuple[int, str, int])
        files = {
            path.relative_to(place).as_posix(): hashlib.sha256(
                path.read_bytes()
            ).hexdigest()
            for path in sorted(place.rglob("*"))
            if path.is_file()
        }
    return Tried(code, said, files), count


def _judge(tally: Tally, done: Tried, whole: Tried, where: str, lasting: bool) -> None:
    lines = [line for line in done.said.splitlines() if line.strip()]
    if done.code == 70 or "Traceback" in done.said:
        tally.foreign += 1
        tally.note(f"{tally.kind}: {where}: {done.said[-200:]}")
        return
    # A database's bytes are not the same each time; that it opens is tested elsewhere.
    same = set(done.files) == set(whole.files) if lasting else done.files == whole.files
    if done.code in (0, 3):
        if same:
            tally.survived += 1
        else:
            tally.silent += 1
            tally.note(f"{tally.kind}: {where}: exit {done.code} with {sorted(done.files)}")
        return
    half = {name: d for name, d in done.files.items() if whole.files.get(name) != d}
    parts = [name for name in half if name.endswith(".part")]
    if half and not lasting and parts != list(half):
        tally.lost += 1
        tally.note(f"{tally.kind}: {where}: exit {done.code}, left {sorted(half)}")
    elif not lines:
        tally.silent += 1
        tally.note(f"{tally.kind}: {where}: exit {done.code} without a word")
    else:
        tally.survived += 1
