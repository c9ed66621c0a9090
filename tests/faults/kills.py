"""kill -9 at random moments of commands that write: nothing half has an output's name, and what
can be gone on with is.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from random import Random

from recorders.log import LogReader
from tests.faults.io_faults import COMMANDS
from tests.faults.small import annotated, run
from tests.faults.tally import Tally

_MAIN = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"


def kills(long: bool, seed: int = 0, tries: int | None = None) -> list[Tally]:
    """Each command that writes, killed at moments spread over how long it takes."""
    rng = Random(seed)
    count = tries or (100 if long else 2)
    tallies = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        annotated(folder, frames=60)
        for command, words in COMMANDS.items():
            tally = Tally(f"kill -9 of `{command}`")
            whole = _run(words, folder, None)
            for _ in range(count):
                after = rng.uniform(0.3, 1.0) * whole
                _try(tally, words, folder, after)
            tallies.append(tally)
    return tallies


def _run(words: list[str], folder: Path, after: float | None) -> float:
    """Run it in a folder of its own below; seconds that it took."""
    with tempfile.TemporaryDirectory(dir=folder) as name:
        return _started(words, Path(name), after)


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


def _try(tally: Tally, words: list[str], folder: Path, after: float) -> None:
    tally.tries += 1
    with tempfile.TemporaryDirectory(dir=folder) as name:
        place = Path(name)
        _started(words, place, after)
        here = Path.cwd()
        os.chdir(place)
        try:
            wrong = _half(place) or _again(words)
        finally:
            os.chdir(here)
    if wrong:
        tally.lost += 1
        tally.note(f"{tally.kind} after {after:.2f} s: {wrong}")
    else:
        tally.survived += 1


def _half(place: Path) -> str:
    """What has an output's name and is not whole."""
    for path in place.rglob("OUT*.mcap"):
        with LogReader(path) as log:
            list(log.messages())
    for path in place.rglob("OUT.html"):
        if not path.read_bytes().rstrip().endswith(b"</html>"):
            return f"{path.name} is half"
    return ""


def _again(words: list[str]) -> str:
    """Whether the same command does the rest (or does it anew)."""
    anew = [] if words[0] in ("index", "batch") else ["--force"]
    code, said = run(*words, *anew)
    return "" if code == 0 else f"again: exit {code}: {said.strip()[-200:]}"
