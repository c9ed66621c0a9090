"""`scenetrace report`: one HTML file that opens offline."""

from __future__ import annotations

import argparse
from pathlib import Path

from replay.cli.common import Commands, command, say
from replay.cli.exit_codes import Exit


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands,
        "report",
        "one HTML file that opens offline",
        "Write key figures, trajectories, the timeline, the interaction graph over time and"
        " the events of an\nannotated log as one HTML file that opens offline in any"
        " browser.",
        "scenetrace report annotated.mcap -o report.html",
    )
    parser.add_argument("annotated", type=Path, metavar="ANNOTATED", help="annotated log")
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="OUT", help="the HTML file"
    )
    parser.add_argument(
        "--thumbnails",
        type=int,
        default=160,
        metavar="N",
        help="most frames shown as pictures (160)",
    )
    parser.add_argument(
        "--camera", metavar="NAME", help="which camera, where the log has several"
    )
    parser.add_argument("--force", action="store_true", help="overwrite OUT")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the report."""
    from recorders.errors import UsageError
    from replay.report import write_report
    from replay.report.data import ReportOptions

    if not 2 <= args.thumbnails <= 5000:
        raise UsageError(f"--thumbnails {args.thumbnails}: must be 2 to 5000")
    options = ReportOptions(thumbnails=args.thumbnails)
    figures = write_report(
        args.annotated, args.output, camera=args.camera, options=options, force=args.force
    )
    size = args.output.stat().st_size / 1e6
    say(
        f"{args.output}: {size:.1f} MB, "
        + ", ".join(f"{value} {name}" for name, value in figures.items())
    )
    return Exit.DONE
