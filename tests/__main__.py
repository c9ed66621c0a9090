"""Everything that has to pass: lint, format, types, documents, tests.

What stands behind the options, a file or an option of pytest, goes to pytest:
`python tests --fast -k relations`, or `python tests --cov`, which measures branch coverage as well
and nearly doubles the time.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ALL_EXAMPLES = "SCENETRACE_ALL_EXAMPLES"
"""What `tests/examples.py` reads."""
ROOT = Path(__file__).resolve().parent.parent
ROOMS = ["recorders", "reasoning", "replay", "fixtures", "scenetrace.py"]
CHECKS = (
    # Every test that starts the program would compile it anew where Python may not write bytecode.
    ("compile", ["compileall", "-q", *ROOMS]),
    ("lint", ["ruff", "check", "."]),
    ("format", ["ruff", "format", "--check", "."]),
    ("types", ["mypy"]),
)
TESTS = ["pytest", "-n", "auto", "--dist", "worksteal", "-q"]
WHOLE = {
    ".": "batch cases cli desk events faults fixtures golden hostile library live property real",
    "reasoning": "questions",
    "recorders/detectors": "test_onnx_detector.py",
    "recorders": "sources test_pieces.py test_recording.py test_recording_methods.py",
    "recorders/segmentation": "test_change.py test_motion.py test_surroundings.py",
    "replay": "cases compare correcting export fitting report sealing test_engine.py"
    " test_evidence.py test_forgeries.py test_left_things.py test_pass_through.py test_record_command.py"
    " test_run.py test_verification.py",
    "replay/trackers": "test_trials.py",
    "replay/trackers/events": "test_events_tracker.py",
    "replay/trackers/parts": "test_parts_tracking.py",
    "replay/trackers/shells": "test_shells_order.py test_shells_rules.py test_shells_tracker.py",
}
"""Folders and files of tests, each of which records, replays or starts the whole program."""
INNER = ["-m", "not slow and not real and not long"]
INNER += [f"--ignore=tests/{room}/{name}" for room in WHOLE for name in WHOLE[room].split()]
TIMES = ["-p", "tests.processor_time"]


def parser() -> argparse.ArgumentParser:
    """The options."""
    found = argparse.ArgumentParser(
        prog="python tests",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    which = found.add_mutually_exclusive_group()
    which.add_argument(
        "--fast",
        action="store_true",
        help="the inner loop, about a minute: rules and single pieces, without whole replays,"
        " whole commands, other processes, real recordings and documents",
    )
    which.add_argument(
        "--all",
        action="store_true",
        help="also what shows on more scenes, trackers and kinds what a test beside it shows,"
        " the whole demo, the shipped fit, five times the examples of every property:"
        " some minutes more",
    )
    found.add_argument(
        "--times",
        action="store_true",
        help="print the processor time of every folder, file and of the dearest tests, with fixtures"
        " and the processes that they start: what a clock shows depends on who else works",
    )
    return found


def commands(words: list[str], site: str) -> list[tuple[str, list[str]]]:
    """Names and words of the checks, in the order in which they run."""
    args, rest = parser().parse_known_args(words)
    rest = [*(TIMES if args.times else []), *rest]
    if args.fast:
        return [*CHECKS, ("tests", [*TESTS, *INNER, *rest])]
    documents = ["mkdocs", "build", "--strict", "--quiet", "--site-dir", site]
    chosen = [] if args.all else ["-m", "not long"]
    return [*CHECKS, ("documents", documents), ("tests", [*TESTS, *chosen, *rest])]


def main(words: list[str]) -> int:
    """Run all checks, even after one has failed; returns 1 if any did."""
    failed = []
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    if parser().parse_known_args(words)[0].all:
        quiet[ALL_EXAMPLES] = "1"
    with tempfile.TemporaryDirectory() as site:
        for name, command in commands(words, site):
            print(f"== {name}", flush=True)
            done = subprocess.run(
                [sys.executable, "-m", *command], cwd=ROOT, check=False, env=quiet
            )
            if done.returncode:
                failed.append(name)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
