"""The table of docs/reliability.md: `python tests/faults [KIND...] [--long] [--seed N]`.

Kinds: flips, cuts, io, kills, fuzz, hostile, length. Each is a row of the table on stdout, what it is made
of on stderr. Short by default, as the tests run them; `--long`
takes every byte, every call, 86 kills of each command and 10^5 inputs of each target (hours),
guided by branches where atheris is installed.
`--kept FILE` keeps what was counted, so that a long run may be made in pieces: what has a seed
adds up, other rows are replaced, and the table is of all that was kept.
Exit code 1 where something was lost, silent or foreign.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import msgspec

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.faults.damage import cuts, flips
from tests.faults.fuzz import fuzz
from tests.faults.hostile import hostile
from tests.faults.io_faults import COMMANDS, io_faults
from tests.faults.kills import kills
from tests.faults.length import length
from tests.faults.tally import HEAD, Tally, added, summed

KINDS: dict[str, Callable[..., Iterable[Tally]]] = {
    "flips": flips,
    "cuts": cuts,
    "io": io_faults,
    "kills": kills,
    "fuzz": fuzz,
    "hostile": hostile,
    "length": length,
}
NAMES = {
    "flips": "bytes flipped, three logs (no compression, LZ4, Zstandard)",
    "cuts": "lengths cut, three logs",
    "io": f"calls that fail, {len(COMMANDS)} commands",
    "kills": f"kill -9, {len(COMMANDS) + 1} commands",
    "fuzz": "inputs changed at random",
    "hostile": "hostile files under 2 GiB and 60 s",
    "length": "recordings of 1, 6 and 24 h: under 500 MB, time as their length",
}


SEEDED = ("fuzz", "kills")

Kept = dict[str, dict[str, Tally]]
"""By kind and row."""


def main() -> int:
    """Run what was asked for, print the table and what went wrong."""
    parser = argparse.ArgumentParser(prog="tests/faults", description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    parser.add_argument("--long", action="store_true", help="all of it, for hours")
    parser.add_argument("--seed", type=int, default=0, help="other random places")
    parser.add_argument(
        "--tries", type=int, help="inputs of each target, kills of each command"
    )
    parser.add_argument("--seconds", type=float, help="so long for each target of fuzz")
    parser.add_argument(
        "--target",
        default="",
        help="targets of fuzz, commands of io, sorts of hostile files whose name begins so",
    )
    parser.add_argument("--kept", type=Path, metavar="FILE", help="what was counted so far")
    args = parser.parse_args()
    unknown = [kind for kind in args.kinds if kind not in KINDS]
    if unknown:
        parser.error(f"no kind {unknown[0]!r}; there are {', '.join(KINDS)}")
    kept: Kept = {}
    if args.kept is not None and args.kept.exists():
        kept = msgspec.json.decode(args.kept.read_bytes(), type=Kept)
    wrong = []
    for kind in args.kinds or KINDS:
        more: dict[str, Any] = {"tries": args.tries} if kind in SEEDED else {}
        if kind == "fuzz":
            more["seconds"] = args.seconds
        if kind in ("fuzz", "io", "hostile"):
            more["only"] = args.target
        rows = kept.setdefault(kind, {})
        for tally in KINDS[kind](args.long, args.seed, **more):
            rows[tally.kind] = (
                added(rows.get(tally.kind), tally) if kind in SEEDED else tally
            )
            print(tally.row(), file=sys.stderr, flush=True)
            wrong += tally.notes if not tally.clean else []
            if args.kept is not None:
                fresh = args.kept.with_name(f"{args.kept.name}.new")
                fresh.write_bytes(msgspec.json.encode(kept))
                fresh.replace(args.kept)
    print(HEAD)
    for kind in KINDS:
        if kind in kept:
            print(summed(NAMES[kind], list(kept[kind].values())).row())
    for note in wrong:
        print(note[:400], file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
