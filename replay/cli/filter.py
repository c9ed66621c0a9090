"""``scenetrace filter``: some topics of a log."""

from __future__ import annotations

import argparse
from pathlib import Path

from recorders.errors import UsageError
from replay.cli import common
from replay.cli.cut import add_output, add_topics, patterns, show

EXAMPLE = """\
scenetrace filter annotated.mcap --topics '/camera/tracks,/camera/events' -o tracks.mcap
scenetrace filter annotated.mcap --exclude '/camera/image' -o small.mcap"""
DESCRIPTION = """\
Write some topics of a log, byte for byte. `cut` takes a span of time as well."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands, "filter", "some topics of a log", DESCRIPTION, EXAMPLE
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="any MCAP log")
    add_topics(parser)
    add_output(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Filter."""
    from recorders.pieces import Span, cut

    if not args.topics and not args.exclude:
        raise UsageError("nothing to filter by: give --topics PATTERN or --exclude PATTERN")
    span = Span(None, None, patterns(args.topics), patterns(args.exclude) or ())
    limits = common.parse_limits(args.limit)
    return show(
        args.output, cut(args.log, args.output, span, force=args.force, limits=limits)
    )
