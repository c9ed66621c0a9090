"""``scenetrace verify``."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from pathlib import Path

from replay.cli import common

DIFFERS = 4


def add(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Declare the command."""
    p = common.command(
        commands,
        "verify",
        "replay again and compare digests",
        "Replay a recording again with the tracker and configuration that its annotated log names, and say that the\n"
        "result is identical, or which frame, channel, track and field differ first. Exit code 4 where it differs.",
        "scenetrace verify annotated.mcap\nscenetrace verify annotated.mcap --quick",
    )
    p.add_argument("annotated", type=Path, help="an annotated log")
    p.add_argument("--scene", type=Path, metavar="FILE", help="the scene log, where the annotated log lacks it")
    p.add_argument("--quick", action="store_true", help="check the digest chain alone, without replaying")
    p.add_argument("--json", action="store_true", help="the verdict as JSON")
    p.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Verify."""
    from replay.verifying import verify, verify_chain

    with common.progress(None) as progress:
        verdict = verify_chain(args.annotated) if args.quick else verify(args.annotated, args.scene, progress=progress)
    if args.json:
        print(json.dumps(asdict(verdict), indent=2))
    elif verdict.identical:
        print(f"identical: {verdict.frames} frames, output digest {verdict.output_digest}")
    else:
        print(f"differs after {verdict.frames} equal frames: {verdict.difference}")
        for reason in verdict.reasons:
            print(f"  reason: {reason}")
    return 0 if verdict.identical else DIFFERS
