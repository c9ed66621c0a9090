"""Equal digests whatever the machine does: a part of `bench_trust`; run as a program, one replay
of all scenes.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from trust_common import options, table

from recorders.machine import python_version
from recorders.vision import cv2
from replay import annotated_writer as writing

# From the newest kernels down to SSE3, this build's baseline: whatever else there is has been
# disabled then. The baseline itself cannot be: OpenCV warns that "code optimizations for this
# feature are executed unconditionally".
CPU_LEVELS = (
    "AVX512-SKX", "AVX512-SKX,AVX2,FP16", "AVX512-SKX,AVX2,FP16,AVX", "AVX512-SKX,AVX2,FP16,AVX,SSE4.2,SSE4.1"
)  # fmt: skip
NUMPY_KERNELS = ("X86_V4 AVX512_ICL AVX512_SPR", "X86_V3 X86_V4 AVX512_ICL AVX512_SPR")
PLACES = (
    {"TZ": "Asia/Kathmandu", "LC_ALL": "C"},
    {"TZ": "America/St_Johns", "LC_ALL": "C.UTF-8", "LANG": "tr_TR.UTF-8"},
)
KERNELS = ("Haswell", "Nehalem", "Prescott")


def worker(order: dict[str, Any]) -> None:
    """Replay every scene with every tracker once, print the digests."""
    cv2.setNumThreads(order.get("threads", cv2.getNumThreads()))

    def slow(*_: object) -> None:
        time.sleep(0.002)

    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, path in order["scenes"].items():
            for tracker in order["trackers"]:
                progress = slow if order.get("slow") else None
                done = writing.replay(
                    Path(path), Path(folder) / "a.mcap", options(tracker), progress
                )
                found[f"{name} {tracker}"] = done.output_digest
    print(
        json.dumps(
            {
                "digests": found,
                "python": python_version(),
                "kernels": cv2.getCPUFeaturesLine(),
            }
        )
    )


def elsewhere(
    order: dict[str, Any], env: dict[str, str], python: str = sys.executable
) -> dict[str, Any]:
    """What a worker found; no digests where it failed, which then counts as unequal."""
    done = subprocess.run(
        [python, __file__, json.dumps(order)],
        env={**os.environ, **env},
        capture_output=True,
        text=True,
        check=False,
    )
    # A kernel that OpenCV does not know by that name, or that is its baseline, would have stayed
    # on.
    if (
        done.returncode
        or "unknown CPU feature" in done.stderr
        or "baseline CPU feature" in done.stderr
    ):
        print(f"{python} with {env} failed:\n{done.stderr[-1500:]}", file=sys.stderr)
        return {"digests": {}, "python": python, "kernels": ""}
    answer: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return answer


def variants(
    runs: int, pythons: Sequence[str]
) -> Iterator[tuple[str, dict[str, Any], dict[str, str], str]]:
    """Family, order, environment, interpreter."""
    me = sys.executable
    for _ in range(runs):
        yield "run again", {}, {}, me
    for seed in range(10):
        yield "PYTHONHASHSEED 0 to 9", {}, {"PYTHONHASHSEED": str(seed)}, me
    for n in (1, 2, 4):
        yield (
            "threads 1, 2, 4",
            {"threads": n},
            {"OPENBLAS_NUM_THREADS": str(n), "OMP_NUM_THREADS": str(n)},
            me,
        )
    for kernel in KERNELS:
        yield (
            f"OPENBLAS_CORETYPE {', '.join(KERNELS)}",
            {},
            {"OPENBLAS_CORETYPE": kernel},
            me,
        )
    for level in CPU_LEVELS:
        yield "OPENCV_CPU_DISABLE down to SSE3", {}, {"OPENCV_CPU_DISABLE": level}, me
    for kernels in NUMPY_KERNELS:
        yield (
            "NPY_DISABLE_CPU_FEATURES down to X86_V2",
            {},
            {"NPY_DISABLE_CPU_FEATURES": kernels},
            me,
        )
    for place in PLACES:
        yield "time zone and locale", {}, place, me
    yield "IPP on", {}, {"SCENETRACE_EXPERIMENT": "ipp"}, me
    yield "slow (2 ms a frame more)", {"slow": True}, {}, me
    for python in pythons:
        yield "", {}, {}, python


def determinism(
    logs: dict[str, Path], trackers: Sequence[str], runs: int, pythons: Sequence[str]
) -> bool:
    order = {"scenes": {n: str(p) for n, p in logs.items()}, "trackers": list(trackers)}
    first = elsewhere(order, {})["digests"]
    columns = [f"{name} {tracker}" for name in logs for tracker in trackers]
    if sorted(first) != sorted(columns):
        print("the first replay failed: there is nothing to compare with")
        return False
    equal: dict[str, dict[str, int]] = {}
    count: dict[str, int] = {}
    for family, more, env, python in variants(runs, pythons):
        answer = elsewhere({**order, **more}, env, python)
        row_name = family or f"interpreter {answer['python']}"
        count[row_name] = count.get(row_name, 0) + 1
        row = equal.setdefault(row_name, dict.fromkeys(columns, 0))
        for column in columns:
            row[column] += answer["digests"].get(column) == first[column]
        kernels = f" ({answer['kernels']})" if "OPENCV_CPU_DISABLE" in env else ""
        print(f"  {row_name}: {count[row_name]}{kernels}", file=sys.stderr, flush=True)
    print("\nEqual output digests")
    table(
        ["", *columns],
        [[f, *(f"{row[c]}/{count[f]}" for c in columns)] for f, row in equal.items()],
    )
    for column in columns:
        print(f"  {column}: {first[column][:16]}")
    return all(n == count[f] for f, row in equal.items() for n in row.values())


if __name__ == "__main__":
    worker(json.loads(sys.argv[1]))
