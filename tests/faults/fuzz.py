"""Inputs that were changed at random: read, or refused with an error of ours; never anything
else.
"""

from __future__ import annotations

import os
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from math import inf
from pathlib import Path
from random import Random
from time import process_time

import cv2

from recorders.errors import SceneTraceError
from tests.faults.guided import guided, there_is_guidance
from tests.faults.small import memory
from tests.faults.tally import Tally

Target = Callable[[bytes, Path], object]
_MOST_KEPT = 2000
_TOKENS = (
    b"0", b"-1", b"1e999", b"nan", b"inf", b"18446744073709551616", b"-9223372036854775809",
    b"\x00", b"\xff\xfe", b"{", b"}", b"[", b"]", b'"', b",", b";", b"\n", b"\r\n", b"\\", b"'",
    b"<", b"/>", b"<!DOCTYPE", b"&", b"%s", b"../", b"null", b"true", b"\xc2\xb2",
    b"9" * 4400, b"\xf0\x9f\x98\x80", b"--",
)  # fmt: skip


def changed(data: bytes, rng: Random) -> bytes:
    """A few changes: bytes, tokens, pieces repeated, moved or lost, the end cut off."""
    out = bytearray(data)
    for _ in range(rng.randint(1, 6)):
        place = rng.randrange(len(out) + 1)
        kind = rng.randrange(7)
        if kind == 0 and out:
            out[place % len(out)] = rng.randrange(256)
        elif kind == 1:
            out[place:place] = rng.choice(_TOKENS)
        elif kind == 2:
            del out[place : place + rng.randint(1, 40)]
        elif kind == 3:
            piece = out[place : place + rng.randint(1, 200)]
            other = rng.randrange(len(out) + 1)
            out[other:other] = piece * rng.randint(1, 4)
        elif kind == 4:
            end = place + rng.randint(1, 8)
            out[place:end] = rng.choice(_TOKENS)
        elif kind == 5:
            del out[place:]
        elif out:
            bit = rng.randrange(8 * len(out))
            out[bit // 8] ^= 1 << bit % 8
    return bytes(out)


def all_targets(folder: Path) -> dict[str, tuple[Sequence[bytes], Target]]:
    """Each target: sound inputs, and what reads one; libraries keep quiet."""
    from tests.faults.more_targets import more_targets
    from tests.faults.targets import targets

    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    return {**targets(folder), **more_targets(folder)}


def fuzz(
    long: bool,
    seed: int = 0,
    tries: int | None = None,
    seconds: float | None = None,
    only: str = "",
) -> Iterator[Tally]:
    """Every target (whose name begins so), with its seeds changed: so many inputs, or for so
    long.
    """
    with tempfile.TemporaryDirectory(dir=memory()) as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        count = tries or (100_000 if long else 40)
        for kind, (seeds, target) in all_targets(folder).items():
            if not kind.startswith(only):
                continue
            if long and there_is_guidance():
                yield guided(kind, count, seed, seconds or inf)
            else:
                until = inf if seconds is None else process_time() + seconds
                yield _target(kind, seeds, target, folder, count, seed, until)


def _target(
    kind: str,
    seeds: Sequence[bytes],
    target: Target,
    folder: Path,
    count: int,
    seed: int,
    until: float,
) -> Tally:
    """Guided by where an input was refused: one that comes to a new place is changed further."""
    tally = Tally(f"fuzz: {kind}")
    rng = Random(f"{kind} {seed}")
    pool, places = list(seeds), set()
    for number in range(count):
        if number % 64 == 0 and process_time() > until:
            break
        fresh = rng.random() < 0.5  # what came to a new place lately, or any of all
        data = rng.choice(pool[-20:] if fresh else pool)
        data = changed(data, rng) if number >= len(seeds) else seeds[number]
        error = tried(tally, target, data, folder, f"{seed}-{number}")
        if error is not None:
            place = _place(error)
            if place not in places and len(pool) < _MOST_KEPT:
                places.add(place)
                pool.append(data)
    return tally


def tried(
    tally: Tally, target: Target, data: bytes, folder: Path, name: str
) -> SceneTraceError | None:
    """Count what became of one input; the error by which it was refused, if it was."""
    tally.tries += 1
    try:
        target(data, folder)
    except SceneTraceError as error:
        tally.survived += 1
        return error
    except (Exception, RecursionError) as error:
        tally.foreign += 1
        tally.note(f"{tally.kind}: {type(error).__name__}: {error}: {data[:300]!r}")
        keep = os.environ.get("SCENETRACE_CRASHES")
        if keep and tally.foreign <= 20:
            kind = tally.kind.removeprefix("fuzz: ").replace("/", "-")
            (Path(keep) / f"{kind}-{name}").write_bytes(data)
    else:
        tally.survived += 1
    return None


def _place(error: BaseException) -> tuple[tuple[str, int], ...]:
    """The lines through which an error came."""
    found = []
    trace = error.__traceback__
    while trace is not None:
        found.append((trace.tb_frame.f_code.co_filename, trace.tb_lineno))
        trace = trace.tb_next
    return tuple(found)
