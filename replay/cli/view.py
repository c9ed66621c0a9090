"""``scenetrace view``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from recorders.errors import UsageError
from replay.cli.common import Commands, add_camera, add_limits, command, parse_limits, say
from replay.cli.exit_codes import Exit


def add(commands: Commands) -> None:
    """Declare the command."""
    parser = command(
        commands,
        "view",
        "the report with the whole recording behind it, in a browser",
        "Serve the report of an annotated log, or of a case, with every frame's picture behind"
        " it and a box for questions.\nIt listens on this machine's own address alone; the"
        " address that it prints bears a token, without which nothing is\nthere. Nothing is"
        " written unless --edit is given: then notes and corrections made in the page go into"
        " the case's\nfiles, or into LOG.notes.jsonl and LOG.corrections.jsonl beside the log."
        " Ctrl-C ends it.",
        "scenetrace view annotated.mcap --edit",
    )
    parser.add_argument(
        "log", type=Path, metavar="LOG|CASE", help="annotated log, or a case"
    )
    parser.add_argument(
        "--port", type=int, default=0, metavar="P", help="default: any that is free"
    )
    parser.add_argument(
        "--edit", action="store_true", help="notes and corrections may be written"
    )
    parser.add_argument(
        "--recording",
        metavar="NAME",
        help="which recording of a case, where it has several",
    )
    add_camera(parser)
    add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Serve until it is interrupted."""
    from replay.report.pictures import check_log
    from replay.viewing import Desk, DeskServer

    if not 0 <= args.port <= 65535:
        raise UsageError(f"--port {args.port}: must be 0 to 65535")
    log, files, more = _inputs(args.log, args.recording)
    check_log(log)
    limits = parse_limits(args.limit)
    with Desk(log, args.camera, **files, edit=args.edit, more=more, limits=limits) as desk:
        try:
            server = DeskServer(desk, args.port)
        except OSError as error:
            raise UsageError(
                f"--port {args.port}: {error.strerror}; leave it out, or give another"
            ) from error
        with server:
            print(server.url, flush=True)
            say("open this address in a browser; Ctrl-C ends it")
            try:
                server.serve_forever(poll_interval=0.2)
            except KeyboardInterrupt:
                say("ended")
    return Exit.DONE


def _inputs(
    path: Path, recording: str | None
) -> tuple[Path, dict[str, Path], dict[str, Any]]:
    """The log, where its corrections and notes are, and what a case adds."""
    from replay.cases import is_case, read_case
    from replay.cases.case_file import chosen
    from replay.cli.report import of_case

    log, more = of_case(path, recording)
    files = {
        name: log.with_name(f"{log.stem}.{name}.jsonl") for name in ("corrections", "notes")
    }
    if is_case(path):
        case = read_case(path)
        one = chosen(path, case, recording)
        named = {"corrections": one.corrections, "notes": case.notes}
        files |= {name: path.parent / file for name, file in named.items() if file}
    return log, files, more
