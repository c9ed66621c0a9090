"""Every scene with pictures and truth, by every tracker and input, as it is and disturbed: mean,
worst, and the peers.

    python tests/benchmarks/bench_scenes.py                              all scenes as they are
    python tests/benchmarks/bench_scenes.py pets highway --inputs pixels detector both
    python tests/benchmarks/bench_scenes.py --variants all --trackers events
    python tests/benchmarks/bench_scenes.py --vary hindsight             +-5 % of each parameter
    python tests/benchmarks/bench_scenes.py --loso events.gate 3 4 5     a value chosen without each scene
    python tests/benchmarks/bench_scenes.py --masks                      CDnet's masks alone
    python tests/benchmarks/bench_scenes.py --plain                      plain OpenCV pipelines anew

One configuration for all of them. ``scenes.json`` beside the recordings names the scenes, and what
the best of 24 plain OpenCV pipelines and the peers' trackers reach on each; a figure under theirs
is marked with ``<``. Scores are HOTA, MOTA and IDF1 in percent and identity switches, matched at
IoU 0.5, truth rows of confidence 0 dropped. The highway's truth has no cars above y = 60: what is
found there is ignored (`FAR`); the plain pipelines' figures in ``scenes.json`` do not ignore it.
"""

from __future__ import annotations

import argparse
import itertools
import json
import os
import shutil
import sys
import tempfile
import tomllib
from collections.abc import Callable, Iterator
from contextlib import redirect_stderr, redirect_stdout
from dataclasses import dataclass
from fractions import Fraction
from io import StringIO
from pathlib import Path
from typing import Any

import av
import numpy as np
from disturbances import DISTURBANCES, MOVED
from plain_sort import PlainSort

import replay.cli
from recorders.pictures import Image
from recorders.segmentation import SEGMENTERS, SegmentationParameters
from recorders.segmentation.usual import ious
from recorders.sources import open_source
from recorders.vision import cv2
from replay.evaluate import MotTable, evaluate, read_truth
from replay.evaluate.truth import fit_truth

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
MODEL = DATA / "models" / "fastestdet.onnx"
RECORDING = {"segmentation", "detector", "fusion"}
"""Sections of parameters that are asked when a scene is recorded."""
TRACKERS = ("events", "shells", "parts")
INPUTS = ("pixels", "detector", "both")
Scores = tuple[float, float, float, float]


@dataclass(frozen=True)
class Scene:
    """A scene of ``scenes.json``: paths, rate, and what others reach on it."""

    name: str
    video: Path
    truth: Path
    fps: int
    frames: int
    scale: float
    detect: str
    detector: bool
    plain: tuple[float, ...]
    peers: tuple[float, ...]


def scenes() -> list[Scene]:
    """The scenes that have pictures, in the file's order."""
    listed: dict[str, Any] = json.loads((DATA / "scenes.json").read_text(encoding="utf-8"))
    return [
        Scene(
            name,
            DATA.parent / entry["video"],
            DATA.parent / entry["gt"],
            entry["fps"],
            entry["frames"],
            entry.get("scale", 1.0),
            entry.get("detect", "motion"),
            bool(entry.get("detector")),
            tuple(entry.get("plain", ())),
            tuple(entry.get("peers fd", ())),
        )
        for name, entry in listed.items()
        if isinstance(entry, dict) and "video" in entry
    ]


# -- variants ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Variant:
    """How a scene's pictures are altered before they are recorded.

    Attributes:
        picture: (H, W, 3) uint8 BGR, the frame's number, number of frames -> altered picture.
        codec, options: how the altered video is stored.
        step: every so many frames are kept.
        part: the share of the scene that is kept, from its start.
        mirrored: left is right, for the truth as well.
        moved: how far the truth moves, see `disturbances.MOVED`; who then lies over the picture's
            edge, on both sides of it, is left out.
        parameters: of the recording, in place of a re-encoded video.
    """

    picture: Callable[[Image, int, int], Image] = lambda image, *_: image
    codec: str = "ffv1"
    options: tuple[tuple[str, str], ...] = ()
    step: int = 1
    part: float = 1.0
    mirrored: bool = False
    moved: Callable[[int, int, int], tuple[int, int]] = lambda *_: (0, 0)
    record: tuple[str, ...] = ()


