"""Recordings of hours and of a day: memory that does not grow with them, time that grows as they do.

Boxes alone, two a second: two people cross every two minutes.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from tests.faults.tally import Tally

_MAIN = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"
_FPS, _EVERY, _TAKES = 2, 240, 40
_MOST_MB, _STEEPEST = 500, 1.3
_COMMANDS = {
    "record": "record det.txt -o scene.mcap --fps 2 --size 640x480",
    "replay": "replay scene.mcap -o made.mcap",
    "query": "query made.mcap --ask met 1",
    "report": "report made.mcap -o report.html",
    "evidence": "evidence made.mcap --events 1 2 3 -o evidence",
    "verify": "verify made.mcap",
}


def length(long: bool, seed: int = 0) -> Iterator[Tally]:
    """Each command on each length: peak memory, and processor time against the length before."""
    del seed
    tally, before = (
        Tally("recordings of hours, boxes alone"),
        dict[str, tuple[float, float]](),
    )
    for hours in (1, 6, 24) if long else (0.5, 1):
        with tempfile.TemporaryDirectory() as name:
            write_boxes(Path(name) / "det.txt", hours)
            for command, words in _COMMANDS.items():
                seconds, megabytes, code, said = measured(words.split(), Path(name))
                tally.tries += 1
                told = f"{hours:g} h, {command}: {seconds:.1f} s, {megabytes:.0f} MB, exit {code}"
                print(told, file=sys.stderr, flush=True)
                least, earlier = before.get(command, (hours, seconds))
                before[command] = hours, seconds
                # What each command takes to begin with does not count.
                steep = seconds - 2 > _STEEPEST * earlier * hours / least
                if code not in (0, 3) or megabytes > _MOST_MB or steep:
                    tally.lost += 1
                    tally.note(f"{told}; {earlier:.1f} s for {least:g} h {said[-200:]}")
                else:
                    tally.survived += 1
    yield tally


def write_boxes(path: Path, hours: float) -> None:
    """The detections, for so many hours."""
    with path.open("w") as file:
        for frame in range(int(hours * 3600 * _FPS)):
            step = frame % _EVERY
            if step < _TAKES:
                file.write(f"{frame + 1},-1,{15 * step},200,40,100,1,-1,-1,-1\n")
                file.write(f"{frame + 1},-1,{600 - 15 * step},210,40,100,1,-1,-1,-1\n")


def measured(words: list[str], place: Path) -> tuple[float, float, int, str]:
    """Processor seconds, peak resident megabytes, exit code and stderr of a command."""
    process = subprocess.Popen(
        [sys.executable, "-c", _MAIN, *words],
        cwd=place,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
        stdout=subprocess.DEVNULL,
        stderr=(place / "said.txt").open("w"),
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    said = (place / "said.txt").read_text()
    return used.ru_utime + used.ru_stime, used.ru_maxrss / 1024, process.returncode, said
