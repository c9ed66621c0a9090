"""``scenetrace diff``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli import common

if TYPE_CHECKING:
    from replay.compare import Comparison

DIFFERS = 4
_SHOWN = 40


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    p = common.command(
        commands,
        "diff",
        "what happens in one annotated log and not in another",
        "Compare two annotated logs by what they say happened: events by kind, subjects and time; tracks by where\n"
        "they are, so that other numbers are no difference; relations and groups by their intervals. Exit code 4\n"
        "where they differ. The same scene, another configuration or tracker: what changed in what happened.",
        "scenetrace diff before.mcap after.mcap\nscenetrace diff before.mcap after.mcap --tolerance 2 --json",
    )
    p.add_argument("a", type=Path, metavar="A", help="an annotated log")
    p.add_argument("b", type=Path, metavar="B", help="the one that is compared with it")
    p.add_argument("--tolerance", type=float, default=0.0, metavar="PX", help="how far a box may be off; default 0")
    p.add_argument("--time-tolerance", type=float, default=1.0, metavar="S", help="moved, not another event; default 1")
    p.add_argument("--all", action="store_true", help=f"print every difference, not the first {_SHOWN}")
    p.add_argument("--json", action="store_true", help="everything as JSON")
    p.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare."""
    from replay.compare import CompareOptions, compare

    if not args.tolerance >= 0 or not args.time_tolerance >= 0:
        raise UsageError("--tolerance and --time-tolerance must be at least 0")
    found = compare(args.a, args.b, CompareOptions(args.tolerance, args.time_tolerance))
    if args.json:
        print(json.dumps(found.as_plain(), indent=2))
    else:
        show(found, None if args.all else _SHOWN)
    return 0 if found.equal else DIFFERS


def show(found: Comparison, limit: int | None = None) -> None:
    """Print a comparison for a person."""
    if found.identical:
        print(f"identical: {found.frames} frames")
        return
    if found.equal:
        print(f"equal in meaning: {found.frames} frames; ids or values within the tolerance differ")
        return
    for d in found.differences[:limit]:
        print(f"frame {d.frame:>6} {d.t:>9.2f} s  {d.what:<8} {d.change:<8} {d.text}")
    if limit is not None and len(found.differences) > limit:
        print(f"... and {len(found.differences) - limit} more (--all shows them)")
    counts = ", ".join(f"{n} {what}" for what, n in found.counts().items())
    print(f"{len(found.differences)} differences over {found.frames} frames: {counts}")
