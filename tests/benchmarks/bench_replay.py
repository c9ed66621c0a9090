"""`replay`, end to end, against the peers' bare loops on the same input, in one process, by
turns; growth and memory.

    python tests/benchmarks/bench_replay.py [pictures] [detections] [targets] [memory] [--quick]
    [-o PLOT.png]

pictures    pictures and masks through each tracker, against a bare OpenCV loop on the video
            (decode, MOG2, morphology, components; no tracker, nothing written)
detections  detections alone through each tracker, 8,000 frames, against SORT (the tracker alone: no
            reading, no relations, no events, nothing written) and against what a user would write
            with it (`plain_replay`: read, SORT, drawings and tracks written by the mcap package)
targets     time per frame against the number of targets, beside SORT
lengths     time per frame against the length of the recording, a minute to an hour
sizes       time per frame of record and replay against the size of the pictures, 240p to 4K
memory      the most memory that a replay of a minute and of an hour takes, each in a process of its
            own

A replay reads the log, tracks, rewrites in hindsight, reasons, draws and writes the annotated log.
"""

from __future__ import annotations

import argparse
import gc
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from bench_record import bare_loop, resized
from plain_replay import plain_replay
from sort import Sort

from recorders import channels
from recorders.errors import SceneTraceError
from recorders.log import LogWriter
from recorders.messages import NO_BLOB, Detections
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions
from replay.trackers.catalogue import TRACKERS

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
SEQUENCE = DATA / "pets09-s2l1"
COUNTS = (2, 5, 10, 20, 50, 100, 200)
MINUTE, HOUR = 1_500, 90_000
LONG = 8_000
MINUTES = (1, 2, 5, 10, 20, 60)
HEIGHTS = (240, 360, 480, 720, 1080, 2160)
FRAME_NS = 40_000_000
MEASURE = """
import resource, sys
from pathlib import Path
from bench_replay import run
run(Path(sys.argv[1]), Path(sys.argv[2]), sys.argv[3])()
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def run(scene: Path, folder: Path, tracker: str) -> Callable[[], int]:
    """A replay of a scene log with a tracker's defaults; gives the number of frames."""

    def once() -> int:
        options = ReplayOptions(tracker=tracker, config=replay_config(tracker), force=True)
        return replay(scene, folder / "annotated.mcap", options).frames

    return once


@dataclass(frozen=True)
class Cost:
    """What a frame took: seconds by the clock, and of processor over all threads (which other
    load disturbs less).
    """

    wall_s: float
    cpu_s: float


def rounds_of(runs: dict[str, Callable[[], int]], rounds: int) -> dict[str, list[Cost]]:
    """What a frame of each run cost, by turns; one that cannot run is left out, and said."""
    costs: dict[str, list[Cost]] = {label: [] for label in runs}
    for _ in range(rounds):
        for label, call in runs.items():
            gc.collect()
            wall, cpu = time.perf_counter(), time.process_time()
            try:
                frames = call()
            except SceneTraceError as e:
                print(f"  {label}: left out: {e}")
                continue
            costs[label].append(
                Cost(
                    (time.perf_counter() - wall) / frames,
                    (time.process_time() - cpu) / frames,
                )
            )
    return {label: values for label, values in costs.items() if values}


def show(costs: dict[str, list[Cost]], base: str) -> None:
    """Medians, and the median of the ratios round by round (above 1: faster than the peer)."""
    for label, values in costs.items():
        pairs = list(zip(values, costs[base], strict=True))
        rate = 1 / statistics.median(c.wall_s for c in values)
        wall = statistics.median(b.wall_s / c.wall_s for c, b in pairs)
        cpu = statistics.median(b.cpu_s / c.cpu_s for c, b in pairs)
        processor = 1e3 * statistics.median(c.cpu_s for c in values)
        print(
            f"  {label:26} {rate:7.0f} frames/s {wall:6.2f} x   {processor:7.2f} ms of"
            f" processor a frame {cpu:6.2f} x"
        )


def pictures(args: argparse.Namespace, folder: Path) -> None:
    """With pixels, against the bare loop."""
    video = SEQUENCE / "video.avi"
    if not video.exists():
        print(f"  skipped: {video} is not there")
        return
    if args.rows:
        video = resized(video, folder / "video.avi", args.rows, 400)
    scene = folder / "pictures.mcap"
    record(open_source(video), scene, RecordOptions(force=True))
    runs: dict[str, Callable[[], int]] = {"bare OpenCV loop": lambda: bare_loop(video)}
    runs |= {f"replay --tracker {name}": run(scene, folder, name) for name in TRACKERS}
    show(rounds_of(runs, args.rounds), "bare OpenCV loop")


