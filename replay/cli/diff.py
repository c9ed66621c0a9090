"""``scenetrace diff``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import OutputExistsError, UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from replay.compare import CompareOptions, Comparison

_SHOWN = 10


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "diff",
        "what happens in one annotated log and not in another",
        "Compare two annotated logs by what they say happened: events by kind, subjects and"
        " time; tracks by where\nthey are, so that other numbers are no difference;"
        " relations, groups and encounters by their\nintervals. The ten that matter most are shown:"
        " who is there and who is whom before what they do, values last.\nExit code 4 where they"
        " differ. The same scene, another configuration, tracker or corrections: what changed.",
        "scenetrace diff before.mcap after.mcap\nscenetrace diff before.mcap after.mcap"
        " --tolerance 2 --html diff.html",
    )
    parser.add_argument("a", type=Path, metavar="A", help="an annotated log")
    parser.add_argument(
        "b", type=Path, metavar="B", help="the one that is compared with it"
    )
    add_options(parser)
    parser.add_argument(
        "--all",
        action="store_true",
        help=f"print every difference, in order of time, not the {_SHOWN} that matter most",
    )
    parser.add_argument("--json", action="store_true", help="everything as JSON")
    parser.add_argument(
        "--html",
        type=Path,
        metavar="OUT",
        help="a page with pictures of the first differences",
    )
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="FILE",
        help="where the pictures are, if in neither A nor B",
    )
    parser.add_argument("--force", action="store_true", help="overwrite an existing page")
    common.add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Compare."""
    from replay.compare import compare

    options = options_of(args)
    if args.html is not None and args.html.exists() and not args.force:
        raise OutputExistsError(args.html)
    found = compare(args.a, args.b, options, common.parse_limits(args.limit))
    if args.html is not None:
        write_html(found, args.html, scene=args.scene, force=args.force)
    return show(found, args.json, args.all)


def write_html(found: Comparison, out: Path, *, scene: Path | None, force: bool) -> None:
    """The page, and what is in it."""
    from replay.compare.page import write_page

    write_page(found, out, scene=scene, force=force)
    common.say(
        f"{out}: "
        + (
            "the first differences, side by side"
            if found.differences
            else "nothing differs"
        )
    )


def add_options(parser: argparse.ArgumentParser) -> None:
    """What `diff` and `replay --against` share."""
    parser.add_argument(
        "--tolerance",
        type=float,
        default=0.0,
        metavar="PX",
        help="how far a box may be off; default 0",
    )
    parser.add_argument(
        "--time-tolerance",
        type=float,
        default=1.0,
        metavar="S",
        help="moved, not another event; default 1",
    )


def options_of(args: argparse.Namespace) -> CompareOptions:
    """The options given.

    Raises:
        UsageError: a tolerance is negative or no number.
    """
    from replay.compare import CompareOptions

    for name, value in (
        ("--tolerance", args.tolerance),
        ("--time-tolerance", args.time_tolerance),
    ):
        if not 0 <= value < float("inf"):
            raise UsageError(f"{name} {value}: must be at least 0")
    return CompareOptions(args.tolerance, args.time_tolerance, encounters=True)


def show(found: Comparison, as_json: bool = False, everything: bool = False) -> int:
    """Print a comparison; the exit code."""
    if as_json:
        print(json.dumps(found.as_plain(), indent=2))
    else:
        from replay.compare.weight import weightiest

        most = None if everything else weightiest(found.differences, _SHOWN)
        for line in found.lines(most):
            print(common.printable(line))
        if not everything and len(found.differences) > _SHOWN:
            common.say(
                "the weightiest first; --all prints every difference, in order of time"
            )
    return Exit.DONE if found.equal else Exit.DIFFERS
