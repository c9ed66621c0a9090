"""``scenetrace recover``."""

from __future__ import annotations

import argparse
from pathlib import Path

from replay.cli import common
from replay.cli.exit_codes import Exit


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "recover",
        "what is whole of a damaged log into a new one",
        "Copy everything that is whole of a cut, unfinished (.part) or damaged log into a"
        " new one: up to the last\nwhole chunk, and past damaged chunks where the file goes"
        " on. Says what was lost; exit code 3 if anything.",
        "scenetrace recover scene.mcap.part -o scene.mcap",
    )
    parser.add_argument(
        "log",
        type=Path,
        metavar="LOG",
        help="a damaged log, or the part file of a stopped recording",
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="FILE", help="the new log"
    )
    common.add_limits(parser)
    parser.add_argument("--force", action="store_true", help="overwrite an existing output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Recover."""
    from recorders.log.recovery import recover

    report = recover(args.log, args.output, args.force, common.parse_limits(args.limit))
    expected = "" if report.messages_expected is None else f" of {report.messages_expected}"
    print(
        f"{args.output}: {report.messages}{expected} messages on {report.channels}"
        f" channels, {report.metadata} metadata records, {report.attachments} attachments"
    )
    for note in report.notes:
        common.say(f"scenetrace: at byte {note.offset} ({note.record}): {note.reason}")
    for loss in report.losses:
        common.say(f"lost: at byte {loss.offset} ({loss.record}): {loss.reason}")
    return Exit.LEFT_OUT if report.losses else Exit.DONE
