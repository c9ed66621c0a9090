"""What the segmentation finds on the real recordings, and what it costs beside a bare OpenCV loop.

    python tests/benchmarks/bench_segmentation.py            all recordings
    python tests/benchmarks/bench_segmentation.py pets --every 2

Precision and recall: boxes matched to the truth frame by frame, as many as can be at IoU 0.5 and
0.3 (truth rows with conf 0 left out). Speed: the median time of a frame against that of MOG2,
opening and closing, and connected components with statistics on the same frames, the two taking
turns, with one thread.
"""

from __future__ import annotations

import argparse
import os
import statistics
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from recorders.pictures import Image
from recorders.segmentation import SEGMENTERS, SegmentationParameters, Segmenter
from recorders.sources import open_source
from recorders.vision import cv2

ROOT = Path(__file__).resolve().parent.parent.parent
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))

Boxes = NDArray[np.float64]


@dataclass(frozen=True)
class Recording:
    path: str
    fps: float
    detect: str
    truth: str | None = None
    scale: float = 1.0


RECORDINGS = {
    "pets": Recording("pets09-s2l1/video.avi", 7, "motion", "pets09-s2l1/gt.txt", 0.625),
    "pets-full": Recording("pets09-s2l1/img1", 7, "motion", "pets09-s2l1/gt.txt"),
    "tud": Recording("tud-campus/video.mp4", 25, "motion", "tud-campus/gt.txt"),
    "corridor": Recording("caviar-corridor/OneLeaveShopReenter1cor.mpg", 25, "motion"),
    "two-flies": Recording(
        "flies/two_flies.mp4", 25, "threshold", "flies/two_flies.gt.txt"
    ),
    "three-flies": Recording(
        "flies/three_flies.mp4", 25, "threshold", "flies/three_flies.gt.txt"
    ),
}


def read_truth(recording: Recording) -> dict[int, Boxes]:
    rows: dict[int, list[list[float]]] = {}
    if recording.truth is not None:
        for line in (DATA / recording.truth).read_text().splitlines():
            v = [float(x) for x in line.split(",")]
            if v[6] != 0:
                rows.setdefault(int(v[0]) - 1, []).append(
                    [recording.scale * x for x in v[2:6]]
                )
    return {k: np.array(v) for k, v in rows.items()}


def iou(a: Boxes, b: Boxes) -> Boxes:
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    both = np.prod(np.maximum(high - low, 0), axis=2)
    each = np.prod(a[:, 2:], axis=1)[:, None] + np.prod(b[:, 2:], axis=1)[None]
    return np.asarray(both / (each - both))


def precision_recall(
    found: dict[int, Boxes], truth: dict[int, Boxes], least: float
) -> tuple[float, float]:
    hits = boxes = wanted = 0
    for index, own in found.items():
        real = truth.get(index, np.zeros((0, 4)))
        boxes, wanted = boxes + len(own), wanted + len(real)
        if len(own) and len(real):
            overlap = iou(own, real)
            rows, columns = linear_sum_assignment(
                np.where(overlap >= least, -10 - overlap, 0.0)
            )
            hits += int((overlap[rows, columns] >= least).sum())
    return 100 * hits / max(boxes, 1), 100 * hits / max(wanted, 1)


def bare_loop() -> Callable[[Image], object]:
    """What one writes with OpenCV alone: MOG2 with shadows, opening and closing, components with
    statistics.
    """
    subtractor = cv2.createBackgroundSubtractorMOG2(detectShadows=True)
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (3, 3))

    def step(image: Image) -> object:
        mask = cv2.compare(subtractor.apply(image), np.array(200.0), cv2.CMP_GT)
        mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
        mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, kernel)
        return cv2.connectedComponentsWithStats(mask, connectivity=8)

    return step


def run(segmenter: Segmenter, images: list[Image]) -> tuple[dict[int, Boxes], float, float]:
    """Boxes by frame, and the median ms of a frame of the segmenter and of the bare loop."""
    bare = bare_loop()
    found: dict[int, Boxes] = {}
    own: list[float] = []
    other: list[float] = []
    for index, image in enumerate(images):
        start = time.perf_counter()
        detections = segmenter.segment(index, image).detections
        middle = time.perf_counter()
        bare(image)
        other.append(time.perf_counter() - middle)
        own.append(middle - start)
        found[index] = np.array(detections.boxes, np.float64).reshape(-1, 4)
    return found, 1000 * statistics.median(own), 1000 * statistics.median(other)


def measure(name: str, detect: str | None, every: int, live: bool) -> None:
    recording = RECORDINGS[name]
    images = []
    for frame in open_source(DATA / recording.path, fps=recording.fps).frames():
        assert frame.image is not None
        images.append(frame.image)
    images = images[::every]
    truth = {k // every: v for k, v in read_truth(recording).items() if k % every == 0}
    height, width = images[0].shape[:2]
    kind = detect or recording.detect
    segmenter = SEGMENTERS[kind](
        SegmentationParameters(), width, height, recording.fps / every
    )
    start = time.perf_counter()
    if not live:
        segmenter.prepare(iter(images))
    first = time.perf_counter() - start
    found, own, bare = run(segmenter, images)
    scores = "no truth"
    if truth:
        at = {t: precision_recall(found, truth, t) for t in (0.5, 0.3)}
        scores = "  ".join(
            f"IoU {t}: precision {p:4.1f} recall {r:4.1f}" for t, (p, r) in at.items()
        )
    boxes = sum(map(len, found.values())) / len(found)
    print(
        f"{name:12s} {kind:9s} {'live' if live else 'hindsight':9s} {width}x{height}"
        f" {scores}  {boxes:.1f} boxes/frame"
    )
    print(
        f"{'':12s} first reading {first:.2f} s; {own:.2f} ms/frame, bare loop {bare:.2f}:"
        f" {bare / own:.2f} x its speed"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names", nargs="*", choices=[[], *RECORDINGS], help="recordings; all by default"
    )
    parser.add_argument(
        "--detect", choices=sorted(SEGMENTERS), help="instead of the recording's usual one"
    )
    parser.add_argument("--every", type=int, default=1, help="take every n-th frame")
    parser.add_argument("--live", action="store_true", help="without a first reading")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    for name in arguments.names or RECORDINGS:
        measure(name, arguments.detect, arguments.every, arguments.live)


if __name__ == "__main__":
    main()
