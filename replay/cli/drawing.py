"""``--zone``, ``--line`` and ``--timezone``: what is drawn after the fact, and whose clock is told."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from datetime import UTC
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from reasoning.questions.drawn import Drawn
    from reasoning.questions.metres import GroundPlane
    from replay.cases.case_file import CaseFile


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


def add_ground(parser: argparse.ArgumentParser) -> None:
    """Declare ``--homography`` and ``--height``."""
    group = parser.add_argument_group("metres on the ground")
    group.add_argument(
        "--homography", type=Path, metavar="CSV",
        help="four points or more on the ground: columns x, y (pixels) and X, Y (metres)",
    )  # fmt: skip
    group.add_argument(
        "--height", type=float, metavar="M",
        help="how tall people are, like 1.75: a rough scale from the heights of boxes",
    )  # fmt: skip


def ground_of(args: argparse.Namespace) -> GroundPlane | None:
    """How pixels become metres, None where nothing says it.

    Raises:
        UsageError: the points cannot be read, or both are given.
    """
    from reasoning.questions.metres import GroundPlane, read_points
    from recorders.errors import UsageError

    if args.homography is not None and args.height is not None:
        raise UsageError("--homography and --height: give one of them")
    if args.homography is not None:
        return read_points(args.homography)
    if args.height is None:
        return None
    if not 0.01 <= args.height <= 100:
        raise UsageError(f"--height {args.height:g}: must be 0.01 to 100 m")
    return GroundPlane(height_m=args.height)


def drawn_of(args: argparse.Namespace, inputs: Sequence[str | Path] = ()) -> Drawn:
    """What was drawn, by the command and by the cases among the inputs.

    Raises:
        UsageError: a word draws nothing, or two things have one name.
    """
    from reasoning.questions.drawn import Drawn, DrawnLine, DrawnZone, drawn

    made = drawn(args.zones, args.lines)
    for _, case in _cases(inputs):
        zones = (DrawnZone(name, tuple(p)) for name, p in case.zones.items())
        lines = (DrawnLine(name, *ends) for name, ends in case.lines.items())
        made = Drawn((*made.zones, *zones), (*made.lines, *lines))
    made.check_names()
    return made


def start_of(
    args: argparse.Namespace, inputs: Sequence[str | Path] = ()
) -> int | dict[str, int] | None:
    """What ``--start`` says, log time in ns; else what the cases among the inputs say, by
    recording.
    """
    from replay.cli.common import NANOS, parse_rfc3339

    if args.start is not None:
        return parse_rfc3339(args.start)
    found = {}
    for _, case in _cases(inputs):
        for r in case.recordings:
            if r.start is not None:
                when = r.start if r.start.tzinfo else r.start.replace(tzinfo=UTC)
                whole = int(when.replace(microsecond=0).timestamp())
                found[r.name] = whole * NANOS + when.microsecond * 1000
    return found or None


def without_cases(inputs: Sequence[str]) -> list[str]:
    """The inputs, the logs of each case in its place; what was not made with its corrections as
    they are now is said.
    """
    from replay.cases.case_file import is_case, logs_of, not_applied, read_case
    from replay.cli.common import say

    found: list[str] = []
    for given in inputs:
        if not is_case(given):
            found.append(given)
            continue
        case = read_case(given)
        for line in not_applied(given, case):
            say(f"{given}: {line}")
        found += [str(log) for log in logs_of(given, case)]
    return found


def _cases(inputs: Sequence[str | Path]) -> Iterator[tuple[str | Path, CaseFile]]:
    from replay.cases.case_file import is_case, read_case

    for given in inputs:
        if is_case(given):
            yield given, read_case(given)