def sort_over(scene: Path) -> Callable[[], int]:
    """SORT over a log's detections, which are read beforehand."""
    with SceneLog(scene) as log:
        frames = [np.array(f.boxes) for f in log.frames()]

    def once() -> int:
        sort = Sort()
        for boxes in frames:
            sort.step(boxes)
        return len(frames)

    return once


def repeated(text: Path, out: Path, frames: int) -> None:
    """The lines of a MOTChallenge file over and over, up to so many frames."""
    rows = [line.split(",", 1) for line in text.read_text().split()]
    length = max(int(frame) for frame, _ in rows)
    out.write_text(
        "".join(
            f"{int(frame) + start},{rest}\n"
            for start in range(0, frames, length)
            for frame, rest in rows
            if int(frame) + start <= frames
        )
    )


def detections(args: argparse.Namespace, folder: Path) -> None:
    """Without pixels, against SORT."""
    text = SEQUENCE / "det.txt"
    if not text.exists():
        print(f"  skipped: {text} is not there")
        return
    scene, peer = folder / "detections.mcap", "SORT, read, drawn, written"
    repeated(text, folder / "det.txt", LONG // 10 if args.quick else LONG)
    record(
        open_source(folder / "det.txt", fps="7", size=(768, 576)),
        scene,
        RecordOptions(force=True),
    )
    runs: dict[str, Callable[[], int]] = {
        "SORT (tracker only)": sort_over(scene),
        peer: lambda: plain_replay(scene, folder / "plain.mcap"),
    }
    runs |= {f"replay --tracker {name}": run(scene, folder, name) for name in TRACKERS}
    costs = rounds_of(runs, args.rounds)
    show(costs, "SORT (tracker only)")
    print(f"  and beside {peer}:")
    show(costs, peer)


def walkers(path: Path, people: int, frames: int, seed: int = 0) -> Path:
    """A scene log of detections: people of 20 x 50 px wander, one to 100 x 100 px of ground
    whatever their number.
    """
    rng = np.random.default_rng(seed)
    side = float(round(100 * people**0.5))
    places, speeds = rng.uniform(0, side - 51, (people, 2)), rng.normal(0, 1.2, (people, 2))
    with LogWriter(path, force=True) as log:
        channel = log.channel("/camera/detections", channels.schema("detections"), "json")
        for k in range(frames):
            speeds += rng.normal(0, 0.1, speeds.shape)
            speeds = np.clip(speeds, -2.5, 2.5)
            places += speeds
            turned = (places < 0) | (places > side - 51)
            speeds[turned] *= -1
            places = np.clip(places, 0, side - 51)
            noisy = np.round(places + rng.normal(0, 0.5, places.shape), 2)
            boxes = [(float(x), float(y), 20.0, 50.0) for x, y in noisy]
            n = len(boxes)
            found = Detections(
                k,
                int(side) + 1,
                int(side) + 1,
                boxes,
                [1.0] * n,
                [""] * n,
                [None] * n,
                [NO_BLOB] * n,
            )
            log.write(channel, channels.encode("detections", found), k * FRAME_NS)
    return path


def targets(args: argparse.Namespace, folder: Path) -> None:
    """Time per frame against the number of targets."""
    frames = 100 if args.quick else 300
    table: dict[str, list[float]] = {}
    for people in COUNTS:
        scene = walkers(folder / "walkers.mcap", people, frames)
        runs = {"SORT": sort_over(scene)} | {
            name: run(scene, folder, name) for name in TRACKERS
        }
        for label, values in rounds_of(runs, max(1, args.rounds - 2)).items():
            table.setdefault(label, []).append(
                1e3 * statistics.median(c.cpu_s for c in values)
            )
    scaling("targets", COUNTS, table, args)


def lengths(args: argparse.Namespace, folder: Path) -> None:
    """Time per frame against the length of the recording, of five people."""
    table: dict[str, list[float]] = {}
    minutes = MINUTES[:3] if args.quick else MINUTES
    for count in minutes:
        scene = walkers(folder / "walkers.mcap", 5, count * MINUTE)
        runs = {"replay events": run(scene, folder, "events")}
        for label, values in rounds_of(runs, 1).items():
            table.setdefault(label, []).append(1e3 * values[0].cpu_s)
    scaling("minutes", minutes, table, args)


def sizes(args: argparse.Namespace, folder: Path) -> None:
    """Time per frame of record and replay against the size of the pictures."""
    video = SEQUENCE / "video.avi"
    if not video.exists():
        print(f"  skipped: {video} is not there")
        return
    table: dict[str, list[float]] = {}
    heights = HEIGHTS[:3] if args.quick else HEIGHTS
    for height in heights:
        small = resized(video, folder / f"{height}.avi", height, 60)
        scene = folder / "sized.mcap"
        runs: dict[str, Callable[[], int]] = {
            "bare loop": lambda: bare_loop(small),  # noqa: B023
            "record": lambda: (
                record(open_source(small), scene, RecordOptions(force=True)).frames  # noqa: B023
            ),
            "replay events": run(scene, folder, "events"),
        }
        for label, values in rounds_of(runs, 1).items():
            table.setdefault(label, []).append(1e3 * values[0].cpu_s)
    scaling("rows", heights, table, args)


def scaling(
    what: str,
    counts: Sequence[int],
    table: dict[str, list[float]],
    args: argparse.Namespace,
) -> None:
    """Print how the time grows, and draw it where that was asked for."""
    print("  ms of processor a frame" + "".join(f"{n:>9}" for n in counts) + f"   {what}")
    for label, times in table.items():
        print(f"  {label:23}" + "".join(f"{t:9.2f}" for t in times))
    last = counts[-4:]
    for label, times in table.items():
        slope = np.polyfit(np.log(last), np.log(times[-len(last) :]), 1)[0]
        print(
            f"  {label:12} grows with the {what} to the power {slope:.2f} from {last[0]} on"
        )
    if args.output is not None:
        path = args.output.with_name(f"{args.output.stem}_{what}{args.output.suffix}")
        plot(what, counts, table, path)


def plot(
    what: str, counts: Sequence[int], table: dict[str, list[float]], path: Path
) -> None:
    """Draw the table."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(4.5, 3), layout="constrained")
    for label, times in table.items():
        axes.loglog(counts, times, marker="o", markersize=4, label=label)
    every = [t for times in table.values() for t in times]
    axes.set(
        xlabel=what,
        ylabel="ms of processor a frame",
        ylim=(min(every) / 2, max(every) * 2),
    )
    axes.grid(alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=90, metadata={"Software": None})
    print(f"  {path}: written")


def memory(args: argparse.Namespace, folder: Path) -> None:
    """The most memory of a short and of a long replay."""
    long = HOUR // 10 if args.quick else HOUR
    short_scene, long_scene = (walkers(folder / f"{n}.mcap", 5, n) for n in (MINUTE, long))
    for tracker in TRACKERS:
        peaks = []
        for scene in (short_scene, long_scene):
            words = [sys.executable, "-c", MEASURE, str(scene), str(folder), tracker]
            done = subprocess.run(
                words,
                cwd=Path(__file__).parent,
                check=False,
                capture_output=True,
                text=True,
            )
            if done.returncode:
                print(f"  {tracker}: left out: {done.stderr.strip().splitlines()[-1]}")
                break
            peaks.append(
                int(done.stdout) / (1024 if sys.platform == "linux" else 1024 * 1024)
            )
        else:
            grown = peaks[1] - peaks[0]
            figures = (
                f"{peaks[0]:6.0f} MiB over {MINUTE} frames, {peaks[1]:6.0f} MiB over {long}"
            )
            print(f"  {tracker:12} {figures} ({grown:+.0f})")


PARTS = {
    "pictures": pictures,
    "detections": detections,
    "targets": targets,
    "lengths": lengths,
    "sizes": sizes,
    "memory": memory,
}


def main(words: Sequence[str] | None = None) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("parts", nargs="*", choices=[*PARTS, []], help="default: all")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--rows", type=int, help="height of the pictures of `pictures`, 4:3"
    )
    parser.add_argument(
        "--quick", action="store_true", help="one round, shorter recordings"
    )
    parser.add_argument(
        "-o",
        "--output",
        type=Path,
        metavar="FILE",
        help="plots, as FILE_targets.png",
    )
    args = parser.parse_args(words)
    if args.quick:
        args.rounds = 1
    load = (
        ", ".join(f"{x:.1f}" for x in os.getloadavg())
        if hasattr(os, "getloadavg")
        else "unknown"
    )
    print(f"{os.cpu_count()} processors, load {load}, {args.rounds} rounds by turns")
    with tempfile.TemporaryDirectory() as name:
        for part in args.parts or PARTS:
            print(f"{part}:", flush=True)
            PARTS[part](args, Path(name))


if __name__ == "__main__":
    main()
