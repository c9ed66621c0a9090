"""``scenetrace verify``."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from recorders.errors import UsageError
from replay.cli import cases, common
from replay.cli.exit_codes import Exit
from replay.plurals import count_of

if TYPE_CHECKING:
    from replay.sealing import CaseVerdict
    from replay.verification import Verification


def add(commands: common.Commands) -> None:
    """Declare the command."""
    parser = common.command(
        commands,
        "verify",
        "replay again and compare digests",
        "Replay a recording again with the tracker and configuration that its annotated log"
        " names, and say that the\nresult is identical, or which frame, channel, track and"
        " field differ first, and why: the recording, the\nconfiguration, a package's"
        " version, OpenCV's build or the log itself was changed. Exit code 4 where"
        " it\ndiffers.",
        "scenetrace verify annotated.mcap\n"
        "scenetrace verify annotated.mcap --quick\n"
        "scenetrace verify --manifest case.json --public-key lab.key.pub",
    )
    parser.add_argument(
        "annotated",
        type=Path,
        nargs="?",
        metavar="ANNOTATED|CASE",
        help="an annotated log, or a case's folder",
    )
    parser.add_argument(
        "--scene",
        type=Path,
        metavar="FILE",
        help="the scene log, where the annotated log lacks it",
    )
    common.add_tracker(parser, "default: the one that the log names, if it is installed")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="check the digest chain alone, without replaying",
    )
    parser.add_argument(
        "--manifest",
        type=Path,
        metavar="FILE",
        help="check the files of a manifest of `scenetrace seal`",
    )
    parser.add_argument(
        "--public-key",
        type=Path,
        metavar="FILE",
        help="the key that must have signed the manifest",
    )
    parser.add_argument("--json", action="store_true", help="the verdict as JSON")
    common.add_limits(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Verify."""
    if args.annotated is None and args.manifest is None:
        raise UsageError("nothing to verify: give an annotated log or --manifest FILE")
    if args.public_key is not None and args.manifest is None:
        raise UsageError("--public-key belongs to --manifest")
    if args.annotated is not None and cases.case_at(args.annotated) is not None:
        return _of_case(args)
    case = None if args.manifest is None else _manifest(args)
    log = None if args.annotated is None else _log(args)
    if args.json:
        # One document, whatever was asked for: both verdicts under their names where there are two.
        plain = [asdict(verdict) for verdict in (case, log) if verdict is not None]
        print(
            json.dumps(
                plain[0] if len(plain) == 1 else {"manifest": plain[0], "log": plain[1]},
                indent=2,
            )
        )
    good = (case is None or case.intact) and (log is None or log.identical)
    return Exit.DONE if good else Exit.DIFFERS


def _of_case(args: argparse.Namespace) -> int:
    """Each of a case's logs, the name of each before its verdict."""
    if args.manifest is not None or args.scene is not None:
        raise UsageError("--manifest and --scene go with one log, not with a case")
    verdicts = {}
    for path in cases.annotated_logs(args.annotated):
        if not args.json:
            print(common.printable(str(path)), end=": ", flush=True)
        verdicts[str(path)] = _log(argparse.Namespace(**{**vars(args), "annotated": path}))
    if args.json:
        plain = {name: asdict(verdict) for name, verdict in verdicts.items()}
        print(json.dumps(plain, indent=2))
    good = all(verdict.identical for verdict in verdicts.values())
    return Exit.DONE if good else Exit.DIFFERS


def _manifest(args: argparse.Namespace) -> CaseVerdict:
    from replay.sealing import check_manifest

    with common.progress(None, "files") as progress:
        verdict = check_manifest(args.manifest, key=args.public_key, progress=progress)
    for line in () if args.json else verdict.lines():
        print(common.printable(line))
    return verdict


def _log(args: argparse.Namespace) -> Verification:
    from replay.verification import verify, verify_chain

    limits = common.parse_limits(args.limit)

    with common.progress(None) as bar, common.interrupts_at(bar) as progress:
        if args.quick:
            verdict = verify_chain(args.annotated, limits, progress)
        else:
            verdict = verify(
                args.annotated,
                args.scene,
                tracker=args.tracker,
                limits=limits,
                progress=progress,
            )
    if args.json:
        return verdict
    if verdict.identical:
        print(
            f"identical: {count_of(verdict.frames, 'frame')}, output digest"
            f" {verdict.output_digest}"
        )
        for reason in verdict.reasons:
            print(common.printable(f"  without effect: {reason}"))
    else:
        equal = count_of(verdict.frames, "equal frame")
        print(common.printable(f"differs after {equal}: {verdict.difference}"))
        if verdict.effect is not None:
            print(common.printable(f"  first effect: {verdict.effect}"))
        for reason in verdict.reasons:
            print(common.printable(f"  reason: {reason}"))
    return verdict
