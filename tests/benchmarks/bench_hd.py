"""1080p25 on two cores: at what rate pictures are recorded with a network that looks at them, and
replayed, and what limits.

    python tests/benchmarks/bench_hd.py [--model FILE.onnx] [--frames 300] [--rounds 2]

PETS, brought to 1920 x 1080 (its sides mirrored) and encoded as a camera does (H.264). Processor time,
which other load disturbs less than the clock: of all threads, and of the main one. What is done once
(a background is learnt from pictures all over) is told apart by a film of a third of the length. Two
cores cannot do more than the larger of the main thread's share and half of everything takes.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import av
from bench_replay import run as replayed

from recorders.detectors.onnx import ModelOptions
from recorders.recording import RecordOptions, record
from recorders.segmentation.segmenter import as_image
from recorders.sources import open_source
from recorders.vision import cv2

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
WIDTH, HEIGHT, SIDE = 1920, 1080, 240


def film(video: Path, out: Path, frames: int) -> Path:
    """Frames of a video from the hundredth on, at 1080p25 in H.264."""
    reader = cv2.VideoCapture(str(video))
    reader.set(cv2.CAP_PROP_POS_FRAMES, 100)
    with av.open(str(out), "w") as file:
        stream: Any = file.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.options = {"preset": "veryfast", "crf": "20"}
        for _ in range(frames):
            image = cv2.resize(
                reader.read()[1], (WIDTH - 2 * SIDE, HEIGHT), interpolation=cv2.INTER_CUBIC
            )
            image = cv2.copyMakeBorder(image, 0, 0, SIDE, SIDE, cv2.BORDER_REFLECT)
            picture: Any = av.VideoFrame.from_ndarray(as_image(image), format="bgr24")
            file.mux(stream.encode(picture))
        file.mux(stream.encode())
    return out


@dataclass(frozen=True)
class Cost:
    """Seconds of processor: of all threads, and of the main one."""

    everything: float
    main: float


def least(call: Callable[[], int], before: Cost | None) -> Cost:
    """What a run takes, or took before if that was less."""
    everything, main = time.process_time(), time.thread_time()
    call()
    cost = Cost(time.process_time() - everything, time.thread_time() - main)
    return cost if before is None or cost.everything < before.everything else before


def measured(runs: dict[str, list[Callable[[], int]]], frames: int, rounds: int) -> None:
    """Print the least of some rounds of each run, by turns, over a third of the frames and over all
    of them.
    """
    costs: dict[str, list[Cost | None]] = {label: [None, None] for label in runs}
    for _ in range(rounds):
        for label, calls in runs.items():
            costs[label] = [
                least(call, cost) for call, cost in zip(calls, costs[label], strict=True)
            ]
    more = frames - frames // 3
    for label, (short, long) in costs.items():
        assert short is not None
        assert long is not None
        everything = (long.everything - short.everything) / more
        main = (long.main - short.main) / more
        once = long.everything - everything * frames
        limit = "the main thread" if main > everything / 2 else "all work together"
        print(
            f"{label:32} {once:5.2f} s once and {1e3 * everything:6.1f} ms of processor a frame,"
            f" main thread {1e3 * main:5.1f}: two cores"
            f" {1 / max(main, everything / 2):5.1f} frames/s ({limit}), one"
            f" {1 / everything:5.1f}",
            flush=True,
        )


def main() -> None:
    """Record and replay at 1080p."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", type=Path, default=DATA / "models" / "fastestdet.onnx")
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument("--rounds", type=int, default=2)
    args = parser.parse_args()
    video = DATA / "pets09-s2l1" / "video.avi"
    if not video.exists() or not args.model.exists():
        print(f"skipped: {video} or {args.model} is not there")
        return
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        films = [
            film(video, folder / f"{n}.mp4", n) for n in (args.frames // 3, args.frames)
        ]
        scenes = [folder / "short.mcap", folder / "long.mcap"]
        model = ModelOptions(args.model)

        def recorded(detect: str, codec: str | None) -> list[Callable[[], int]]:
            options = RecordOptions(
                detect=detect,
                codec=codec,
                model=model if "onnx" in detect else None,
                force=True,
            )
            return [
                lambda source=source, scene=scene: (  # type: ignore[misc]
                    record(open_source(source), scene, options).frames
                )
                for source, scene in zip(films, scenes, strict=True)
            ]

        runs = {
            f"record --detect {detect}{'' if codec is None else f' --codec {codec}'}": recorded(
                detect, codec
            )
            for detect, codec in (
                ("none", None),
                ("onnx", None),
                ("motion", None),
                ("motion,onnx", "none"),
                ("motion,onnx", None),
            )
        }
        runs |= {
            "replay (events) of the last": [
                replayed(scene, folder, "events") for scene in scenes
            ]
        }
        measured(runs, args.frames, args.rounds)


if __name__ == "__main__":
    main()
