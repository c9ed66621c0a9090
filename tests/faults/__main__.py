"""The table of docs/reliability.md: `python tests/faults [KIND...] [--long] [--seed N]`.

Kinds: flips, cuts, io, kills, fuzz, memory. Short by default, as the tests run them; `--long`
takes every byte, every call, 80 kills of each command and 10^5 inputs of each target (hours).
Exit code 1 where something was lost, silent or foreign.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.faults.damage import cuts, flips
from tests.faults.fuzz import fuzz
from tests.faults.io_faults import io_faults
from tests.faults.kills import kills
from tests.faults.memory import memory
from tests.faults.tally import HEAD, Tally

KINDS: dict[str, Callable[..., list[Tally]]] = {
    "flips": flips,
    "cuts": cuts,
    "io": io_faults,
    "kills": kills,
    "fuzz": fuzz,
    "memory": memory,
}


def main() -> int:
    """Run what was asked for, print the table and what went wrong."""
    parser = argparse.ArgumentParser(prog="tests/faults", description=__doc__)
    parser.add_argument("kinds", nargs="*", metavar="KIND")
    parser.add_argument("--long", action="store_true", help="all of it, for hours")
    parser.add_argument("--seed", type=int, default=0, help="other random places")
    parser.add_argument(
        "--tries", type=int, help="inputs of each target, kills of each command"
    )
    args = parser.parse_args()
    unknown = [kind for kind in args.kinds if kind not in KINDS]
    if unknown:
        parser.error(f"no kind {unknown[0]!r}; there are {', '.join(KINDS)}")
    print(HEAD, flush=True)
    wrong = []
    for kind in args.kinds or KINDS:
        more = {"tries": args.tries} if args.tries and kind in ("fuzz", "kills") else {}
        for tally in KINDS[kind](args.long, args.seed, **more):
            print(tally.row(), flush=True)
            wrong += tally.notes if not tally.clean else []
    for note in wrong:
        print(note[:400], file=sys.stderr)
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
