"""``scenetrace sort``: a log in order of time."""

from __future__ import annotations

import argparse
from pathlib import Path

from replay.cli import common
from replay.cli.cut import add_output, show

EXAMPLE = """\
scenetrace sort scene.mcap -o sorted.mcap"""
DESCRIPTION = """\
Write a log again in order of log time, in chunks with index and checksums, for readers that need
that. Nothing else changes; digests stay true."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands, "sort", "a log again in order of time", DESCRIPTION, EXAMPLE
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="any MCAP log")
    add_output(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Sort."""
    from recorders.pieces import merge

    limits = common.parse_limits(args.limit)
    return show(
        args.output, merge([args.log], args.output, force=args.force, limits=limits)
    )
