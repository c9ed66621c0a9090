"""`scenetrace index`: many annotated logs into one database."""

from __future__ import annotations

import argparse
from pathlib import Path

from replay.cli.common import (
    Commands,
    add_configuration,
    add_limits,
    command,
    parse_limits,
    progress,
    say,
)
from replay.cli.exit_codes import Exit

EXAMPLE = """\
scenetrace index monday.mcap tuesday.mcap -o case.duckdb
scenetrace index recordings/ -o case.duckdb      # every .mcap below the folder
scenetrace index recordings/ -o case-parquet/    # as Parquet, for other tools
scenetrace query case.duckdb --ask met 3"""
DESCRIPTION = """Collect the tables of annotated logs, so that questions to many hours take no time.

An index is added to: each recording goes in once (known by its SHA-256), so the same command after an interruption does
the rest. No picture is decoded."""


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands, "index", "many annotated logs into one database", DESCRIPTION, EXAMPLE
    )
    parser.add_argument(
        "logs",
        nargs="+",
        type=Path,
        metavar="LOG|CASE",
        help="annotated logs, folders of them, or a case of `batch`",
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        required=True,
        metavar="INDEX",
        help="NAME.duckdb, or a folder for Parquet",
    )
    parser.add_argument(
        "--keep-going",
        action="store_true",
        help="leave out logs that cannot be read (exit code 3)",
    )
    parser.add_argument("--json", action="store_true", help="what was done, as JSON")
    add_configuration(parser)
    add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Index."""
    import json

    from reasoning.questions.catalogue import is_catalogue
    from reasoning.questions.index import build_index
    from recorders.errors import UsageError
    from replay.asking_configuration import chosen_encounters, encounter_config

    encounters = encounter_config(args.config, args.assignments)
    logs: list[Path] = []
    for path in args.logs:
        # A case of `batch` holds scene logs too, which have no tracks.
        folder = path / "annotated" if is_catalogue(path) else path
        logs += sorted(folder.rglob("*.mcap")) if path.is_dir() else [path]
    if not logs:
        raise UsageError(f"no .mcap below {args.logs[0]}")
    with progress(len(logs), "logs") as told:
        done = build_index(
            logs,
            args.output,
            keep_going=args.keep_going,
            limits=parse_limits(args.limit),
            encounters=encounters,
            progress=told,
        )
    for path, why in done.failed:
        say(f"left out {why}" if why.startswith(str(path)) else f"left out {path}: {why}")
    say(
        f"{args.output}: {len(done.added)} recordings added, {len(done.known)} were there,"
        f" {len(done.failed)} left out"
    )
    if args.json:
        print(json.dumps({
            "added": [f.recording for f in done.added],
            "known": [str(p) for p in done.known],
            "left_out": [{"path": str(p), "why": why} for p, why in done.failed],
        }))  # fmt: skip
    other = done.known and _found_otherwise(
        args.output, chosen_encounters(args.config, args.assignments)
    )
    return Exit.LEFT_OUT if done.failed or other else Exit.DONE


def _found_otherwise(index: Path, chosen: dict[str, float]) -> bool:
    """Whether encounters that were there already were found with other thresholds; says so."""
    from reasoning.questions import Case
    from reasoning.questions.name_checks import check_thresholds
    from recorders.errors import UsageError

    with Case([index]) as case:
        try:
            check_thresholds(case, chosen)
        except UsageError as error:
            say(str(error))
            return True
    return False
