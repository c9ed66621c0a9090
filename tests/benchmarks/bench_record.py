"""`record` against a bare OpenCV loop on the same video, in one process, by turns.

    python tests/benchmarks/bench_record.py [VIDEO] [--rows 360] [--rounds N]

The bare loop decodes, subtracts the background (MOG2), cleans and labels; it writes nothing.
`record` decodes twice (once for its background in hindsight), segments, encodes pictures and
masks, and writes a log.
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from recorders.recording import RecordOptions, record
from recorders.sources import open_source
from recorders.vision import cv2

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))


def bare_loop(video: Path) -> int:
    """What anybody writes first: decode, MOG2, opening, closing, connected components."""
    reader = cv2.VideoCapture(str(video))
    background = cv2.createBackgroundSubtractorMOG2(detectShadows=True)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))
    frames = 0
    while True:
        there, image = reader.read()
        if not there:
            return frames
        mask = cv2.threshold(background.apply(image), 200, 255, cv2.THRESH_BINARY)[1]
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel)
        cv2.connectedComponentsWithStats(mask, connectivity=8)
        frames += 1


def resized(video: Path, out: Path, height: int, frames: int) -> Path:
    """Frames of a video from the hundredth on, 4:3 and so many rows high, as motion JPEG."""
    reader = cv2.VideoCapture(str(video))
    reader.set(cv2.CAP_PROP_POS_FRAMES, 100)
    shape = (4 * round(height / 3), height)
    writer = cv2.VideoWriter(str(out), cv2.VideoWriter.fourcc(*"MJPG"), 7.0, shape)
    for _ in range(frames):
        there, image = reader.read()
        if not there:
            break
        writer.write(cv2.resize(image, shape, interpolation=cv2.INTER_AREA))
    writer.release()
    return out


def recorder(video: Path, folder: Path, options: RecordOptions) -> Callable[[], int]:
    """A run of `record` into a fresh file."""

    def run() -> int:
        return record(open_source(video), folder / "scene.mcap", options).frames

    return run


def measured(run: Callable[[], int]) -> tuple[float, float]:
    """Frames per second of one run by the clock, and by the processor time of all its threads."""
    clock, processor = time.perf_counter(), time.process_time()
    frames = run()
    return frames / (time.perf_counter() - clock), frames / (
        time.process_time() - processor
    )


def main() -> None:
    """Print frames per second and the ratios to the bare loop, medians over the rounds."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "video", type=Path, nargs="?", default=DATA / "pets09-s2l1" / "video.avi"
    )
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument(
        "--rows", type=int, help="height to which the pictures are brought, 4:3"
    )
    args = parser.parse_args()
    if not args.video.exists():
        print(f"skipped: {args.video} is not there")
        return
    with tempfile.TemporaryDirectory() as name:
        if args.rows:
            args.video = resized(args.video, Path(name) / "video.avi", args.rows, 400)
        runs: dict[str, Callable[[], int]] = {
            "bare OpenCV loop": lambda: bare_loop(args.video)
        }
        for label, options in {
            "record": RecordOptions(force=True),
            "record --codec h264": RecordOptions(codec="h264", force=True),
            "record --codec none": RecordOptions(codec="none", force=True),
            "record --detect none": RecordOptions(detect="none", force=True),
        }.items():
            runs[label] = recorder(args.video, Path(name), options)
        rates: dict[str, list[tuple[float, float]]] = {label: [] for label in runs}
        for _ in range(args.rounds):
            for label, run in runs.items():
                rates[label].append(measured(run))
    base = rates["bare OpenCV loop"]
    print(
        f"{args.video.name}, {args.rounds} rounds by turns, OpenCV threads:"
        f" {cv2.getNumThreads()}"
    )
    for label, values in rates.items():
        pairs = list(zip(values, base, strict=True))
        clock, processor = (
            statistics.median(v[k] / b[k] for v, b in pairs) for k in (0, 1)
        )
        rate = statistics.median(v[0] for v in values)
        print(
            f"{label:22} {rate:7.0f} frames/s   {clock:5.2f} x by the clock  "
            f" {processor:5.2f} x by processor time"
        )


if __name__ == "__main__":
    main()
