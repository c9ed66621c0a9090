"""PETS09-S2L1 and TUD-Campus as other cameras would have seen them: mirrored, backwards, smaller,
darker, noisy, cut.

    python tests/benchmarks/bench_variants.py [pets] [pets-boxes] [tud] [tud-boxes] [flies]
                                              [--trackers events ...] [--only mirrored ...] [--set
                                              key=value ...]

Thresholds are chosen while looking at the recordings as they are. What holds for a variant as
well was not chosen for one recording's accidents; the mean and the worst over the variants say
more than the best line. None of them is a new scene: the people and their paths are the same.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Detections
from recorders.pictures import Image
from recorders.recording import RecordOptions, record
from recorders.sources import Source, SourceFrame, open_source
from recorders.sources.source import Rate, detections_of
from recorders.vision import cv2
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.evaluate import MotTable, evaluate, fit_truth, read_truth
from replay.evaluate.track_table import read_tracks
from replay.run import ReplayOptions
from replay.trackers.catalogue import TRACKERS

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
PETS, TUD, FLIES = DATA / "pets09-s2l1", DATA / "tud-campus", DATA / "flies"
Boxes = NDArray[np.float64]


@dataclass(frozen=True)
class Variant:
    """How a recording is altered.

    Attributes:
        mirrored: left is right.
        scale: of pictures and boxes.
        step: every so many frames; negative: backwards.
        part: the share of the recording where it begins, and where it ends.
        picture: what happens to each picture (its number seeds what is random), after scaling.
        boxes: what happens to each frame's detections, rows of x, y, w, h, score.
    """

    mirrored: bool = False
    scale: float = 1.0
    step: int = 1
    part: tuple[float, float] = (0.0, 1.0)
    picture: Callable[[Image, int], Image] = lambda image, _: image
    boxes: Callable[[Boxes, int], Boxes] = lambda boxes, _: boxes

    def order(self, count: int) -> list[int]:
        """The original's frames in the order in which the variant has them."""
        chosen = range(count)[round(self.part[0] * count) : round(self.part[1] * count)]
        return list(chosen[:: self.step])


