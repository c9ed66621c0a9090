"""`scenetrace report`: one HTML file that opens offline."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from replay.cli.common import Commands, add_camera, add_limits, command, parse_limits, say
from replay.cli.exit_codes import Exit


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands,
        "report",
        "one HTML file that opens offline",
        "Write key figures, trajectories, the timeline, the interaction graph over time and"
        " the events of an\nannotated log as one HTML file that opens offline in any"
        " browser. It plays, moves picture, graph and timeline together,\nsingles a target out"
        " and keeps bookmarks. Of a case (case.toml) it says whose it is, its notes and"
        " corrections.",
        "scenetrace report annotated.mcap -o report.html",
    )
    parser.add_argument(
        "annotated", type=Path, metavar="LOG|CASE", help="annotated log, or a case"
    )
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="the HTML file"
    )
    parser.add_argument(
        "--thumbnails",
        type=int,
        default=900,
        metavar="N",
        help="most frames shown as pictures (900; fewer where they would take over 10 MB)",
    )
    parser.add_argument(
        "--recording",
        metavar="NAME",
        help="which recording of a case, where it has several",
    )
    add_camera(parser)
    parser.add_argument("--force", action="store_true", help="overwrite OUT")
    add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the report."""
    from recorders.errors import UsageError
    from replay.report import write_report
    from replay.report.data import ReportOptions

    if not 2 <= args.thumbnails <= 5000:
        raise UsageError(f"--thumbnails {args.thumbnails}: must be 2 to 5000")
    options = ReportOptions(thumbnails=args.thumbnails)
    log, more = of_case(args.annotated, args.recording)
    figures = write_report(
        log,
        args.output,
        camera=args.camera,
        options=options,
        force=args.force,
        limits=parse_limits(args.limit),
        more=more,
    )
    size = args.output.stat().st_size / 1e6
    say(
        f"{args.output}: {size:.1f} MB, "
        + ", ".join(f"{value} {name}" for name, value in figures.items())
    )
    return Exit.DONE


def of_case(path: Path, recording: str | None) -> tuple[Path, dict[str, Any]]:
    """The log that is shown, and what a case adds to its page.

    Raises:
        UsageError: several recordings and none chosen, or a recording of what is no case.
    """
    from recorders.errors import UsageError
    from replay.cases import is_case, read_case
    from replay.cases.case_file import chosen, not_applied
    from replay.cases.on_page import of_recording

    if not is_case(path):
        if recording is not None:
            raise UsageError(f"--recording {recording}: {path} is no case (case.toml)")
        return path, {}
    case = read_case(path)
    for line in not_applied(path, case):
        say(f"{path}: {line}")
    one = chosen(path, case, recording)
    return path.parent / one.log, of_recording(path, case, one)
