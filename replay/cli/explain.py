"""`scenetrace explain`: the rule, the values, the frames and the pictures behind an event or an answer's row."""

from __future__ import annotations

import argparse
from pathlib import Path

from recorders.errors import OutputExistsError
from replay.cli.common import add_configuration, command, say

EXAMPLE = """\
scenetrace explain annotated.mcap 12
scenetrace explain annotated.mcap relation:1-2@40 -o why/
scenetrace query annotated.mcap --ask met 3      # the column `explain` has what to give here"""
DESCRIPTION = """Say why: the rule (paper and case), the measured values with thresholds and margins, the chain of
states that led there; with -o also the frames before, during and after with everything drawn in, as PNG."""


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    p = command(commands, "explain", "why an event was reported: rule, values, frames, pictures", DESCRIPTION, EXAMPLE)
    p.add_argument("annotated", type=Path, metavar="ANNOTATED", help="annotated log (or an index, without -o)")
    p.add_argument("references", nargs="+", metavar="EVENT", help="event number, or an id of a column `explain`")
    p.add_argument("-o", "--output", type=Path, metavar="DIR", help="write pictures, explanation.txt and .json there")
    p.add_argument("--recording", metavar="NAME", help="which recording of an index")
    p.add_argument("--camera", metavar="NAME", help="which camera, where the log has several")
    p.add_argument("--json", action="store_true", help="as JSON")
    p.add_argument("--force", action="store_true", help="write into an existing folder")
    add_configuration(p)
    p.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Explain."""
    import json

    from reasoning.questions import Case
    from reasoning.questions.explain import explain
    from replay.configuration import encounter_config

    if args.output is not None and args.output.exists() and not args.force:
        raise OutputExistsError(args.output)
    recording = args.recording
    with Case([args.annotated], encounters=encounter_config(args.config, args.assignments)) as case:
        if recording is None and args.camera is not None:
            rows = case.rows("SELECT recording FROM recordings WHERE camera = ?", [args.camera])
            recording = rows[0][0] if rows else None
        references = [r for word in args.references for r in word.split()]
        found = [explain(case, r, recording) for r in references]
    if args.output is not None:
        from replay.report.evidence import write_explanations

        count = write_explanations(args.annotated, found, args.output, camera=args.camera)
        say(f"{args.output}: {count} pictures, explanation.txt, explanation.json")
    if args.json:
        print(json.dumps([e.as_json() for e in found], indent=1, ensure_ascii=False))
    else:
        print("\n\n".join("\n".join(e.lines()) for e in found))
    return 0
