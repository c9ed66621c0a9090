"""Fuzzing that is guided by which branches an input reaches, where atheris is installed:
`python -m tests.faults.guided TARGET COUNT SEED SECONDS`, one tally as JSON on stdout.

A process for each target, as libFuzzer below it never returns.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import warnings
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from random import Random
from time import process_time
from typing import Any

import msgspec

from tests.faults.tally import Tally

_OURS = ["recorders", "reasoning", "replay"]
_MEMORY = "/dev/shm" if Path("/dev/shm").is_dir() else None
_TOLD = b"tally "


def there_is_guidance() -> bool:
    """Whether atheris is installed."""
    return find_spec("atheris") is not None


def guided(kind: str, count: int, seed: int, seconds: float) -> Tally:
    """What became of so many inputs of one target, or of so many processor seconds."""
    done = subprocess.run(
        [sys.executable, "-m", __name__, kind, str(count), str(seed), str(seconds)],
        capture_output=True,
        check=False,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
    )
    told = [line for line in done.stdout.splitlines() if line.startswith(_TOLD)]
    if not told:  # the interpreter itself died
        died = Tally(f"fuzz: {kind}", tries=1, foreign=1)
        died.note(
            f"{died.kind}: exit {done.returncode}: {done.stderr[-300:].decode(errors='replace')}"
        )
        return died
    return msgspec.json.decode(told[-1].removeprefix(_TOLD), type=Tally)


def main(kind: str, count: int, seed: int, seconds: float) -> None:
    """Never returns."""
    atheris: Any = import_module("atheris")
    warnings.simplefilter("ignore")
    with (
        tempfile.TemporaryDirectory(dir=_MEMORY) as name,
        tempfile.TemporaryDirectory(dir=_MEMORY) as corpus,
    ):
        # All of ours that is loaded, here or by making the inputs, is loaded with its branches counted.
        with atheris.instrument_imports(include=_OURS):
            from tests.faults.fuzz import all_targets, changed, tried

            seeds, target = all_targets(Path(name))[kind]
        until = process_time() + seconds
        for number, data in enumerate(seeds):
            (Path(corpus) / str(number)).write_bytes(data)
        tally = Tally(f"fuzz: {kind}")

        def one(data: bytes) -> None:
            tried(tally, target, data, Path(name), f"{seed}-{tally.tries}")
            if tally.tries >= count or (tally.tries % 64 == 0 and process_time() > until):
                sys.stdout.buffer.write(b"\n" + _TOLD + msgspec.json.encode(tally) + b"\n")
                sys.stdout.flush()
                raise KeyboardInterrupt  # leaves libFuzzer's loop

        def mutated(data: bytes, most: int, number: int) -> bytes:
            rng = Random(number)
            if rng.random() < 0.5:
                return bytes(atheris.Mutate(data, most))
            return changed(data, rng)[:most]

        options = [
            f"-seed={seed + 1}",
            "-max_len=100000",
            "-rss_limit_mb=0",
            "-timeout=600",
        ]
        atheris.Setup([kind, *options, corpus], one, custom_mutator=mutated)
        atheris.Fuzz()


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4]))
