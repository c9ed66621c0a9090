"""``scenetrace cut``: a piece of a log that stands alone."""

from __future__ import annotations

import argparse
import re
from decimal import Decimal
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import SceneTraceError, UsageError
from replay.cli import common
from replay.cli.exit_codes import Exit
from replay.plurals import count_of

if TYPE_CHECKING:
    from recorders.limits import Limits
    from recorders.pieces import PieceReport

EXAMPLE = """\
scenetrace cut annotated.mcap --from 2 --to 4 -o piece.mcap
scenetrace cut scene.mcap --from frame:10 --to frame:20 --topics '/camera/*' -o piece.mcap"""
DESCRIPTION = """\
Write a span of a log that stands alone. With it come regions, calibrations, fixed transforms and
latched topics as they were said last before, and the packets of a video since its last key frame,
with their own times. A cut of an annotated log verifies as the whole does (`verify --scene`)."""


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands, "cut", "a span of a log that stands alone", DESCRIPTION, EXAMPLE
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="any MCAP log")
    common.add_span(parser)
    add_topics(parser)
    parser.add_argument(
        "--camera", metavar="NAME", help="whose frames --from and --to count"
    )
    add_output(parser)
    parser.set_defaults(run=run)


def add_topics(parser: argparse.ArgumentParser) -> None:
    """``--topics`` and ``--exclude``."""
    parser.add_argument(
        "--topics", action="append", metavar="PATTERN",
        help="topics to keep, as /camera/*; several with commas, or repeated; default all",
    )  # fmt: skip
    parser.add_argument(
        "--exclude",
        action="append",
        default=[],
        metavar="PATTERN",
        help="topics to leave out",
    )


def add_output(parser: argparse.ArgumentParser) -> None:
    """``-o``, ``--limit`` and ``--force``."""
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="the new log"
    )
    common.add_limits(parser)
    parser.add_argument("--force", action="store_true", help="overwrite an existing output")


def run(args: argparse.Namespace) -> int:
    """Cut."""
    from recorders.pieces import Span, cut

    limits = common.parse_limits(args.limit)
    first = span_time(args.start, args.log, args.camera, limits)
    end = span_time(args.end, args.log, args.camera, limits)
    if first is not None and end is not None and end <= first:
        raise UsageError(f"--from {args.start} --to {args.end}: an empty span")
    span = Span(first, end, patterns(args.topics), patterns(args.exclude) or ())
    return show(
        args.output, cut(args.log, args.output, span, force=args.force, limits=limits)
    )


def patterns(words: list[str] | None) -> list[str] | None:
    """The patterns of ``--topics A,B --topics C``."""
    if words is None:
        return None
    return [part for word in words for part in word.split(",") if part]


def show(out: Path, report: PieceReport) -> int:
    """Say what was written."""
    carried = f", {report.carried} of them from before the span" if report.carried else ""
    common.say(f"{out}: {count_of(report.messages, 'message')}{carried}")
    for note in report.notes:
        common.say(f"scenetrace: {note}")
    return Exit.DONE


def span_time(
    text: str | None, path: Path, camera: str | None, limits: Limits
) -> int | None:
    """A time as log time in ns: of a log of ours from its first frame on, of another from its
    first message on.

    Raises:
        UsageError: it is no time, or there is no such frame.
    """
    from recorders.annotated.frames import annotated_cameras
    from recorders.annotated.reader import AnnotatedLog
    from recorders.log import LogReader
    from recorders.scene import SceneLog
    from replay.cli.export import log_time

    if text is None:
        return None
    with LogReader(path, limits) as log:
        start_ns, annotated = log.start_ns or 0, annotated_cameras(log)
    if annotated:
        with AnnotatedLog(path, camera, limits) as opened:
            return log_time(text, opened)
    try:
        with SceneLog(path, camera, limits) as scene:
            return common.parse_time(text, scene)
    except UsageError:
        raise
    except SceneTraceError:
        if text.startswith("frame:"):
            raise UsageError(
                f"{text}: {path} has no frames that are counted; give seconds or RFC 3339"
            ) from None
    if re.fullmatch(r"\d{1,12}(\.\d*)?", text):
        return start_ns + round(Decimal(text) * common.NANOS)
    return common.parse_clock(text, lambda: start_ns)
