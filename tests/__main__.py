"""Everything that has to pass: lint, format, types, tests. `python tests` runs it; words after it
go to pytest.

`python tests --cov` measures branch coverage as well, which nearly doubles the time that the
tests take.
"""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
CHECKS = (
    ("lint", ["ruff", "check", "."]),
    ("format", ["ruff", "format", "--check", "."]),
    ("types", ["mypy"]),
)
TESTS = ["pytest", "-n", "auto", "--dist", "worksteal", "-q"]


def main(words: list[str]) -> int:
    """Run all checks, even after one has failed; returns 1 if any did."""
    failed = []
    for name, command in (*CHECKS, ("tests", [*TESTS, *words])):
        print(f"== {name}", flush=True)
        if subprocess.run(
            [sys.executable, "-m", *command], cwd=ROOT, check=False
        ).returncode:
            failed.append(name)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
