"""Everything that has to pass: lint, format, types, documents, tests. `python tests` runs it; words
after it go to pytest.

    python tests             all that there is to prove
    python tests --all       that, and what is proved again on more scenes
    python tests --fast      the inner loop: rules and single pieces, without whole replays,
                             whole commands, other processes and real recordings
    python tests --cov       branch coverage as well, which nearly doubles the time of the tests
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FAST, ALL = "--fast", "--all"
ROOMS = ["recorders", "reasoning", "replay", "fixtures", "scenetrace.py"]
CHECKS = (
    # Every test that starts the program would compile it anew where Python may not write bytecode.
    ("compile", ["compileall", "-q", *ROOMS]),
    ("lint", ["ruff", "check", "."]),
    ("format", ["ruff", "format", "--check", "."]),
    ("types", ["mypy"]),
)
TESTS = ["pytest", "-n", "auto", "--dist", "worksteal", "-q"]
WHOLE = (
    *(
        "batch",
        "cases",
        "cli",
        "desk",
        "events",
        "faults",
        "fixtures",
        "golden",
        "hostile",
        "library",
    ),
    *("live", "property", "real", "reasoning/questions"),
    *("recorders/sources", "recorders/test_pieces.py", "recorders/test_recording.py"),
    *("recorders/test_recording_methods.py", "recorders/segmentation/test_motion.py"),
    *(
        "replay/cases",
        "replay/compare",
        "replay/correcting",
        "replay/export",
        "replay/fitting",
    ),
    *(
        "replay/report",
        "replay/sealing",
        "replay/test_engine.py",
        "replay/test_evidence.py",
    ),
    "recorders/segmentation/test_change.py",
    "recorders/segmentation/test_surroundings.py",
    *("replay/test_forgeries.py", "replay/test_pass_through.py", "replay/test_run.py"),
    *("replay/test_record_command.py", "replay/test_verification.py"),
    *("replay/trackers/test_trials.py", "replay/trackers/events/test_events_tracker.py"),
    *("replay/trackers/parts/test_parts_tracking.py",),
    *("replay/trackers/shells/test_shells_order.py",),
    *("replay/trackers/shells/test_shells_tracker.py",),
)
"""Folders and files of tests, each of which records, replays or starts the whole program."""
INNER = [
    "-m",
    "not slow and not real and not long",
    *(f"--ignore=tests/{where}" for where in WHOLE),
]


def commands(words: list[str], site: str) -> list[tuple[str, list[str]]]:
    """Names and words of the checks, in the order in which they run."""
    if FAST in words:
        rest = [w for w in words if w != FAST]
        return [*CHECKS, ("tests", [*TESTS, *INNER, *rest])]
    chosen = [] if ALL in words else ["-m", "not long"]
    rest = [w for w in words if w != ALL]
    documents = ["mkdocs", "build", "--strict", "--quiet", "--site-dir", site]
    return [*CHECKS, ("documents", documents), ("tests", [*TESTS, *chosen, *rest])]


def main(words: list[str]) -> int:
    """Run all checks, even after one has failed; returns 1 if any did."""
    failed = []
    quiet = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
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
