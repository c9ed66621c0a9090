"""`scenetrace find`: targets by colours, or like somebody, ranked, with thumbnails."""

from __future__ import annotations

import argparse
import sys
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli.common import (
    Commands,
    add_limits,
    command,
    parse_limits,
    say,
    take_words_anywhere,
)
from replay.cli.drawing import add_clock, start_of, without_cases
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from reasoning.questions import Case
    from reasoning.questions.finding import Wanted

EXAMPLE = """\
scenetrace find annotated.mcap --colour red
scenetrace find annotated.mcap --upper red --lower black -o found/     # found/index.html shows them
scenetrace find case.duckdb --colour "dark blue" --lower --most 50"""
DESCRIPTION = """\
Find targets by the colours of upper and lower body, or by likeness to a target (--like 7, over several recordings
--like monday:7) or to somebody cut out of a picture (--like somebody.png), best first.

Colours: black, grey, white, red, brown, orange, beige, green, yellow, blue, purple, pink, and shades such as "dark
blue". They are counted in a few pictures of each target in which nobody covers it; an index holds them. Of an
animal both halves count. Alike is not the same: light changes colours, and many people wear black."""


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands, "find", "targets by colours, or like somebody", DESCRIPTION, EXAMPLE
    )
    parser.add_argument(
        "inputs",
        nargs="+",
        type=Path,
        metavar="LOG|CASE",
        help="annotated logs, indexes, or a case.toml",
    )
    parser.add_argument(
        "--colour", "--color", action="append", default=[], metavar="C", dest="colours",
        help="of this colour, anywhere or where --upper or --lower says; may be repeated",
    )  # fmt: skip
    for half in ("upper", "lower"):
        parser.add_argument(
            f"--{half}", nargs="?", const=True, metavar="C",
            help=f"the {half} body is of colour C (or of that of --colour)",
        )  # fmt: skip
    parser.add_argument(
        "--like", metavar="WHO", help="like target ID, RECORDING:ID, or who is on a picture (.png, .jpg)"
    )  # fmt: skip
    parser.add_argument(
        "--model", type=Path, metavar="FILE",
        help="with --like: an ONNX model that tells people again (ReID), over the best by colours",
    )  # fmt: skip
    parser.add_argument("--recording", metavar="NAME", help="only in this recording")
    parser.add_argument(
        "--most", type=int, default=20, metavar="N", help="how many (default 20)"
    )
    parser.add_argument(
        "--least", type=float, default=0.2, metavar="P", help="how like at least, 0 to 1 (default 0.2)"
    )  # fmt: skip
    parser.add_argument(
        "--proposals", action="store_true",
        help="with --like over several recordings: print what to accept with `scenetrace correct`",
    )  # fmt: skip
    parser.add_argument(
        "-o", "--output", type=Path, metavar="DIR", help="thumbnails and index.html there"
    )
    parser.add_argument(
        "--force", action="store_true", help="write into an older DIR of its own"
    )
    parser.add_argument(
        "--format", choices=("table", "json", "csv"), default="table", help="default: table"
    )
    parser.add_argument("--json", action="store_true", help="the same as --format json")
    add_clock(parser)
    add_limits(parser)
    parser.set_defaults(run=run)
    take_words_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Find."""
    from reasoning.questions import Answer, Case
    from reasoning.questions.answer_text import write
    from reasoning.questions.clocks import starts, with_clocks
    from reasoning.questions.finding import find
    from reasoning.questions.literals import only
    from reasoning.questions.name_checks import check_recording
    from replay.report.contact_sheet import check_sheet, write_sheet
    from replay.report.likeness import ranked_by_model

    _check(args)
    if args.output is not None:
        check_sheet(args.output, force=args.force)
    start = start_of(args, args.inputs)
    limits = parse_limits(args.limit)
    inputs = without_cases(args.inputs)
    with Case(inputs, looks=True, start_ns=start, log_limits=limits) as case:
        check_recording(case, args.recording)
        wanted = _wanted(case, args)
        begun = starts(case)
        most = args.most if args.model is None else max(200, args.most)
        answer = find(
            case, wanted, recordings=only(args.recording), most=most, least=args.least
        )
        rows = list(answer.rows)
        if args.model is not None:
            rows = ranked_by_model(
                case, answer.columns, rows, args.like, wanted, args.model
            )
            rows = rows[: args.most]
        if not rows and not case.rows("SELECT 1 FROM looks LIMIT 1"):
            say("nobody's colours are known: the recordings hold no pictures of them")
        told = with_clocks(
            Answer(answer.columns, answer.types, iter(rows)), begun, args.timezone
        )
        write(told, "json" if args.json else args.format, sys.stdout)
        left_out = []
        if args.output is not None:
            left_out = write_sheet(
                case, answer.columns, rows, args.output, force=args.force
            )
            say(
                f"{args.output}/index.html: {len(rows) - len(left_out)} of {len(rows)} shown"
            )
            for line in left_out:
                say(f"left out {line}")
    if args.proposals:
        _propose(answer.columns, rows, args.like)
    return Exit.LEFT_OUT if left_out else Exit.DONE


def _check(args: argparse.Namespace) -> None:
    if not 0 <= args.least <= 1:
        raise UsageError(f"--least {args.least:g}: must be 0 to 1")
    if not 1 <= args.most <= 10_000:
        raise UsageError(f"--most {args.most}: must be 1 to 10000")
    for half in ("upper", "lower"):
        if getattr(args, half) is True and not args.colours:
            raise UsageError(
                f"--{half}: of which colour? --{half} red, or --colour red --{half}"
            )
    for option in ("model", "proposals"):
        if getattr(args, option) and args.like is None:
            raise UsageError(f"--{option} goes with --like")


def _wanted(case: Case, args: argparse.Namespace) -> Wanted:
    from reasoning.questions.finding import Wanted, likeness_to
    from reasoning.questions.literals import only

    wanted = Wanted()
    if args.like is not None:
        if Path(args.like).suffix.lower() in (".png", ".jpg", ".jpeg"):
            from replay.report.likeness import shares_of_picture

            wanted = Wanted(like=shares_of_picture(Path(args.like)))
        else:
            wanted = likeness_to(case, args.like, only(args.recording))
    colours = tuple(args.colours)
    halves = {h: getattr(args, h) for h in ("upper", "lower")}
    named = {
        h: colours if v is True else (v,) if v is not None else ()
        for h, v in halves.items()
    }
    elsewhere = () if True in halves.values() else colours
    return replace(wanted, anywhere=elsewhere, upper=named["upper"], lower=named["lower"])


def _propose(columns: list[str], rows: list[tuple[object, ...]], like: str) -> None:
    """Commands that accept what is found in other recordings."""
    at = {name: columns.index(name) for name in ("recording", "track", "likeness")}
    own, _, number = like.rpartition(":")
    for row in rows:
        recording, track, likeness = (
            row[at[n]] for n in ("recording", "track", "likeness")
        )
        if recording != own:
            print(
                f"scenetrace correct {own or 'LOG'}.mcap -o corrections.jsonl same {number}"
                f' {recording}:{track} --by NAME --why "alike, {likeness}"'
            )
