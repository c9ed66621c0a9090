"""Remake the part features that are shipped, byte for byte: what they are fitted on, and how.

    python tests/benchmarks/fit_features.py                      to the standard output
    python tests/benchmarks/fit_features.py --write              into the package
    python tests/benchmarks/fit_features.py --keep FOLDER        keep the recordings there

Three generated scenes with exact masks, and TUD-Campus with its labelled boxes. TUD's masks are
what differs from the median of its frames, made here, so that another segmentation of the product
does not make another fit. The fish, the trials and PETS09-S2L1 are not among them.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from fixtures.logs import write_scene_log, write_truth
from fixtures.scenes import generate
from recorders import channels
from recorders.log import LogWriter
from recorders.messages import Detections
from recorders.parameters import to_toml
from recorders.pictures import Image, encode_mask, encode_png
from recorders.segmentation.blobs import components
from recorders.sources import open_source
from recorders.vision import cv2
from replay.fitting import collect, fit
from replay.trackers.parts import scoring

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
TUD = DATA / "tud-campus"
SCENES = (("crowd", 1), ("crowd", 3), ("fight", 1))
DIFFERENT = 30
"""Grey levels in any channel by which a pixel differs from the median of all frames."""
SMALLEST = 200
"""Pixels of a blob."""


def generated(
    name: str, seed: int, folder: Path, frames: int | None = None
) -> tuple[Path, Path]:
    """A generated scene with exact masks, and its truth."""
    log, truth = folder / f"{name}-{seed}.mcap", folder / f"{name}-{seed}.txt"
    folder.mkdir(parents=True, exist_ok=True)
    if not truth.exists():
        scene = generate(name, seed=seed, frames=frames)
        write_scene_log(scene, log, style="merged", pictures="png", force=True)
        write_truth(scene, truth)
    return log, truth


def campus(folder: Path) -> tuple[Path, Path]:
    """TUD-Campus with masks of its frames' median, and its truth."""
    log = folder / "tud-campus.mcap"
    if not log.exists():
        source = open_source(TUD / "video.mp4")
        frames = [(f.time_ns, f.image) for f in source.frames() if f.image is not None]
        background = np.median(np.stack([i for _, i in frames]), axis=0).astype(np.uint8)
        with LogWriter(log) as writer:
            ids = {
                name: writer.channel(
                    channels.topic("camera", name),
                    channels.schema(name),
                    channels.message_encoding(name),
                )
                for name in ("image", "foreground", "detections")
            }
            for index, (now, image) in enumerate(frames):
                kept, _, blobs = components(moved(image, background), SMALLEST)
                found = Detections(index, source.width, source.height, components=blobs)
                mask = encode_mask(kept)
                png = encode_png(image)
                for name, data in (
                    ("image", channels.compressed_image(png, "png", now, "camera")),
                    ("foreground", channels.compressed_image(mask, "png", now, "camera")),
                    ("detections", channels.encode("detections", found)),
                ):
                    writer.write(ids[name], data, now)
            writer.metadata("scenetrace", {"source": "TUD-Campus"})
    return log, TUD / "gt.txt"


def moved(image: Image, background: Image) -> Image:
    """What differs from the background, (H, W) uint8 0 or 255: opened, then closed."""
    away = cv2.absdiff(image, background).max(axis=2)
    mask = np.where(away > DIFFERENT, 255, 0).astype(np.uint8)
    kernel = np.ones((3, 3), np.uint8)
    opened = cv2.morphologyEx(mask, cv2.MORPH_OPEN, kernel)
    closed = cv2.morphologyEx(opened, cv2.MORPH_CLOSE, np.ones((7, 7), np.uint8))
    return np.asarray(closed, np.uint8)


def fitted(pairs: Sequence[tuple[Path, Path]]) -> bytes:
    """The configuration file of a fit to recordings and their truths."""
    return to_toml({"part_features": fit(collect(pairs)).features}).encode()


def main() -> int:
    """Fit, and print or write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--write", action="store_true", help="replace the shipped file")
    parser.add_argument("--keep", type=Path, help="keep the recordings in this folder")
    args = parser.parse_args()
    with TemporaryDirectory() as name:
        folder = args.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        made = fitted([*(generated(*scene, folder) for scene in SCENES), campus(folder)])
    if args.write:
        scoring.SHIPPED.write_bytes(made)
    else:
        sys.stdout.buffer.write(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
