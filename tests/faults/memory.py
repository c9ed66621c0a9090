"""Hostile files under a limit of memory and time: refused or read, never more than they may."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tests.faults.tally import Tally
from tests.lying_files import mcap_bomb, png

_MAIN = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"
_MEMORY = 2 << 30
_SECONDS = 60.0


def _xml_bomb() -> bytes:
    levels = "".join(f'<!ENTITY a{k} "{f"&a{k - 1};" * 10}">' for k in range(1, 10))
    return f'<!DOCTYPE x [<!ENTITY a0 "ha">{levels}]><dataset>&a9;</dataset>'.encode()


HOSTILE: dict[str, tuple[str, Callable[[], bytes]]] = {
    "a picture that claims 60000 x 60000": ("pictures/1.png", lambda: png(60000, 60000)),
    "entities of XML that multiply": ("bomb.xml", _xml_bomb),
    "a chunk that unpacks to 1 GiB": ("bomb.mcap", lambda: mcap_bomb(1 << 30, 1 << 30)),
    "JSON, nested 10^5 deep": ("deep.json", lambda: b"[" * 100_000 + b"]" * 100_000),
    "a line of 200 MB": ("line.txt", lambda: b"1," * 100_000_000),
}


def memory(long: bool, seed: int = 0) -> list[Tally]:
    """Each of them through the commands that would read it."""
    del seed
    tally = Tally("hostile files under 2 GiB and 60 s")
    with tempfile.TemporaryDirectory() as name:
        for what, (place, make) in HOSTILE.items():
            path = Path(name) / place
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(make())
            source = path.parent if place.startswith("pictures/") else path
            commands = [["record", str(source), "-o", f"{name}/out.mcap", "--fps", "25"]]
            if path.suffix == ".mcap":
                commands += [["query", str(path), "SELECT 1"], ["info", str(path)]]
            for words in commands if long or path.suffix != ".txt" else commands[:1]:
                _try(tally, what, words)
    return [tally]


def _try(tally: Tally, what: str, words: list[str]) -> None:
    tally.tries += 1
    begun = time.monotonic()

    def held() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (_MEMORY, _MEMORY))

    try:
        done = subprocess.run(
            [sys.executable, "-c", _MAIN, *words],
            preexec_fn=held,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
            capture_output=True,
            text=True,
            timeout=_SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        tally.lost += 1
        tally.note(f"{what}: `{words[0]}` took over {_SECONDS:g} s")
        return
    took = time.monotonic() - begun
    if "Traceback" in done.stderr or done.returncode not in (0, 1, 2, 3):
        tally.foreign += 1
        tally.note(f"{what}: `{words[0]}`: exit {done.returncode}: {done.stderr[-300:]}")
    else:
        tally.survived += 1
        if took > _SECONDS / 2:
            tally.note(f"{what}: `{words[0]}` took {took:.0f} s")
