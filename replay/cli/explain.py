"""`scenetrace explain`: the rule, the values, the frames and the pictures behind an event or an
answer's row.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli.common import (
    Commands,
    add_camera,
    add_configuration,
    add_limits,
    command,
    parse_limits,
    printable,
    say,
)
from replay.cli.drawing import add_clock, add_drawing, drawn_of, start_of
from replay.cli.exit_codes import Exit

if TYPE_CHECKING:
    from reasoning.questions import Case

EXAMPLE = """\
scenetrace explain annotated.mcap 12
scenetrace explain annotated.mcap relation:1-2@40 -o why/
scenetrace query annotated.mcap --ask met 3      # the column `explain` has what to give here"""
DESCRIPTION = """Say why: the rule (paper and case), the measured values with thresholds and margins, the chain of
states that led there; with -o also the frames before, during and after with everything drawn in, as PNG."""


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands,
        "explain",
        "why an event was reported: rule, values, frames, pictures",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument(
        "annotated",
        type=Path,
        metavar="ANNOTATED",
        help="annotated log (or an index, without -o)",
    )
    parser.add_argument(
        "references",
        nargs="+",
        metavar="EVENT",
        help="event number, or an id of a column `explain`",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="DIR",
        help="write pictures, explanation.txt and .json there",
    )
    parser.add_argument("--recording", metavar="NAME", help="which recording of an index")
    add_camera(parser)
    parser.add_argument("--json", action="store_true", help="as JSON")
    parser.add_argument(
        "--force", action="store_true", help="write into an older explanation's folder"
    )
    add_clock(parser)
    add_drawing(parser)
    add_configuration(parser)
    add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Explain."""
    import json

    from reasoning.questions import Case
    from reasoning.questions.explain import explain
    from reasoning.questions.name_checks import check_recording, check_thresholds
    from replay.asking_configuration import chosen_encounters, encounter_config

    if args.output is not None:
        from replay.export.output import check_folder
        from replay.report.evidence import EXPLANATION
        from replay.report.pictures import check_log

        check_folder(args.output, EXPLANATION, force=args.force)
        check_log(args.annotated)
    with Case(
        [args.annotated],
        log_limits=parse_limits(args.limit),
        encounters=encounter_config(args.config, args.assignments),
        drawn=drawn_of(args),
        start_ns=start_of(args),
    ) as case:
        check_thresholds(case, chosen_encounters(args.config, args.assignments))
        check_recording(case, args.recording)
        recording = (
            args.recording
            if args.camera is None
            else _of_camera(case, args.camera, args.recording)
        )
        references = [r for word in args.references for r in word.split()]
        found = [
            explain(case, reference, recording, args.timezone) for reference in references
        ]
    if args.output is not None:
        from replay.report.evidence import write_explanations

        count = write_explanations(
            args.annotated, found, args.output, camera=args.camera, force=args.force
        )
        say(f"{args.output}: {count} pictures, explanation.txt, explanation.json")
    if args.json:
        print(json.dumps([e.as_json() for e in found], indent=1, ensure_ascii=False))
    else:
        print("\n\n".join("\n".join(map(printable, e.lines())) for e in found))
    return Exit.DONE


def _of_camera(case: Case, camera: str, recording: str | None) -> str:
    """The recording of a camera.

    Raises:
        UsageError: there is none, or there are several.
    """
    rows = case.rows("SELECT camera, recording FROM recordings ORDER BY recording")
    found = [name for seen, name in rows if seen == camera and recording in (None, name)]
    if not found:
        there = ", ".join(
            sorted({seen for seen, name in rows if recording in (None, name)})
        )
        raise UsageError(
            f"--camera {camera}: there is none of that name; there are: {there}"
        )
    if len(found) > 1:
        raise UsageError(
            f"--camera {camera}: of several recordings ({', '.join(found[:5])}); give"
            " --recording"
        )
    return str(found[0])
