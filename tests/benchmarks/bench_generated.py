"""Generated scenes that segmentation finds hard, as good and as bad cameras store them: scores of
every kind under every variation, mean and worst.

    python tests/benchmarks/bench_generated.py                        the whole table
    python tests/benchmarks/bench_generated.py hall left_bag          two kinds under all variations
    python tests/benchmarks/bench_generated.py --variations noise     all kinds under one
    python tests/benchmarks/bench_generated.py hall --variations noise --keep /tmp/hall
    python tests/benchmarks/bench_generated.py --set events.gate=4    with another parameter

What is played is `fixtures/surroundings.py`; the truth is exact, to the pixel. The truth's rows of
bodies of which under a quarter can be seen are not asked for; what leaves cover counts as seen.
Each line: HOTA, MOTA and IDF1 in percent (matched at IoU 0.5), tracks found for bodies that are
there, the share of frames without a known view, and what the recording says of itself (`quality`,
row overall: G good, F fair, P poor). A figure under 0 is marked with ``!``. At the end, the mean
and the worst of each kind over the variations, and of each variation over the kinds.

The pictures are made once and kept in a temporary folder (--videos), by the digest of the code
that makes them: about 3 GB. One run of one kind takes some 6 s.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from bench_scenes import RECORDING, in_sections, run

from fixtures.logs import truth_mot_rows
from fixtures.surroundings import SURROUNDED, SurroundedScene, surrounded
from recorders.log.info import inspect
from recorders.pictures import Image
from recorders.quality import recorded_quality
from replay.cli.common import progress
from replay.evaluate import MotTable, evaluate, read_truth

ROOT = Path(__file__).resolve().parents[2]
LEAST_SEEN = 0.25
"""Who can be seen less is not asked for."""
GREY = 110
"""Half of the contrast is that around this level."""


def _half_contrast(image: Image, _: int) -> Image:
    return np.rint(GREY + (image.astype(np.float64) - GREY) / 2).astype(np.uint8)


def _noise(image: Image, number: int) -> Image:
    noise = np.random.default_rng(number).normal(0, 9, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


@dataclass(frozen=True)
class Variation:
    """How a scene is played and stored.

    Attributes:
        codec, options: of the video.
        suffix: the kind of file.
        picture: (H, W, 3) uint8 BGR and the frame's number -> the picture as the camera sees it.
        scale: of the picture's sides.
        seed: of the scene.
    """

    codec: str = "ffv1"
    options: tuple[tuple[str, str], ...] = ()
    suffix: str = ".mkv"
    picture: Callable[[Image, int], Image] = lambda image, _: image
    scale: float = 1.0
    seed: int = 1


def _quantiser(scale: int) -> tuple[tuple[str, str], ...]:
    """One scale throughout, 1 (best) to 31: what ``-q:v`` says on ffmpeg's command line."""
    return ("qmin", str(scale)), ("qmax", str(scale))


VARIATIONS: dict[str, Variation] = {
    "as is": Variation(),
    "seed 2": Variation(seed=2),
    "seed 3": Variation(seed=3),
    "half contrast": Variation(picture=_half_contrast),
    "noise": Variation(picture=_noise),
    "crf 28": Variation("libx264", (("crf", "28"),)),
    "mpeg-1": Variation("mpeg1video", _quantiser(8), ".mpg"),
    "mjpeg": Variation("mjpeg", _quantiser(20), ".avi"),
    "small": Variation(scale=0.6),
}
"""By name. `noise` is of 9 levels, `small` .6 of the size."""
PIXELS = {"ffv1": "bgr0", "mjpeg": "yuvj420p"}
"""How a codec stores pixels, where not as ``yuv420p``."""


@dataclass(frozen=True)
class Outcome:
    """What one recording comes to: scores in percent, tracks and bodies, and what it says."""

    scores: tuple[float, float, float]
    tracks: int
    bodies: int
    unseen: float
    verdict: str

    def __str__(self) -> str:
        figures = "".join(f"{v:7.1f}{'!' if v < 0 else ' '}" for v in self.scores)
        return (
            f"{figures}{self.tracks:4d} for {self.bodies}{self.unseen:7.2f} {self.verdict}"
        )


# -- pictures ------------------------------------------------------------------------------------


def made_by() -> str:
    """The digest of the code that makes pictures."""
    digest = hashlib.sha256(Path(__file__).read_bytes())
    for path in sorted((ROOT / "fixtures").glob("*.py")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


def played(kind: str, variation: Variation) -> SurroundedScene:
    """The scene."""
    wide, high = SURROUNDED[kind][0].size
    size = (
        2 * round(wide * variation.scale / 2),
        2 * round(high * variation.scale / 2),
    )
    return surrounded(kind, variation.seed, size=size)


def stored(kind: str, name: str, folder: Path) -> tuple[Path, Path]:
    """Video and truth, made where they are not there yet."""
    variation = VARIATIONS[name]
    video = folder / f"{kind} {name}{variation.suffix}".replace(" ", "-")
    truth = video.with_suffix(".txt")
    if not truth.exists():
        scene = played(kind, variation)
        unfinished = video.with_name(f"unfinished-{os.getpid()}-{video.name}")
        _encode(scene, variation, unfinished)
        unfinished.replace(video)
        rows = "".join(f"{row}\n" for row in truth_mot_rows(scene, min_visible=LEAST_SEEN))
        unfinished.write_text(rows, encoding="utf-8")
        unfinished.replace(truth)
    return video, truth


def _encode(scene: SurroundedScene, variation: Variation, path: Path) -> None:
    # MPEG-1 knows few rates; `record` is told the true one.
    rate = Fraction(25 if variation.codec == "mpeg1video" else scene.fps)
    options = {**dict(variation.options), "threads": "1"}
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(variation.codec, rate, options=options)
        stream.width, stream.height = scene.width, scene.height
        stream.pix_fmt = PIXELS.get(variation.codec, "yuv420p")
        for number, _, image in scene.frames():
            picture = np.ascontiguousarray(variation.picture(image, number))
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "bgr24")))
        container.mux(stream.encode())


