"""``--zone``, ``--line`` and ``--timezone``: what is drawn after the fact, and whose clock is told."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from reasoning.questions.drawn import Drawn


def add_drawing(parser: argparse.ArgumentParser) -> None:
    """Declare ``--zone`` and ``--line``."""
    group = parser.add_argument_group("drawn after the fact, in pixels of the recording")
    group.add_argument(
        "--zone", action="append", default=[], metavar="NAME=X,Y,X,Y,...", dest="zones",
        help="a zone by its corners (two: an upright rectangle); works in every question; may be repeated",
    )  # fmt: skip
    group.add_argument(
        "--line", action="append", default=[], metavar="NAME=X1,Y1,X2,Y2", dest="lines",
        help="a line, for `crossed` and `count`; may be repeated",
    )  # fmt: skip


def add_clock(parser: argparse._ActionsContainer) -> None:
    """Declare ``--timezone`` and ``--start``."""
    parser.add_argument(
        "--timezone", default="UTC", metavar="ZONE",
        help="where times of day are told, like Europe/Vienna (default UTC)",
    )  # fmt: skip
    parser.add_argument(
        "--start", metavar="RFC3339",
        help="when the recording began, for one that was recorded without a clock",
    )  # fmt: skip


def drawn_of(args: argparse.Namespace) -> Drawn:
    """What was drawn.

    Raises:
        UsageError: a word draws nothing.
    """
    from reasoning.questions.drawn import drawn

    return drawn(args.zones, args.lines)


def start_of(args: argparse.Namespace) -> int | None:
    """What ``--start`` says, log time in ns."""
    from replay.cli.common import parse_rfc3339

    return None if args.start is None else parse_rfc3339(args.start)
