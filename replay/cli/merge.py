"""``scenetrace merge``: several logs as one."""

from __future__ import annotations

import argparse
from pathlib import Path

from replay.cli import common
from replay.cli.cut import add_output, show

EXAMPLE = """\
scenetrace merge monday.mcap tuesday.mcap -o both.mcap"""
DESCRIPTION = """\
Write several logs as one, in order of log time; at one time, in the order given. Attachments and
metadata of all are kept. The digests of annotated logs are taken out, and that is said."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands, "merge", "several logs as one, in order of time", DESCRIPTION, EXAMPLE
    )
    parser.add_argument("logs", type=Path, nargs="+", metavar="LOG", help="MCAP logs")
    add_output(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Merge."""
    from recorders.pieces import merge

    limits = common.parse_limits(args.limit)
    return show(args.output, merge(args.logs, args.output, force=args.force, limits=limits))
