"""``scenetrace correct``."""

from __future__ import annotations

import argparse
import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from recorders.annotated.reader import AnnotatedLog
    from recorders.corrections import Corrections

EXAMPLE = """\
scenetrace correct annotated.mcap -o corrections.jsonl swap 1 2 --at 1.5 --by Jo --why "they crossed here"
scenetrace replay scene.mcap -o corrected.mcap --corrections corrections.jsonl
scenetrace diff annotated.mcap corrected.mcap"""
DESCRIPTION = """\
Write down who a track really is, by whom and why: a call adds a line to FILE, which people can read and sign.
`scenetrace replay --corrections FILE` applies them before anything is reasoned out; the log holds them, so
`verify` replays them. Every correction is held against LOG: whom it names must be there then.

  merge A B           B is A (--at T: from T on); they may not both be seen at once
  split A [NEW]       from --at on A is another, NEW (a free number without)
  swap A B            from --at on A is B and B is A
  rename A NEW        A gets another number
  delete A            A is nobody (--at T: from T on; --until T: before T)
  label A TEXT        what A is called (--at T: from T on)
  same A RECORDING:ID A is a target of another recording
  not-same A B        A and B are two: hindsight may not join them (B may be a part that it joined into A)
  list                what the file holds; takes no --by
  undo N              correction N is taken back; its line stays to be read

Numbers are those after the corrections before: LOG may be the log that was corrected first, or the one of the
last replay."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "correct",
        "say who a track really is, by whom and why",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="the annotated log")
    parser.add_argument(
        "words", nargs="+", metavar="WHAT", help="merge A B, split A ...: see above"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="the corrections: made, or added to",
    )
    parser.add_argument(
        "--at",
        metavar="T",
        help="from when on: seconds, 1:20, 12:03:40, frame:N or RFC 3339",
    )
    parser.add_argument("--until", metavar="T", help="delete: the end, excluded")
    parser.add_argument("--by", metavar="NAME", help="who says so")
    parser.add_argument("--why", metavar="TEXT", help="the reason, for others to judge")
    parser.add_argument(
        "--date", default="", metavar="DATE",
        help="when it was decided, like 2026-01-31; no clock is asked",
    )  # fmt: skip
    common.add_camera(parser)
    parser.add_argument("--json", action="store_true", help="list: as JSON")
    common.add_limits(parser)
    parser.set_defaults(run=run)
    common.take_words_anywhere(parser)


def run(args: argparse.Namespace) -> int:
    """Correct."""
    from recorders.annotated.reader import AnnotatedLog
    from replay.correcting import opened, written

    do, words = args.words[0], args.words[1:]
    if args.output is None:
        raise UsageError("no file: give -o corrections.jsonl; it is made, or added to")
    if do == "list":
        return _list(args)
    _check_words(args, do)
    limits = common.parse_limits(args.limit)
    with AnnotatedLog(args.log, args.camera, limits) as log:
        corrections = opened(args.output, log)
        corrections = (
            _undone(corrections, words, args)
            if do == "undo"
            else _added(corrections, log, do, words, args)
        )
    written(corrections, args.output)
    row = corrections.rows[-1]
    print(common.printable(f"correction {row.correction}: {row.told()}"))
    common.say(
        f"{args.output}: {len(corrections.rows)} in all; replay with --corrections"
        f" {args.output} to apply"
    )
    return Exit.DONE


def _check_words(args: argparse.Namespace, do: str) -> None:
    from difflib import get_close_matches

    from replay.correcting.making import TAKES

    names = [*TAKES, "undo", "list"]
    if do not in names:
        close = get_close_matches(do, names, 1)
        hint = f"did you mean {close[0]}?" if close else f"there are: {', '.join(names)}"
        raise UsageError(f"no correction {do!r}; {hint}")
    for flag, value in (("--by NAME", args.by), ("--why TEXT", args.why)):
        if not (value or "").strip():
            raise UsageError(
                f"{do}: give {flag}: a correction says who made it and for what reason"
            )


def _added(
    corrections: Corrections,
    log: AnnotatedLog,
    do: str,
    words: list[str],
    args: argparse.Namespace,
) -> Corrections:
    from replay.cli.export import log_time
    from replay.correcting import Book, Wish, add
    from replay.correcting.making import TAKES

    def seconds(text: str | None) -> float | None:
        time_ns = log_time(text, log)
        return None if time_ns is None else (time_ns - log.start_ns) / common.NANOS

    kind = next(name for name in TAKES if name == do)
    at, until = seconds(args.at), seconds(args.until)
    wish = Wish(kind, words, args.by.strip(), args.why.strip(), at, until, args.date)
    return add(Book.of(log), corrections, wish)


def _undone(
    corrections: Corrections, words: list[str], args: argparse.Namespace
) -> Corrections:
    from replay.correcting import take_back

    if len(words) != 1 or not re.fullmatch(r"\d{1,6}", words[0]):
        raise UsageError("undo takes the number of a correction; `list` shows them")
    return take_back(
        corrections, int(words[0]), args.by.strip(), args.why.strip(), args.date
    )


def _list(args: argparse.Namespace) -> int:
    from msgspec import to_builtins

    from recorders.corrections import read_corrections

    found = read_corrections(args.output)
    undone = found.undone
    if args.json:
        print(
            json.dumps([to_builtins(r) for r in found.rows], indent=1, ensure_ascii=False)
        )
        return Exit.DONE
    for row in found.rows:
        back = undone.get(row.correction)
        gone = "" if back is None else f" (taken back by correction {back.correction})"
        date = f", {row.date}" if row.date else ""
        line = f"{row.correction:>3}  {row.told()}{gone}: {row.why} ({row.by}{date})"
        print(common.printable(line))
    common.say(f"{args.output}: sha256 {found.digest}")
    return Exit.DONE