def noisy(image: Image, number: int) -> Image:
    """Noise of 6 grey levels, another in each frame."""
    noise = np.random.default_rng(number).normal(0, 6, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def dark(image: Image, number: int) -> Image:
    """Six tenths of the light."""
    return np.asarray(cv2.convertScaleAbs(image, alpha=0.6), np.uint8)


def grey(image: Image, number: int) -> Image:
    """No colours."""
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


def thinned(boxes: Boxes, number: int) -> Boxes:
    """A tenth of the detections is missing."""
    return boxes[np.random.default_rng(number).random(len(boxes)) >= 0.1]


def shaken(boxes: Boxes, number: int) -> Boxes:
    """Place and size off by a standard deviation of 4 % of the box."""
    out = boxes.copy()
    out[:, :4] += np.random.default_rng(number).normal(0, 0.04, (len(boxes), 4)) * np.tile(
        boxes[:, 2:4], (1, 2)
    )
    out[:, 2:4] = np.maximum(out[:, 2:4], 1.0)
    return out


ALWAYS = {
    "as it is": Variant(),
    "mirrored": Variant(mirrored=True),
    "backwards": Variant(step=-1),
    "half the frames": Variant(step=2),
    "first half": Variant(part=(0, 0.5)),
    "second half": Variant(part=(0.5, 1)),
}
PIXELS = ALWAYS | {
    "smaller (0.7)": Variant(scale=0.7),
    "dark": Variant(picture=dark),
    "noisy": Variant(picture=noisy),
    "grey": Variant(picture=grey),
}
BOXES = ALWAYS | {
    "a tenth missing": Variant(boxes=thinned),
    "shaken": Variant(boxes=shaken),
}


class Altered:
    """A source as a variant has it; the original's pictures are kept in memory."""

    stills = False

    def __init__(self, source: Source, variant: Variant, fps: Fraction) -> None:
        self._source, self._variant = source, variant
        self._frames = [(f.image, f.detections) for f in source.frames()]
        self._order = variant.order(len(self._frames))
        self._rate = Rate(fps / abs(variant.step))
        self.path, self.name = source.path, source.name
        self.width, self.height = (
            round(source.width * variant.scale),
            round(source.height * variant.scale),
        )
        self.frame_ns = self._rate.frame_ns
        self.has_images, self.has_detections = source.has_images, source.has_detections
        self.total = len(self._frames)
        self.frame_count: int | None = len(self._order)
        self.notes: list[str] = []
        self.losses: list[str] = []

    def _picture(self, original: int) -> Image:
        image = self._frames[original][0]
        assert image is not None
        if self._variant.mirrored:
            image = np.asarray(cv2.flip(image, 1), np.uint8)
        if self._variant.scale != 1:
            size = (self.width, self.height)
            image = np.asarray(
                cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8
            )
        return self._variant.picture(image, original)

    def _detections(self, original: int, index: int) -> Detections | None:
        found = self._frames[original][1]
        if found is None:
            return None
        boxes = moved(
            np.array(found.boxes, np.float64).reshape(-1, 4),
            self._variant,
            self._source.width,
        )
        rows = self._variant.boxes(
            np.column_stack([boxes, found.scores]), original
        ).tolist()
        return detections_of(
            index,
            self.width,
            self.height,
            [tuple(r[:4]) for r in rows],
            [r[4] for r in rows],
        )

    def frames(self) -> Iterator[SourceFrame]:
        """All frames of the variant."""
        for index, original in enumerate(self._order):
            load = (lambda o=original: self._picture(o)) if self.has_images else None
            yield SourceFrame(
                index,
                self._rate.time_ns(index),
                load,
                detections=self._detections(original, index),
            )

    def sample(self, count: int) -> Iterator[Image]:
        """Pictures spread evenly."""
        which = (
            np.linspace(0, len(self._order) - 1, min(count, len(self._order)))
            .round()
            .astype(int)
        )
        return (self._picture(self._order[k]) for k in which.tolist())

    def digests(self) -> list[tuple[str, str]]:
        """Those of the original."""
        return self._source.digests()


def moved(boxes: Boxes, variant: Variant, width: int) -> Boxes:
    """Boxes (N, 4) of the original, ``width`` pixels wide, in the variant's pixels."""
    x = width - boxes[:, 0] - boxes[:, 2] if variant.mirrored else boxes[:, 0]
    return np.column_stack([x, boxes[:, 1:]]) * variant.scale


def truth_of(truth: MotTable, variant: Variant, frames: int, width: int) -> MotTable:
    """The truth as the variant has it: the same people, in other frames and places."""
    at = {original: k for k, original in enumerate(variant.order(frames))}
    kept = truth.select(np.array([f in at for f in truth.frames.tolist()], bool))
    boxes = moved(kept.boxes, variant, width)
    rows = zip(
        kept.frames.tolist(),
        kept.ids.tolist(),
        boxes.tolist(),
        kept.confidences.tolist(),
        strict=True,
    )
    return MotTable.from_rows([(at[f], i, *box, c) for f, i, box, c in rows])


@dataclass(frozen=True)
class Recording:
    """A recording with its truth.

    Attributes:
        source, truth: the files.
        fps: its rate.
        size: the size of a recording without pictures.
        truth_size: the picture size that the truth is made for, where it differs.
    """

    source: Path
    truth: Path
    fps: int
    size: tuple[int, int] | None = None
    truth_size: tuple[int, int] | None = None


RECORDINGS = {
    "pets": Recording(PETS / "video.avi", PETS / "gt.txt", 7, truth_size=(768, 576)),
    "pets-boxes": Recording(PETS / "det.txt", PETS / "gt.txt", 7, size=(768, 576)),
    "tud": Recording(TUD / "video.mp4", TUD / "gt.txt", 25),
    "tud-boxes": Recording(TUD / "det.txt", TUD / "gt.txt", 25, size=(640, 480)),
    "flies": Recording(FLIES / "three_flies.mp4", FLIES / "three_flies.gt.txt", 25),
}


def table(name: str, args: argparse.Namespace, folder: Path) -> None:
    """The variants of a recording, through each tracker."""
    r = RECORDINGS[name]
    source = open_source(r.source, fps=r.fps, size=r.size)
    truth = fit_truth(read_truth(r.truth), (source.width, source.height), r.truth_size)
    variants = PIXELS if source.has_images else BOXES
    scores: dict[str, list[tuple[float, float, float, float]]] = {
        t: [] for t in args.trackers
    }
    print(
        f"\n{name}: HOTA / MOTA / IDF1 / switches\n{'':18}"
        + "".join(f"{t:^27}" for t in args.trackers)
    )
    for label, variant in variants.items():
        if args.only and label not in args.only:
            continue
        altered = Altered(source, variant, Fraction(r.fps))
        scene = folder / "scene.mcap"
        record(
            altered,
            scene,
            RecordOptions(codec="png" if source.has_images else None, force=True),
        )
        wanted = truth_of(truth, variant, altered.total, source.width)
        for tracker in args.trackers:
            config = replay_config(tracker, assignments=args.set)
            out = folder / "annotated.mcap"
            replay(scene, out, ReplayOptions(tracker=tracker, config=config, force=True))
            with AnnotatedLog(out) as log:
                s = evaluate(wanted, read_tracks(log).table)
            scores[tracker].append(
                (s.hota.hota, s.clear.mota, s.identity.idf1, float(s.clear.switches))
            )
        print(
            f"{label:18}" + "".join(line(scores[t][-1]) for t in args.trackers), flush=True
        )
    for label, summary in (("mean", np.mean), ("worst", worst)):
        print(
            f"{label:18}"
            + "".join(line(summary(np.array(scores[t]), axis=0)) for t in args.trackers)
        )


def worst(values: np.ndarray, axis: int) -> np.ndarray:
    """The lowest scores and the most switches."""
    return np.append(values[:, :3].min(axis=axis), values[:, 3].max())


def line(values: Iterable[float]) -> str:
    """One cell."""
    hota, mota, idf1, switches = values
    return f"{hota:7.1f}{mota:7.1f}{idf1:7.1f}{switches:5.0f} "


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("names", nargs="*", choices=[*RECORDINGS, []], help="default: all")
    parser.add_argument(
        "--trackers", nargs="+", choices=tuple(TRACKERS), default=list(TRACKERS)
    )
    parser.add_argument(
        "--only", nargs="+", choices=tuple(PIXELS | BOXES), help="these variants"
    )
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="KEY=VALUE", help="parameters of the replay"
    )
    args = parser.parse_args()
    for name in args.names or RECORDINGS:
        if not RECORDINGS[name].source.exists():
            print(f"{name}: skipped, {RECORDINGS[name].source} is not there")
            continue
        with tempfile.TemporaryDirectory() as folder:
            table(name, args, Path(folder))


if __name__ == "__main__":
    main()