def _mirror(image: Image, *_: int) -> Image:
    return np.ascontiguousarray(image[:, ::-1])


def _darker(image: Image, *_: int) -> Image:
    return np.asarray(cv2.convertScaleAbs(image, alpha=0.6), np.uint8)


def _noisier(image: Image, number: int, _: int) -> Image:
    noise = np.random.default_rng(number).normal(0, 6, image.shape)
    return np.clip(np.rint(image + noise), 0, 255).astype(np.uint8)


def _quality(scale: int) -> tuple[tuple[str, str], ...]:
    """MJPEG at one quantiser scale throughout, 2 (best) to 31: what ``-q:v`` says on ffmpeg's
    command line. The encoder by itself knows no such option.
    """
    return (("qmin", str(scale)), ("qmax", str(scale)))


AS_IS = "as is"
VARIANTS: dict[str, Variant] = {
    AS_IS: Variant(),
    "crf 10": Variant(codec="libx264", options=(("crf", "10"),)),
    "crf 23": Variant(codec="libx264", options=(("crf", "23"),)),
    "mjpeg": Variant(codec="mjpeg", options=_quality(3)),
    "coarse mjpeg": Variant(codec="mjpeg", options=_quality(25)),
    "png": Variant(record=("--codec", "png")),
    "half rate": Variant(step=2),
    "first half": Variant(part=0.5),
    "mirrored": Variant(_mirror, mirrored=True),
    "darker": Variant(_darker),
    "noisier": Variant(_noisier),
    **{
        name: Variant(picture, moved=MOVED.get(name, lambda *_: (0, 0)))
        for name, picture in DISTURBANCES.items()
    },
}


