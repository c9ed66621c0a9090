"""``scenetrace doctor``."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from msgspec import to_builtins

from replay.cli import cases, common
from replay.cli.exit_codes import Exit
from replay.plurals import count_of

if TYPE_CHECKING:
    from recorders.stores import Store


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "doctor",
        "check a log's structure and checksums",
        "Read a log whole and check every checksum, length, index and order. Each finding"
        " says where it is.\nExit code 1 where there is an error; warnings alone are exit"
        " code 0. Of a CASE of `scenetrace batch`: whether\nevery file is there with the"
        " SHA-256 that it was made with.",
        "scenetrace doctor scene.mcap",
    )
    parser.add_argument(
        "log",
        type=cases.log_or_case,
        metavar="LOG|CASE",
        help="any MCAP file; a case, as a folder or a URI",
    )
    parser.add_argument("--json", action="store_true", help="the findings as JSON")
    common.add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Examine."""
    from recorders.log.info import examine

    case = cases.case_at(args.log)
    if case is not None:
        return _of_case(case, args.json)
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


def _of_case(case: Store, as_json: bool) -> int:
    from replay.batch.inspection import faults

    found = list(faults(case))
    if as_json:
        print(json.dumps(to_builtins(found), indent=2))
    else:
        for fault in found:
            print(common.printable(f"error   {fault.key}: {fault.reason}"))
        if not found:
            print(f"{case.uri}: every file is as it was made")
    if found:
        common.say(
            f"{case.uri}: {count_of(len(found), 'error')}; `scenetrace batch` of the same"
            " sources into a new case makes them again"
        )
    return Exit.FAILED if found else Exit.DONE
