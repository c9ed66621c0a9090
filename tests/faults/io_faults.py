"""Each call that writes, and each that reads, fails in turn, in each command that writes: the old
output or the whole new one, never half; one line; nothing temporary left behind.

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
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from select import select
from signal import SIGKILL
from typing import Any

import msgspec

from tests.faults.tally import Tally

HERE = Path(__file__).resolve().parent
ALWAYS = 1 << 30
_CHANGES, _READS = 1, 2  # as fail.c names them
ERRORS = {
    _CHANGES: (errno.ENOSPC, errno.EIO, errno.EMFILE, errno.EINTR),
    _READS: (errno.EIO, errno.EMFILE, errno.EINTR),
}
_KINDS = {_CHANGES: "writes", _READS: "reads"}
_SECONDS = 300.0  # a try that takes longer has hung; the machine may be busy


def compiler() -> str | None:
    """A C compiler, if the machine has one."""
    return shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")


def io_faults(long: bool, seed: int = 0, only: str = "") -> Iterator[Tally]:
    """All commands that write (whose name begins so), all their calls (or every few), with
    several errors.
    """
    return served("tests.faults.io_faults:all_faults", long, seed, 0, only)


def served(work: str, long: bool, seed: int, tries: int, only: str = "") -> Iterator[Tally]:
    """What `module:function` counts in a process of its own that has the library, as it comes."""
    with tempfile.TemporaryDirectory() as name:
        library = Path(name) / "fail.so"
        built = compiler()
        assert built is not None, "no C compiler"
        subprocess.run(
            [built, "-O2", "-shared", "-fPIC", "-o", library, HERE / "fail.c", "-ldl"],
            check=True,
        )
        has_library = {"LD_PRELOAD": str(library), "SCENETRACE_FAIL": str(library)}
        yield from counted(work, long, seed, tries, only, has_library)


def counted(
    work: str, long: bool, seed: int, tries: int, only: str, variables: Mapping[str, str]
) -> Iterator[Tally]:
    """What `module:function` counts in a process of its own, with more environment variables, as it
    comes.
    """
    module, function = work.split(":")
    script = (
        f"from {module} import {function} as work; from tests.faults.io_faults import tell;"
        f" tell(work({long}, {seed}, {tries}, {only!r}))"
    )
    path = os.pathsep.join([str(HERE.parent.parent), *sys.path])
    with subprocess.Popen(
        [sys.executable, "-c", script],
        env={**os.environ, **variables, "PYTHONPATH": path},
        stdout=subprocess.PIPE,
    ) as process:
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(_TOLD):
                yield msgspec.json.decode(line.removeprefix(_TOLD), type=Tally)
    assert process.returncode == 0, f"{work} failed"


_TOLD = b"tally "


def tell(tallies: Iterable[Tally]) -> None:
    """Write each tally to stdout once it is counted, for `served`."""
    for tally in tallies:
        sys.stdout.write(_TOLD.decode() + msgspec.json.encode(tally).decode() + "\n")
        sys.stdout.flush()


COMMANDS: dict[str, list[str]] = {
    "record": ["record", "../det.txt", "-o", "OUT.mcap", "--fps", "25", "--size", "640x480"],
    "replay": ["replay", "../scene.mcap", "-o", "OUT.mcap"],
    "index": ["index", "../made.mcap", "-o", "OUT.duckdb"],
    "seal": ["seal", "../scene.mcap", "../made.mcap", "-o", "OUT.json"],
    "recover": ["recover", "../made.mcap", "-o", "OUT.mcap"],
    "cut": ["cut", "../made.mcap", "--from", "0.1", "--to", "0.3", "-o", "OUT.mcap"],
    "export mot": ["export", "../made.mcap", "--to", "mot", "-o", "OUT.txt"],
    "export graphml": ["export", "../made.mcap", "--to", "graphml", "-o", "OUT.graphml"],
    "export csv": ["export", "../made.mcap", "--to", "csv", "-o", "OUT"],
    "query": ["query", "../made.mcap", "SELECT * FROM tracks", "--format", "csv", "-o", "OUT.csv"],
    "report": ["report", "../made.mcap", "-o", "OUT.html"],
    "evidence": ["evidence", "../made.mcap", "--events", "1", "-o", "OUT"],
}  # fmt: skip
LASTING = frozenset({"index"})
"""Commands whose output is added to: what is whole of it may stay."""
KEEPING = frozenset({"record"})
"""Commands whose part file is for `recover`: it stays where they failed."""


def failing() -> Any:
    """The library, in a process that `served` started."""
    library = ctypes.CDLL(os.environ["SCENETRACE_FAIL"])
    library.fail_arm.argtypes = [
        ctypes.c_char_p,
        ctypes.c_long,
        ctypes.c_long,
        ctypes.c_int,
    ]
    library.fail_count.restype = ctypes.c_long
    library.fail_struck.restype = ctypes.c_char_p
    return library


def all_faults(long: bool, seed: int, tries: int, only: str) -> Iterator[Tally]:
    """Go through all of it, in the process that has the library."""
    del seed, tries
    from tests.faults.small import annotated, memory

    library = failing()
    with tempfile.TemporaryDirectory(dir=memory()) as name:
        folder = Path(name).resolve()
        annotated(folder)
        for command, words in COMMANDS.items():
            if command.startswith(only):
                warm(words, folder)
                for kind in (_CHANGES, _READS):
                    yield from _command(command, words, folder, library, kind, long)


def warm(words: list[str], folder: Path) -> None:
    """Run a command here: what it loads and keeps, the processes that are forked have then."""
    from tests.faults.small import run

    before = Path.cwd()
    with tempfile.TemporaryDirectory(dir=folder) as name:
        os.chdir(name)
        run(*words)
        os.chdir(before)


def _command(
    command: str, words: list[str], folder: Path, library: Any, kind: int, long: bool
) -> Iterator[Tally]:
    """A row for each error."""
    tried = [_try(words, folder, library, kind, 0, 0, 0) for _ in range(3 if long else 1)]
    # Threads of a library may divide their work otherwise the next time.
    whole, count = tried[0][0], max(calls for _, calls in tried)
    assert whole.code in (0, 3), (command, whole)
    for error in ERRORS[kind] if long else ERRORS[kind][:1]:
        name = errno.errorcode[error]
        tally = Tally(f"a call that {_KINDS[kind]} fails in `{command}`: {name}")
        for at in range(1, count + 1, 1 if long else max(1, count // 3)):
            for times in _times(error) if long else (ALWAYS,):
                done, _ = _try(words, folder, library, kind, at, times, error)
                if not done.struck and done.code == whole.code:
                    continue  # it made fewer calls this time
                tally.tries += 1
                often = "always" if times == ALWAYS else "once"
                where = f"{often} from call {at} of {count} ({done.struck})"
                _judge(tally, done, whole, where, command, once=times == 1)
        yield tally


def _times(error: int) -> tuple[int, ...]:
    """Once, or from there on; a signal does not come for ever."""
    return (1,) if error == errno.EINTR else (1, ALWAYS)


class Tried(msgspec.Struct):
    """How a try ended: exit code, stderr, the call that failed, files in the folder with their
    digests.
    """

    code: int
    said: str
    struck: str
    files: dict[str, str]


def _try(
    words: list[str],
    folder: Path,
    library: Any,
    kind: int,
    at: int,
    times: int,
    error: int,
) -> tuple[Tried, int]:
    from tests.faults.small import run

    def work(place: Path) -> tuple[int, str, str, int]:
        below = place if kind == _CHANGES else folder  # what is read lies beside
        library.fail_kind(kind)
        library.fail_arm(str(below).encode(), at, times, error)
        try:
            code, told = run(*words)
            return code, told, library.fail_struck().decode(), library.fail_count()
        finally:
            library.fail_arm(b"", 0, 0, 0)

    with tempfile.TemporaryDirectory(dir=folder) as name:
        place = Path(name).resolve()
        answer, said = forked(place, work, _SECONDS)
        code, told, struck, count = answer or (70, said or "killed, or it hung", "", 0)
        return Tried(code, told, struck, files_of(place)), count


def forked(
    place: Path, work: Callable[[Path], Any], kill_after: float | None = None
) -> tuple[Any, str]:
    """What `work` answers in a process forked for it, working in `place`; None where it was
    killed or raised, and then what it raised.
    """
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        answer, said = None, ""
        try:
            os.chdir(place)
            answer = work(place)
        except BaseException as raised:
            said = f"{type(raised).__name__}: {raised}"
        finally:
            os.write(writing, msgspec.json.encode((answer, said)))
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as pipe:
        if kill_after is not None and not select([pipe], [], [], kill_after)[0]:
            os.kill(child, SIGKILL)
        told = pipe.read()
    os.waitpid(child, 0)
    if not told:
        return None, ""
    answer, said = msgspec.json.decode(told)
    return answer, said


def files_of(place: Path) -> dict[str, str]:
    """Every file below, with a digest of what is in it."""
    return {
        path.relative_to(place).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(place.rglob("*"))
        if path.is_file()
    }


def _judge(
    tally: Tally, done: Tried, whole: Tried, where: str, command: str, *, once: bool
) -> None:
    lasting = command in LASTING
    lines = [line for line in done.said.splitlines() if line.strip()]
    if done.code == 70 or "Traceback" in done.said:
        tally.foreign += 1
        tally.note(f"{tally.kind}: {where}: {done.said[-200:]}")
        return
    # A database's bytes are not the same each time; that it opens is tested elsewhere.
    same = set(done.files) == set(whole.files) if lasting else done.files == whole.files
    if done.code in (0, 3):
        told = bool(lines) and (done.struck == "unlink" or done.code == 3 != whole.code)
        if same or told:
            tally.survived += 1
        else:
            tally.silent += 1
            tally.note(f"{tally.kind}: {where}: exit {done.code} with {sorted(done.files)}")
        return
    half = {name: d for name, d in done.files.items() if whole.files.get(name) != d}
    parts = [name for name in half if ".part" in name]
    # Where nothing more can be written, nothing can be removed either.
    excused = not once or done.struck == "unlink" or command in KEEPING
    if half and not lasting and not (excused and parts == list(half)):
        tally.lost += 1
        tally.note(f"{tally.kind}: {where}: exit {done.code}, left {sorted(half)}")
    elif not lines:
        tally.silent += 1
        tally.note(f"{tally.kind}: {where}: exit {done.code} without a word")
    else:
        tally.survived += 1
