"""Inputs that were changed at random: read, or refused with an error of ours; never anything
else.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path
from random import Random

from recorders.errors import SceneTraceError
from tests.faults.tally import Tally

Target = Callable[[bytes, Path], object]
_TOKENS = (
    b"0", b"-1", b"1e999", b"nan", b"inf", b"18446744073709551616", b"-9223372036854775809",
    b"\x00", b"\xff\xfe", b"{", b"}", b"[", b"]", b'"', b",", b";", b"\n", b"\r\n", b"\\", b"'",
    b"<", b"/>", b"<!DOCTYPE", b"&", b"%s", b"../", b"null", b"true", b"\xf0\x9f\x98\x80", b"--",
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


def fuzz(long: bool, seed: int = 0, tries: int | None = None) -> list[Tally]:
    """Every target, with its seeds changed."""
    from tests.faults.targets import targets

    tallies = []
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        folder = Path(name)
        for kind, (seeds, target) in targets(folder).items():
            count = tries or (100_000 if long else 60)
            tallies.append(_target(kind, seeds, target, folder, count, seed))
    return tallies


def _target(
    kind: str, seeds: Sequence[bytes], target: Target, folder: Path, count: int, seed: int
) -> Tally:
    tally = Tally(f"fuzz: {kind}")
    rng = Random(f"{kind} {seed}")
    for number in range(count):
        data = changed(rng.choice(seeds), rng) if number >= len(seeds) else seeds[number]
        tally.tries += 1
        try:
            target(data, folder)
        except SceneTraceError:
            tally.survived += 1
        except (Exception, RecursionError) as error:
            tally.foreign += 1
            tally.note(f"{tally.kind}: {type(error).__name__}: {error}: {data[:300]!r}")
        else:
            tally.survived += 1
    return tally
