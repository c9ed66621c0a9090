"""Where the time of `record` and `replay` goes: microseconds a frame for each stage.

`bench_stages.py [--frames N] [--rounds N] [--save FILE] [--against FILE] [--tolerance SHARE]`

A stage is a part of the house (or a library); its time is what the main thread spends in its own
code, with what NumPy and OpenCV do for it there: decoding and writing that go on beside it are not in
it. Processor time of one thread, the least of some rounds, so that figures of different days can be
held against each other: `--save` keeps them, `--against` fails (exit code 1) where a stage takes more
by the tolerance and by twenty microseconds a frame. Before and after a change, on one machine:

    git stash; python tests/benchmarks/bench_stages.py --save /tmp/before.json; git stash pop
    python tests/benchmarks/bench_stages.py --against /tmp/before.json
"""

from __future__ import annotations

import argparse
import cProfile
import json
import os
import pstats
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from contextlib import redirect_stderr
from io import StringIO
from pathlib import Path

from replay.cli import main as run

STAGES = (
    ("recorders/segmentation", "segment: masks and blobs"),
    ("recorders/fusion", "segment: masks and blobs"),
    ("recorders/quality", "quality"),
    ("recorders/sources", "decode"),
    ("recorders/pictures", "decode"),
    ("recorders/vision", "decode"),
    ("recorders/log", "log: read and write"),
    ("recorders/annotated/digest", "digests"),
    ("recorders/annotated", "log: read and write"),
    ("recorders", "messages"),
    ("replay/trackers/belief", "belief"),
    ("replay/trackers/appearance", "appearance"),
    ("replay/trackers/association", "associate"),
    ("replay/assignment", "associate"),
    ("replay/trackers", "track"),
    ("replay/hindsight", "hindsight"),
    ("replay/image_annotations", "drawings"),
    ("replay", "replay loop"),
    ("reasoning", "reason"),
    ("msgspec", "encode"),
)
Times = dict[str, float]
_NOISE_US = 20.0


def stage(file: str) -> str | None:
    """The stage of a source file; None for what belongs to whoever called it."""
    for part, name in STAGES:
        if f"/{part}" in file:
            return name
    return None


def stages(act: Callable[[], object], frames: int) -> Times:
    """Microseconds a frame of each stage; built-in calls count for their callers."""
    profile = cProfile.Profile(time.thread_time)
    profile.enable()
    with redirect_stderr(StringIO()):
        act()
    profile.disable()
    found: dict[str, float] = defaultdict(float)
    for (file, _, _), (_, _, own, _, callers) in pstats.Stats(profile).stats.items():  # type: ignore[attr-defined]
        name = stage(file)
        if name is not None or not callers:
            found[name or "rest"] += own
            continue
        for (caller, _, _), (_, _, share, _) in callers.items():
            found[stage(caller) or "rest"] += share
    return {name: 1e6 * used / frames for name, used in sorted(found.items())}


def boxes(path: Path, frames: int) -> Path:
    """Detections of eight people who walk about."""
    lines = []
    for frame in range(1, frames + 1):
        for k in range(8):
            x = (60 * k + (3 + k % 3) * frame) % 600
            lines.append(f"{frame},-1,{x},{120 + 20 * k},30,80,1,-1,-1,-1")
    path.write_text("\n".join(lines) + "\n")
    return path


def least(act: Callable[[], object], frames: int, rounds: int) -> Times:
    """`stages`, each at its best of some rounds: what else runs on the machine only adds."""
    act()  # everything is loaded before it is measured
    found = [stages(act, frames) for _ in range(rounds)]
    return {name: min(times.get(name, 0.0) for times in found) for name in found[0]}


def measure(frames: int, rounds: int) -> dict[str, Times]:
    """All of it: boxes alone, and PETS' pictures where they are."""
    data = Path(
        os.environ.get("SCENETRACE_DATA", Path(__file__).parents[2].parent / "shared/data")
    )
    pictures = sorted((data / "pets09-s2l1" / "img1").glob("*.jpg"))[:frames]
    found: dict[str, Times] = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)

        def one(what: str, words: list[str], count: int) -> None:
            found[what] = least(lambda: run(words), count, rounds)

        det = boxes(folder / "det.txt", frames)
        size = ["--fps", "25", "--size", "640x480"]
        scene, out = str(folder / "scene.mcap"), str(folder / "out.mcap")
        one("record, boxes", ["record", str(det), "-o", scene, "--force", *size], frames)
        one("replay, boxes", ["replay", scene, "-o", out, "--force"], frames)
        if not pictures:
            print("no PETS here: pictures are left out", file=sys.stderr)
            return found
        (folder / "img1").mkdir()
        for path in pictures:
            (folder / "img1" / path.name).symlink_to(path)
        cut = str(folder / "pets.mcap")
        words = ["record", str(folder / "img1"), "--fps", "7", "-o", cut, "--force"]
        one("record, pictures", words, len(pictures))
        for tracker in ("events", "shells", "parts"):
            words = ["replay", cut, "-o", out, "--force", "--tracker", tracker]
            one(f"replay, pictures, {tracker}", words, len(pictures))
    return found


def table(found: dict[str, Times]) -> str:
    """One row a stage, one column a job."""
    names = sorted({name for times in found.values() for name in times})
    lines = ["| us a frame | " + " | ".join(found) + " |", "|---" * (len(found) + 1) + "|"]
    for name in names:
        cells = (f"{times[name]:.0f}" if name in times else "" for times in found.values())
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    sums = (f"{sum(times.values()):.0f}" for times in found.values())
    return "\n".join([*lines, "| **sum** | " + " | ".join(sums) + " |"])


def slower(now: dict[str, Times], before: dict[str, Times], tolerance: float) -> list[str]:
    """The stages that take more than they did."""
    return [
        f"{job}: {name} takes {used:.0f} us a frame, it took {before[job][name]:.0f}"
        for job, times in now.items()
        for name, used in times.items()
        if job in before
        and name in before[job]
        and used > before[job][name] * (1 + tolerance)
        and used > before[job][name] + _NOISE_US
    ]


def main() -> int:
    """Measure, print, compare."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--against", type=Path)
    parser.add_argument("--tolerance", type=float, default=0.15)
    args = parser.parse_args()
    found = measure(args.frames, args.rounds)
    print(table(found))
    if args.save is not None:
        args.save.write_text(json.dumps(found, indent=1) + "\n")
    if args.against is None:
        return 0
    worse = slower(found, json.loads(args.against.read_text()), args.tolerance)
    for line in worse:
        print(line)
    return 1 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