# -- the product ---------------------------------------------------------------------------------


def measured(
    kind: str, name: str, args: argparse.Namespace, videos: Path, folder: Path
) -> Outcome:
    """Record, replay and score one kind under one variation."""
    video, truth_file = stored(kind, name, videos)
    fps = SURROUNDED[kind][0].fps
    log = folder / f"{kind} {name}.mcap".replace(" ", "-")
    words = in_sections(args.set, RECORDING)
    run("record", video, "-o", log, "--force", "--fps", str(fps), *words)
    out = log.with_suffix(".ann.mcap")
    others = [s for s in args.set if s.split(".")[0] not in RECORDING]
    words = [w for setting in others for w in ("--set", setting)]
    run("replay", log, "-o", out, "--force", "--tracker", args.tracker, *words)
    boxes = out.with_suffix(".txt")
    run("export", out, "--to", "mot", "-o", boxes, "--force")
    truth, found = read_truth(truth_file), MotTable.from_rows([])
    if boxes.read_text(encoding="utf-8"):
        found = read_truth(boxes)
    s = evaluate(truth, found)
    said = {
        m.name: m
        for rows in recorded_quality(inspect(log).metadata, log).values()
        for m in rows
    }
    return Outcome(
        (s.hota.hota, s.clear.mota, s.identity.idf1),
        len(set(found.ids.tolist())),
        len(set(truth.ids[truth.confidences > 0].tolist())),
        said["unseen_share"].value if "unseen_share" in said else 0.0,
        said["overall"].grade[0].upper() if "overall" in said else "-",
    )


def shown(rows: list[Outcome]) -> tuple[str, str]:
    """Mean and worst of some outcomes."""
    values = np.array([row.scores for row in rows])
    mean, worst = (
        "".join(f"{v:7.1f}{'!' if v < 0 else ' '}" for v in of)
        for of in (values.mean(0), values.min(0))
    )
    return mean, worst


def summary(found: dict[tuple[str, str], Outcome]) -> Iterator[str]:
    """Mean and worst over kinds, over variations, and over everything."""
    yield f"{'HOTA, MOTA, IDF1':30}{'mean':^24}  {'worst':^24}"
    for which in (0, 1):
        for name in dict.fromkeys(key[which] for key in found):
            rows = [row for key, row in found.items() if key[which] == name]
            yield f"{name:30}" + "  ".join(shown(rows))
    every = list(found.values())
    under = sum(row.scores[1] < 0 for row in every)
    yield f"{'all':30}" + "  ".join(shown(every)) + f"  {under} of {len(every)} under 0"


def arguments() -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "kinds",
        nargs="*",
        metavar="KIND",
        help=f"of {', '.join(SURROUNDED)}; default: all",
    )
    parser.add_argument(
        "--variations",
        nargs="+",
        choices=VARIATIONS,
        default=list(VARIATIONS),
        metavar="NAME",
        help=f"of {', '.join(VARIATIONS)}; default: all",
    )
    parser.add_argument("--tracker", default="events")
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="KEY=VALUE", help="of `scenetrace config`"
    )
    parser.add_argument(
        "--keep", type=Path, metavar="FOLDER", help="keep logs and tracks there"
    )
    parser.add_argument(
        "--videos",
        type=Path,
        metavar="FOLDER",
        default=Path(tempfile.gettempdir()) / "scenetrace-generated",
        help="where the pictures are kept (default: %(default)s)",
    )
    args = parser.parse_args()
    unknown = [kind for kind in args.kinds if kind not in SURROUNDED]
    if unknown:
        parser.error(f"no kind {unknown[0]!r}; there are: {', '.join(SURROUNDED)}")
    args.kinds = args.kinds or list(SURROUNDED)
    return args


def main() -> int:
    """Print the table."""
    args = arguments()
    videos = args.videos / made_by()
    videos.mkdir(parents=True, exist_ok=True)
    work = [(kind, name) for kind in args.kinds for name in args.variations]
    found: dict[tuple[str, str], Outcome] = {}
    print(f"{'':38}   HOTA    MOTA    IDF1   tracks unseen overall")
    with tempfile.TemporaryDirectory() as name, progress(len(work), "runs") as bar:
        folder = args.keep or Path(name)
        folder.mkdir(parents=True, exist_ok=True)
        for number, (kind, variation) in enumerate(work):
            bar("runs", number)
            row = found[kind, variation] = measured(kind, variation, args, videos, folder)
            print(f"{kind + ', ' + variation:38}{row}", flush=True)
    if len(found) > 1:
        print(*summary(found), sep="\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
