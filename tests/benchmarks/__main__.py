"""Speed and accuracy beside the peers: `python tests/benchmarks [NAME...] [--quick]`; without
names, all of them.

Each benchmark is a script of its own (`bench_NAME.py`) with options of its own; the real
recordings that they read are looked for in $SCENETRACE_DATA, and where they are absent a
benchmark says so and is skipped.
"""

from __future__ import annotations

import argparse
import ast
import subprocess
import sys
import time
from pathlib import Path

FOLDER = Path(__file__).resolve().parent
# What makes a benchmark short; one that is not here is short enough.
QUICK = {
    "replay": ["--quick"],
    "record": ["--rounds", "1"],
    "fleet": ["overhead", "simulate", "--count", "6", "--rounds", "1"],
}


def benchmarks() -> dict[str, tuple[Path, str]]:
    """Names, files, and the first sentence of each file's docstring."""
    found = {}
    for path in sorted(FOLDER.glob("bench_*.py")):
        text = ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or ""
        found[path.stem.removeprefix("bench_")] = (
            path,
            " ".join(text.split("\n\n")[0].split()),
        )
    return found


def main() -> int:
    """Run them one after the other; 1 if any of them failed."""
    known = benchmarks()
    lines = "\n".join(f"  {name:12} {about}" for name, (_, about) in known.items())
    parser = argparse.ArgumentParser(
        prog="tests/benchmarks",
        description=__doc__,
        epilog=f"benchmarks:\n{lines}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="which; default: all")
    parser.add_argument(
        "--quick", action="store_true", help="fewer rounds, shorter recordings"
    )
    parser.add_argument("--list", action="store_true", help="list them")
    args = parser.parse_args()
    if args.list:
        print(lines)
        return 0
    unknown = [name for name in args.names if name not in known]
    if unknown:
        parser.error(f"no benchmark {unknown[0]!r}; there are: {', '.join(known)}")
    failed = []
    for name in args.names or known:
        path, about = known[name]
        print(f"== {name}: {about}", flush=True)
        start = time.perf_counter()
        words = [sys.executable, str(path), *(QUICK.get(name, []) if args.quick else [])]
        if subprocess.run(words, check=False).returncode:
            failed.append(name)
        print(f"   ({time.perf_counter() - start:.0f} s)\n", flush=True)
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
