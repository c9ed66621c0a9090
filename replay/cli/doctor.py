"""``scenetrace doctor``."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from replay.cli import common
from replay.cli.exit_codes import Exit


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "doctor",
        "check a log's structure and checksums",
        "Read a log whole and check every checksum, length, index and order. Each finding"
        " says where it is.\nExit code 1 where there is an error; warnings alone are exit"
        " code 0.",
        "scenetrace doctor scene.mcap",
    )
    parser.add_argument("log", type=Path, metavar="LOG", help="any MCAP file")
    parser.add_argument("--json", action="store_true", help="the findings as JSON")
    common.add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Examine."""
    from recorders.log.info import examine

    findings = examine(args.log, common.parse_limits(args.limit))
    errors = sum(finding.severity == "error" for finding in findings)
    if args.json:
        print(json.dumps([asdict(finding) for finding in findings], indent=2))
    else:
        for finding in findings:
            print(
                common.printable(
                    f"{finding.severity:<7} byte {finding.offset:>10} {finding.record}: {finding.text}"
                )
            )
        if not findings:
            print(f"{args.log}: sound")
    if errors:
        common.say(
            f"{args.log}: {errors} errors; `scenetrace recover {args.log} -o OUT` keeps"
            " what is whole"
        )
    return Exit.FAILED if errors else Exit.DONE
