"""`scenetrace evidence`: a folder with clip, frames and facts of chosen events."""

from __future__ import annotations

import argparse
from pathlib import Path

from replay.cli.common import (
    Commands,
    add_camera,
    add_configuration,
    add_limits,
    command,
    parse_limits,
    say,
)
from replay.cli.drawing import add_clock, add_drawing, drawn_of, start_of
from replay.cli.exit_codes import Exit

EXAMPLE = """\
scenetrace evidence annotated.mcap --events 12 relation:1-2@40 -o evidence/
scenetrace verify --manifest evidence/manifest.json      # nothing was changed since"""
DESCRIPTION = """\
Write what a court or a colleague needs: for each event (or row of an answer) a clip with its targets
marked and the same plain (H.264), frames marked and as recorded, the facts as JSON, the
configuration, digests of the log and of what it was recorded from, pieces of the log that stand
alone, one page to read and print, and the same as a PDF."""


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands,
        "evidence",
        "a folder with clip, frames and facts of chosen events",
        DESCRIPTION,
        EXAMPLE,
    )
    parser.add_argument("annotated", type=Path, metavar="LOG", help="annotated log")
    parser.add_argument("--events", nargs="+", action="extend", required=True, metavar="EVENT",
                   help="event numbers, or ids of a column `explain`; 12,13 works too")  # fmt: skip
    parser.add_argument(
        "-o", "--output", type=Path, required=True, metavar="DIR", help="the folder"
    )
    add_camera(parser)
    parser.add_argument(
        "--force",
        action="store_true",
        help="replace what an older evidence folder lists in its manifest",
    )
    parser.add_argument(
        "--blur-others", action="store_true",
        help="of everybody but the targets no pixel is left in clips and pictures; no piece of the log then",
    )  # fmt: skip
    add_clock(parser)
    add_drawing(parser)
    add_configuration(parser)
    add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Collect evidence."""
    from replay.asking_configuration import encounter_config
    from replay.report.evidence import MANIFEST, EvidenceOptions, write_evidence
    from replay.sealing.manifest import added_files, read_manifest

    references = list(
        dict.fromkeys(r for word in args.events for r in word.replace(",", " ").split())
    )
    encounters = encounter_config(args.config, args.assignments)
    start = start_of(args)
    assert not isinstance(start, dict)
    found = write_evidence(
        args.annotated,
        references,
        args.output,
        EvidenceOptions(
            camera=args.camera,
            force=args.force,
            encounters=encounters,
            drawn=drawn_of(args),
            start_ns=start,
            zone=args.timezone,
            hide=args.blur_others,
            limits=parse_limits(args.limit),
        ),
    )
    manifest = args.output / MANIFEST
    strangers = added_files(read_manifest(manifest), manifest)
    if strangers:
        say(
            f"{args.output}: {', '.join(strangers[:5])}: was there, is no part of it;"
            " `verify` will name it"
        )
    say(
        f"{args.output}: {len(found)} explained, index.html and evidence.pdf to read,"
        " manifest.json to verify"
    )
    return Exit.DONE