def altered(scene: Scene, variant: Variant, folder: Path) -> Path:
    """The scene's video as the variant has it."""
    source = open_source(scene.video, fps=scene.fps)
    kept = range(0, round(scene.frames * variant.part), variant.step)
    path = folder / ("altered.avi" if variant.codec == "mjpeg" else "altered.mkv")
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(
            variant.codec, Fraction(scene.fps, variant.step), options=dict(variant.options)
        )
        stream.width, stream.height = source.width, source.height
        formats = {"ffv1": "bgr0", "mjpeg": "yuvj420p"}
        stream.pix_fmt = formats.get(variant.codec, "yuv420p")
        for found in itertools.islice(source.frames(), scene.frames):
            if found.index not in kept or found.image is None:
                continue
            picture = variant.picture(found.image, found.index, scene.frames)
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), "bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def truth_of(scene: Scene, variant: Variant, size: tuple[int, int]) -> MotTable:
    """The truth as the variant has it, in the recording's pixels."""
    made_for = (round(size[0] * scene.scale), round(size[1] * scene.scale))
    table = fit_truth(read_truth(scene.truth), size, made_for)
    kept = range(0, round(scene.frames * variant.part), variant.step)
    rows = []
    for frame, identity, box, confidence in zip(
        table.frames.tolist(),
        table.ids.tolist(),
        table.boxes.tolist(),
        table.confidences.tolist(),
        strict=True,
    ):
        if frame in kept:
            x = size[0] - box[0] - box[2] if variant.mirrored else box[0]
            right, down = variant.moved(frame, scene.frames, size[0])
            x = (x + right) % size[0] if right else x
            if not right or x + box[2] <= size[0]:
                moved = (x, box[1] + down, *box[2:])
                rows.append((frame // variant.step, identity, *moved, confidence))
    return MotTable.from_rows(rows)


# -- the product ---------------------------------------------------------------------------------


def run(*words: str | Path) -> None:
    """One command of the product."""
    messages = StringIO()
    with redirect_stderr(messages):
        code = replay.cli.main([str(w) for w in words])
    if code not in (0, 3):
        said = messages.getvalue().strip()
        sys.exit(f"scenetrace {' '.join(map(str, words))}: exit {code}: {said}")


def input_words(scene: Scene, chosen: str) -> list[str]:
    """The options of `record` for an input."""
    if chosen == "pixels":
        return ["--detect", scene.detect]
    detect = "onnx" if chosen == "detector" else f"{scene.detect},onnx"
    return ["--detect", detect, "--model", str(MODEL), "--labels", "person"]


def recorded(
    scene: Scene, variant: Variant, chosen: str, settings: list[str], folder: Path
) -> Path:
    """The scene log."""
    plain = variant == Variant() or variant.record
    video = scene.video if plain else altered(scene, variant, folder)
    rate = Fraction(scene.fps, variant.step)
    log = folder / "scene.mcap"
    words = ["--fps", f"{float(rate):g}", *input_words(scene, chosen), *variant.record]
    run("record", video, "-o", log, "--force", *words, *settings)
    return log


FAR = {"highway": 62.0}
"""The truth of these scenes has only bodies whose lower edge lies under this y, px: what is found
farther off, and is nobody of the truth, is ignored.
"""


def without_far(found: MotTable, truth: MotTable, far: float) -> MotTable:
    """What was found without what lies farther off than the truth goes, unless it is in it."""
    rows = []
    for frame, identity, box, confidence in zip(
        found.frames.tolist(),
        found.ids.tolist(),
        found.boxes.tolist(),
        found.confidences.tolist(),
        strict=True,
    ):
        if box[1] + box[3] < far:
            there = truth.boxes[truth.frames == frame]
            if not len(there) or ious(np.array([box]), there).max() < 0.5:
                continue
        rows.append((frame, identity, *box, confidence))
    return MotTable.from_rows(rows)


def scored(
    log: Path,
    tracker: str,
    truth: MotTable,
    settings: list[str],
    out: Path,
    far: float = 0.0,
) -> Scores:
    """Replay and score."""
    run("replay", log, "-o", out, "--force", "--tracker", tracker, *settings)
    run("export", out, "--to", "mot", "-o", out.with_suffix(".txt"), "--force")
    s = evaluate(truth, without_far(read_truth(out.with_suffix(".txt")), truth, far))
    return s.hota.hota, s.clear.mota, s.identity.idf1, float(s.clear.switches)


def in_sections(settings: list[str], sections: set[str]) -> list[str]:
    """Those ``section.field=value`` that belong to some sections, as options."""
    words = []
    for setting in settings:
        if setting.split(".")[0] in sections:
            words += ["--set", setting]
    return words


def measure(
    scene: Scene,
    variant: Variant,
    chosen: str,
    args: argparse.Namespace,
    settings: list[str],
) -> dict[str, Scores]:
    """The scores of every tracker."""
    others = [s for s in settings if s.split(".")[0] not in RECORDING]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        words = in_sections(settings, RECORDING)
        if args.keep is None:
            log = recorded(scene, variant, chosen, words, folder)
        else:
            log = kept_log(args.keep, scene, variant, chosen, folder)
        return replayed(scene, variant, log, args, others, folder)


def kept_log(kept: Path, scene: Scene, variant: Variant, chosen: str, folder: Path) -> Path:
    """The scene log among those that are kept, recorded where it is not there yet."""
    name = next(name for name, v in VARIANTS.items() if v == variant)
    log = kept / f"{scene.name}, {chosen}, {name}.mcap"
    if not log.exists():
        kept.mkdir(parents=True, exist_ok=True)
        made = recorded(scene, variant, chosen, [], folder)
        part = log.with_suffix(".part")
        shutil.move(made, part)
        part.replace(log)
    return log


def replayed(
    scene: Scene,
    variant: Variant,
    log: Path,
    args: argparse.Namespace,
    settings: list[str],
    folder: Path,
) -> dict[str, Scores]:
    """The scores of every tracker on a scene log, replayed into a folder."""
    source = open_source(scene.video, fps=scene.fps)
    truth = truth_of(scene, variant, (source.width, source.height))
    words = [w for s in settings for w in ("--set", s)]
    out, far = folder / "annotated.mcap", FAR.get(scene.name, 0.0)
    return {t: scored(log, t, truth, words, out, far) for t in args.trackers}


def each_setting(
    chosen_scenes: list[Scene], args: argparse.Namespace, settings: list[str]
) -> Iterator[np.ndarray]:
    """The scores with no setting, then with each, (scenes, trackers, 4); NaN where it is refused.
    What only the replay asks is tried on logs that are recorded once.
    """
    with tempfile.TemporaryDirectory() as name:
        logs: dict[str, Path] = {}
        for setting in ["", *settings]:
            given = [setting] if setting else []
            anew = setting.split(".")[0] in RECORDING
            rows = []
            try:
                for scene in chosen_scenes:
                    if anew:
                        found = measure(scene, Variant(), "pixels", args, given)
                    else:
                        if scene.name not in logs:
                            folder = Path(name) / scene.name
                            folder.mkdir()
                            logs[scene.name] = recorded(
                                scene, Variant(), "pixels", [], folder
                            )
                        log = logs[scene.name]
                        found = replayed(scene, Variant(), log, args, given, log.parent)
                    rows.append([found[t] for t in args.trackers])
                yield np.array(rows)
            except SystemExit as e:
                print(f"{setting}: not taken: {e}")
                yield np.full((len(chosen_scenes), len(args.trackers), 4), np.nan)


# -- tables --------------------------------------------------------------------------------------


def cell(scores: Scores, bar: tuple[float, ...]) -> str:
    """Scores with a mark at those under the bar."""
    marks = [
        "<" if k < len(bar) and value < bar[k] else " "
        for k, value in enumerate(scores[:3])
    ]
    figures = "".join(f"{v:7.1f}{m}" for v, m in zip(scores[:3], marks, strict=True))
    return f"{figures}{scores[3]:5.0f}  "


def summary(rows: list[dict[str, Scores]], trackers: list[str], label: str) -> None:
    """Mean and worst."""
    for what in ("mean", "worst", "spread"):
        line = f"{label + ' ' + what:34}"
        for tracker in trackers:
            values = np.array([row[tracker] for row in rows])
            low = np.append(values[:, :3].min(0), values[:, 3].max())
            spread = np.ptp(values, axis=0)
            chosen = {"mean": values.mean(0), "worst": low, "spread": spread}[what]
            line += cell(tuple(chosen.tolist()), ())
        print(line)


def table(chosen_scenes: list[Scene], args: argparse.Namespace) -> None:
    """Every scene, input and variant."""
    names = list(VARIANTS) if "all" in args.variants else args.variants
    heads = "".join(f"{t:^31}" for t in args.trackers)
    print(f"{'HOTA MOTA IDF1 switches':34}{heads}")
    every: dict[str, list[dict[str, Scores]]] = {}
    for scene in chosen_scenes:
        for chosen in args.inputs:
            if chosen != "pixels" and not scene.detector:
                continue
            bar = scene.plain if chosen == "pixels" else scene.peers
            rows = []
            for name in names:
                rows.append(measure(scene, VARIANTS[name], chosen, args, args.set))
                cells = "".join(cell(rows[-1][t], bar) for t in args.trackers)
                print(f"{scene.name + ', ' + chosen + ', ' + name:34}{cells}", flush=True)
            every.setdefault(chosen, []).extend(rows)
            if len(rows) > 1:
                summary(rows, args.trackers, f"{scene.name}, {chosen}")
    for chosen, rows in every.items():
        if len(rows) > 1:
            summary(rows, args.trackers, f"all, {chosen}")


def numbers(section: str) -> Iterator[tuple[str, float]]:
    """The fields of a section that are numbers other than 0, with their defaults."""
    text = StringIO()
    with redirect_stdout(text):
        replay.cli.main(["config"])
    for name, value in tomllib.loads(text.getvalue())[section].items():
        if isinstance(value, int | float) and not isinstance(value, bool) and value:
            yield f"{section}.{name}", float(value)


def vary(chosen_scenes: list[Scene], args: argparse.Namespace) -> None:
    """What 5 % more and less of each parameter do to the mean over the scenes."""
    settings = []
    for name, value in numbers(args.vary):
        for factor in (0.95, 1.05):
            given = value * factor
            whole = value.is_integer() and abs(value) >= 10
            settings.append(f"{name}={round(given) if whole else given!r}")
    found = each_setting(chosen_scenes, args, settings)
    base = next(found).mean(0)
    print(f"{'as is':46}" + "".join(cell(tuple(v), ()) for v in base.tolist()))
    most = np.zeros(3)
    for setting, rows in zip(settings, found, strict=True):
        moved = rows.mean(0) - base
        if not np.isnan(moved).any():
            most = np.maximum(most, np.abs(moved[:, :3]).max(0))
            cells = "".join(cell(tuple(v), ()) for v in moved.tolist())
            print(f"{setting:46}{cells}", flush=True)
    print(f"{'at most':46}" + "".join(f"{v:7.2f} " for v in most))


def loso(chosen_scenes: list[Scene], args: argparse.Namespace) -> None:
    """A parameter's value as each scene would have it chosen by the others: the best mean of
    HOTA and IDF1 (of equals the first).
    """
    name, *values = args.loso
    found = each_setting(chosen_scenes, args, [f"{name}={v}" for v in values])
    next(found)
    scores = np.array([rows[:, 0] for rows in found])
    worth = np.nan_to_num(scores[:, :, 0] + scores[:, :, 2], nan=-np.inf)
    for value, of_value in zip(values, scores, strict=True):
        print(f"{name + '=' + value:34}{cell(tuple(of_value.mean(0).tolist()), ())}mean")
    left_out = []
    for k, scene in enumerate(chosen_scenes):
        others = np.delete(worth, k, axis=1).mean(axis=1)
        best = int(others.argmax())
        left_out.append(scores[best, k])
        print(
            f"without {scene.name:26}{cell(tuple(left_out[-1].tolist()), ())}{values[best]}"
        )
    print(
        f"{'mean of those left out':34}{cell(tuple(np.mean(left_out, axis=0).tolist()), ())}"
    )


def masks() -> None:
    """Precision, recall and F of the foreground on CDnet's highway, beside MOG2 and KNN.

    Pixels of grey 85 and 170 are not scored; 50 (shadow) counts as ground, as CDnet does.
    """
    folder = DATA / "scenes" / "cdnet-highway"
    scene = next(s for s in scenes() if s.name == "highway")
    frames = open_source(scene.video, fps=scene.fps).frames()
    pictures = [f.image for f in frames if f.image is not None]
    truth = {int(p.stem.strip("gtin")): p for p in sorted((folder / "masks").iterdir())}
    height, width = pictures[0].shape[:2]
    for name in ("motion", "density", "mog2", "knn"):
        counts = np.zeros(3)
        if name in SEGMENTERS:
            segmenter = SEGMENTERS[name](SegmentationParameters(), width, height, scene.fps)
            segmenter.prepare(iter(pictures))
        else:
            plain = {
                "mog2": cv2.createBackgroundSubtractorMOG2,
                "knn": cv2.createBackgroundSubtractorKNN,
            }
            subtractor = plain[name]()
        for index, image in enumerate(pictures):
            if name in SEGMENTERS:
                mask = segmenter.segment(index, image).mask
            else:
                mask = np.where(subtractor.apply(image) == 255, 255, 0).astype(np.uint8)
                mask = np.asarray(cv2.medianBlur(mask, 5), np.uint8)
            if index + 1 in truth:
                true = np.asarray(cv2.imread(str(truth[index + 1]), cv2.IMREAD_GRAYSCALE))
                scored_ = (true != 85) & (true != 170)
                moving, found = (true == 255) & scored_, (mask > 0) & scored_
                counts += [(moving & found).sum(), found.sum(), moving.sum()]
        precision, recall = counts[0] / counts[1], counts[0] / counts[2]
        f = 2 * precision * recall / (precision + recall)
        print(f"{name:10} precision {precision:.3f}  recall {recall:.3f}  F {f:.3f}")


def plain(chosen_scenes: list[Scene]) -> None:
    """Plain OpenCV pipelines: MOG2 or KNN, four morphologies, SORT."""
    for scene in chosen_scenes:
        source = open_source(scene.video, fps=scene.fps)
        truth = truth_of(scene, Variant(), (source.width, source.height))
        best = np.full(3, -np.inf)
        for subtractor, (opening, closing) in itertools.product(
            ("MOG2", "KNN"), ((0, 5), (3, 5), (3, 9), (5, 15))
        ):
            found: list[Any] = list(
                plain_rows(source.frames(), scene, subtractor, opening, closing)
            )
            s = evaluate(truth, MotTable.from_rows(found))
            scores = (s.hota.hota, s.clear.mota, s.identity.idf1)
            best = np.maximum(best, scores)
        print(
            f"{scene.name:14} best of 8, each its own: {best.round(1).tolist()}", flush=True
        )


def plain_rows(
    frames: Iterator[Any], scene: Scene, name: str, opening: int, closing: int
) -> Iterator[tuple[float, ...]]:
    """MOTChallenge rows of one pipeline."""
    subtractor = getattr(cv2, f"createBackgroundSubtractor{name}")()
    tracker = PlainSort()
    for found in itertools.islice(frames, scene.frames):
        mask = np.where(subtractor.apply(found.image) == 255, 255, 0).astype(np.uint8)
        for size, operation in ((opening, cv2.MORPH_OPEN), (closing, cv2.MORPH_CLOSE)):
            if size:
                shape = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
                mask = np.asarray(cv2.morphologyEx(mask, operation, shape), np.uint8)
        stats = cv2.connectedComponentsWithStats(mask)[2][1:]
        boxes = stats[stats[:, 4] >= 0.001 * mask.size, :4].astype(np.float64)
        for identity, box in tracker.step(boxes):
            yield (found.index, identity, *box, 1.0)


def main() -> None:
    """Print what is asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if not (DATA / "scenes.json").exists():
        print(f"scenes: skipped, {DATA / 'scenes.json'} is not there")
        return
    known = {s.name: s for s in scenes()}
    parser.add_argument("names", nargs="*", metavar="SCENE", help=f"of {', '.join(known)}")
    parser.add_argument("--trackers", nargs="+", default=list(TRACKERS))
    parser.add_argument("--inputs", nargs="+", choices=INPUTS, default=["pixels"])
    parser.add_argument(
        "--variants",
        nargs="+",
        choices=(*VARIANTS, "all"),
        default=[AS_IS],
        metavar="VARIANT",
    )
    parser.add_argument("--set", nargs="+", default=[], metavar="KEY=VALUE")
    parser.add_argument(
        "--keep",
        type=Path,
        metavar="FOLDER",
        help="scene logs are kept here, and what is here is not recorded again: for a change of"
        " a tracker alone",
    )
    parser.add_argument(
        "--vary",
        metavar="SECTION",
        help="+-5 %% of each of its parameters. Campus and the cyclists take about 4 s a setting"
        " and tracker of processor time (hindsight: 40 settings), all scenes 70 s; parameters of"
        " the recording 10 s and 200 s",
    )
    parser.add_argument(
        "--loso",
        nargs="+",
        metavar=("SECTION.FIELD", "VALUE"),
        help="a value chosen on all scenes but one, and what that one has with it; the first"
        " tracker alone, as long as --vary",
    )
    parser.add_argument("--masks", action="store_true", help="CDnet's masks alone")
    parser.add_argument("--plain", action="store_true", help="plain pipelines anew")
    args = parser.parse_args()
    for name in args.names:
        if name not in known:
            parser.error(f"no scene {name!r}; there are: {', '.join(known)}")
    if args.keep is not None and in_sections(args.set, RECORDING):
        parser.error("--keep: what is kept was recorded without --set of the recording")
    chosen = [known[name] for name in args.names or known]
    if args.masks:
        masks()
    elif args.plain:
        plain(chosen)
    elif args.vary:
        vary(chosen, args)
    elif args.loso:
        if len(args.loso) < 3 or len(chosen) < 2:
            parser.error("--loso needs a parameter, two values, and two scenes")
        loso(chosen, args)
    else:
        table(chosen, args)


if __name__ == "__main__":
    main()
