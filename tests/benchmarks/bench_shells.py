"""What SHELLS reaches: fish, flies, PETS, real occlusions, pixels, relations, speed.

    python tests/benchmarks/bench_shells.py fish [--seeds 10]     identities after interactions,
    against plain SORT python tests/benchmarks/bench_shells.py tanks                 the same of
    other animals and seeds python tests/benchmarks/bench_shells.py scores                PETS,
    TUD and the flies from pixels python tests/benchmarks/bench_shells.py pairs
    the ten longest overlaps of PETS python tests/benchmarks/bench_shells.py membership [--seeds
    3] right pixels in shared blobs, by cue python tests/benchmarks/bench_shells.py order
    who is in front, against the truth python tests/benchmarks/bench_shells.py relations
    no direct INDEPENDENT <-> JOINT step python tests/benchmarks/bench_shells.py speed [--rounds
    3]    against a bare OpenCV loop, 320x240 and 480x360

Recordings are made anew from the videos, in a temporary folder.
"""

from __future__ import annotations

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from dataclasses import fields
from functools import partial
from pathlib import Path

from bench_record import bare_loop
from shells_measures import (
    DATA,
    TANKS,
    OrderResult,
    centre_errors,
    direct_steps,
    follow,
    judge_order,
    judge_tank,
    kept,
    longest_pairs,
    pixel_accuracy,
    random_steps,
)

from fixtures.logs import export_video, record_scene, write_scene_log
from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from recorders.annotated.reader import AnnotatedLog
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from recorders.vision import cv2
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.evaluate import MotTable, evaluate, fit_truth, read_truth
from replay.evaluate.track_table import read_tracks
from replay.run import ReplayOptions

TRACKERS = ("shells", "events", "sort")
PETS = (768, 576)
"""Size of the picture that PETS was labelled in."""


def recorded(name: str, folder: Path) -> tuple[Path, Path] | None:
    """A recording of a real video and its truth; None where the data are absent."""
    video, truth, detect = {
        "pets": ("pets09-s2l1/video.avi", "pets09-s2l1/gt.txt", "motion"),
        "tud": ("tud-campus/video.mp4", "tud-campus/gt.txt", "motion"),
        "two_flies": ("flies/two_flies.mp4", "flies/two_flies.gt.txt", "threshold"),
        "three_flies": ("flies/three_flies.mp4", "flies/three_flies.gt.txt", "threshold"),
    }[name]
    if not (DATA / video).exists():
        print(f"skipped: {DATA / video} is not there")
        return None
    log = folder / f"{name}.mcap"
    if not log.exists():
        record(open_source(DATA / video), log, RecordOptions(detect=detect))
    return log, DATA / truth


def result_of(log: Path, tracker: str, folder: Path) -> MotTable:
    """A whole replay's tracks, hindsight included; ``sort``: plain SORT on the same detections."""
    if tracker == "sort":
        rows = [
            (k, i, *box, 1.0)
            for k, boxes in enumerate(follow(log, "sort")[0])
            for i, box in sorted(boxes.items())
        ]
        return MotTable.from_rows(rows)
    out = folder / f"{log.stem}-{tracker}.mcap"
    if not out.exists():
        options = ReplayOptions(
            tracker=tracker, config=replay_config(tracker), annotations_only=True
        )
        replay(log, out, options)
    with AnnotatedLog(out) as annotated:
        return read_tracks(annotated).table


def truth_of(path: Path, log: Path) -> MotTable:
    """The truth in the recording's pixels."""
    truth = read_truth(path)
    with SceneLog(log) as scene:
        size = (scene.info.width, scene.info.height)
    return fit_truth(truth, size, PETS) if log.stem == "pets" else truth


def scores(folder: Path) -> None:
    """HOTA, MOTA, IDF1 from pixels."""
    for name in ("pets", "tud", "two_flies", "three_flies"):
        found = recorded(name, folder)
        if found is None:
            continue
        truth = truth_of(found[1], found[0])
        for tracker in TRACKERS:
            print(
                f"{name:12} {tracker:7}"
                f" {evaluate(truth, result_of(found[0], tracker, folder))}",
                flush=True,
            )


def fish(folder: Path, seeds: int) -> None:
    """Identities at the end of each interaction, and the centre's error."""
    print(
        "seeds with every identity kept | lost of all (fish, interaction) | median centre"
        " error, px"
    )
    for name in ("three_fish", "six_fish"):
        clean, lost, asked = (
            dict.fromkeys(TRACKERS, 0),
            dict.fromkeys(TRACKERS, 0),
            dict.fromkeys(TRACKERS, 0),
        )
        errors: dict[str, list[float]] = {t: [] for t in TRACKERS}
        for seed in range(seeds):
            scene = generate(name, seed=seed)
            log = record_scene(scene, folder / f"{name}-{seed}.mcap")
            for tracker in TRACKERS:
                r = judge_tank(scene, follow(log, tracker)[0])
                clean[tracker] += not r.lost
                lost[tracker] += r.lost
                asked[tracker] += r.asked
                errors[tracker] += r.errors_px
        width = 0.33 * 0.125 * generate(name).width
        for t in TRACKERS:
            error = statistics.median(errors[t])
            print(
                f"{name:10} {t:7} {clean[t]:2}/{seeds}   {lost[t]:3}/{asked[t]}  "
                f" {error:5.2f} (width {width:.0f})"
            )


def tanks(folder: Path, first: int, seeds: int) -> None:
    """The same of other animals, pictures and seeds than those that it was devised on."""
    print(
        "seeds with every identity kept | lost of all (fish, interaction) | centre error in"
        " body widths"
    )
    for name, script in TANKS.items():
        for tracker in ("shells", "sort"):
            clean = lost = asked = 0
            errors: list[float] = []
            for seed in range(first, first + seeds):
                scene = GeneratedScene(
                    name, script, seed, script.size, round(script.seconds * script.fps)
                )
                path = folder / f"tank-{name}-{seed}.mcap"
                log = path if path.exists() else record_scene(scene, path)
                width = (
                    0.33 * 0.125 * scene.width * statistics.mean(a.tall for a in scene.cast)
                )
                r = judge_tank(scene, follow(log, tracker)[0], gate=1.5 * width)
                clean, lost, asked = clean + (not r.lost), lost + r.lost, asked + r.asked
                errors += [e / width for e in r.errors_px]
            print(
                f"{name:9} {tracker:7} {clean}/{seeds}   {lost:3}/{asked:3}  "
                f" {statistics.median(errors):.2f}",
                flush=True,
            )


def pairs(folder: Path) -> None:
    """After how many of the ten longest overlaps are both identities kept."""
    found = recorded("pets", folder)
    if found is None:
        return
    truth = truth_of(found[1], found[0])
    listed = longest_pairs(truth)
    results = {t: result_of(found[0], t, folder) for t in TRACKERS}
    total = dict.fromkeys(TRACKERS, 0)
    print("pair     frames      " + "  ".join(f"{t:7}" for t in TRACKERS))
    for pair in listed:
        good = {t: kept(truth, results[t], pair) for t in TRACKERS}
        for t in TRACKERS:
            total[t] += good[t]
        words = "  ".join(f"{'kept' if good[t] else '-':7}" for t in TRACKERS)
        print(f"{pair.a:3} {pair.b:3}  {pair.start:4}-{pair.end:4}  {words}")
    print(
        "kept after all         "
        + "  ".join(f"{total[t]}/{len(listed)}   " for t in TRACKERS)
    )


CUES: dict[str, tuple[str, ...]] = {
    "as it is": (),
    "no last mask (shape=0)": ("shells.shape=0",),
    "the paper's: nor placing, nor yielding": (
        "shells.shape=0",
        "shells.placing=false",
        "shells.yielding=0",
    ),
    "equation 9 as it stands (yielding=0)": ("shells.yielding=0",),
    "no colour (colour=0)": ("shells.colour=0",),
    "soft": ("shells.soft=true",),
    "disputed 0.2": ("shells.disputed=0.2",),
}


def membership(folder: Path, first: int, seeds: int) -> None:
    """Right pixels in blobs of several actors, their centres' error there, and frames under
    another identity.
    """
    names = (
        "three_fish",
        "six_fish",
        "pass_by",
        "three_way_group",
        "full_occlusion",
        "fight",
    )
    print(
        "right pixels, % (nearest centre) | median centre error of the occluded, px |"
        " another identity, % of frames"
    )
    print(" " * 40 + "".join(f"{name[:15]:25}" for name in names))
    logs = {}
    for name in names:
        for seed in range(first, first + seeds):
            scene = generate(name, seed=seed)
            logs[name, seed] = (
                scene,
                write_scene_log(
                    scene, folder / f"exact-{name}-{seed}.mcap", style="merged"
                ),
            )
    for label, settings in CUES.items():
        cells = []
        for name in names:
            shares, errors, others = [], [], []
            for seed in range(first, first + seeds):
                scene, log = logs[name, seed]
                boxes, labels = follow(log, "shells", settings)
                shares.append(pixel_accuracy(scene, boxes, labels)[1:])
                found, other = centre_errors(scene, boxes)
                errors += found
                others.append(other)
            right, near = (100 * statistics.mean(s[k] for s in shares) for k in (0, 1))
            off = statistics.median(errors) if errors else 0.0
            cells.append(
                f"{right:4.1f} ({near:4.1f}) {off:4.1f}"
                f" {100 * statistics.mean(others):4.1f}   "
            )
        print(f"{label:40}" + "".join(cells), flush=True)


def order(folder: Path, first: int, seeds: int) -> None:
    """Verdicts on who is in front: how many are right, and of how many occlusions."""
    for name in (
        "three_fish",
        "six_fish",
        "pass_by",
        "full_occlusion",
        "three_way_group",
        "fight",
        "crowd",
    ):
        total = OrderResult()
        for seed in range(first, first + seeds):
            scene = generate(name, seed=seed)
            r = judge_order(
                scene, record_scene(scene, folder / f"order-{name}-{seed}.mcap")
            )
            for field in fields(OrderResult):
                setattr(
                    total, field.name, getattr(total, field.name) + getattr(r, field.name)
                )
        verdicts = total.right + total.wrong + total.neither
        print(
            f"{name:16} {total.right:3} of {verdicts:3} right, {total.wrong} the wrong way"
            f" round; {total.told} of {total.occluded} occlusions told",
            flush=True,
        )


def relations(folder: Path) -> None:
    """Direct INDEPENDENT <-> JOINT steps."""
    for name in ("pets", "tud", "two_flies", "three_flies"):
        found = recorded(name, folder)
        if found is not None:
            result_of(found[0], "shells", folder)
            changes, direct = direct_steps(folder / f"{name}-shells.mcap")
            print(f"{name:28} {changes:6} changes, {direct} direct")
    for path in sorted(
        [*(DATA / "caviar").glob("*.xml"), *(DATA / "caviar-corridor").glob("*.mpg")]
    ):
        log = folder / f"rel-{path.stem}.mcap"
        record(
            open_source(path),
            log,
            RecordOptions(detect="motion") if path.suffix == ".mpg" else RecordOptions(),
        )
        result_of(log, "shells", folder)
        changes, direct = direct_steps(folder / f"{log.stem}-shells.mcap")
        print(f"{path.stem:28} {changes:6} changes, {direct} direct", flush=True)
    for name in SCRIPTS:
        log = write_scene_log(
            generate(name, seed=2), folder / f"rel-{name}.mcap", style="merged"
        )
        result_of(log, "shells", folder)
        changes, direct = direct_steps(folder / f"rel-{name}-shells.mcap")
        print(f"{name:28} {changes:6} changes, {direct} direct")
    total = [random_steps(seed) for seed in range(10_000)]
    print(
        f"10000 random scenes          {sum(c for c, _ in total)} changes,"
        f" {sum(d for _, d in total)} direct"
    )


def speed(folder: Path, rounds: int) -> None:
    """Frames per second, by the clock and by processor time, against a bare OpenCV loop in the
    same run.
    """
    cases: list[tuple[str, Path, Path]] = []
    found = recorded("pets", folder)
    if found is not None:
        cases.append(("PETS 480x360", DATA / "pets09-s2l1" / "video.avi", found[0]))
    scene = generate("six_fish", seed=0)
    video = export_video(scene, folder / "six_fish.mp4")
    cases.append(
        ("six fish 320x240", video, record_scene(scene, folder / "six_fish-speed.mcap"))
    )
    for label, source, log in cases:
        runs: dict[str, Callable[[], int]] = {
            "bare OpenCV loop": partial(bare_loop, source)
        }
        for name, settings in {
            "shells": (),
            "shells, no hindsight": ("shells.hindsight=false",),
            "shells, no label images": ("shells.membership=false",),
        }.items():
            options = ReplayOptions(
                tracker="shells",
                config=replay_config("shells", assignments=settings),
                force=True,
            )
            runs[name] = partial(_frames, log, folder / "speed.mcap", options)
        clock: dict[str, list[float]] = {k: [] for k in runs}
        work: dict[str, list[float]] = {k: [] for k in runs}
        for _ in range(rounds):
            for name, run in runs.items():
                begun, used = time.perf_counter(), time.process_time()
                frames = run()
                clock[name].append(frames / (time.perf_counter() - begun))
                work[name].append(frames / (time.process_time() - used))
        print(f"{label}, {rounds} rounds by turns, OpenCV threads: {cv2.getNumThreads()}")
        base, base_work = (statistics.median(v["bare OpenCV loop"]) for v in (clock, work))
        for name in runs:
            a, b = statistics.median(clock[name]), statistics.median(work[name])
            print(
                f"  {name:26} {a:6.0f} frames/s {a / base:5.2f} x   by processor time"
                f" {b:6.0f} {b / base_work:5.2f} x"
            )


def _frames(log: Path, out: Path, options: ReplayOptions) -> int:
    return replay(log, out, options).frames


def main() -> None:
    """Print the tables that are asked for."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    names = (
        "fish",
        "tanks",
        "scores",
        "pairs",
        "membership",
        "order",
        "relations",
        "speed",
    )
    parser.add_argument("tables", nargs="*", choices=[*names, []], default=list(names))
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument(
        "--first",
        type=int,
        default=20,
        help="first seed of `tanks`, `membership` and `order`",
    )
    parser.add_argument("--rounds", type=int, default=3)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        tables: dict[str, Callable[[], None]] = {
            "fish": lambda: fish(folder, args.seeds),
            "tanks": lambda: tanks(folder, args.first, args.seeds),
            "scores": lambda: scores(folder),
            "pairs": lambda: pairs(folder),
            "membership": lambda: membership(folder, args.first, args.seeds),
            "order": lambda: order(folder, args.first, args.seeds),
            "relations": lambda: relations(folder),
            "speed": lambda: speed(folder, args.rounds),
        }
        for table in args.tables:
            tables[table]()
            print()


if __name__ == "__main__":
    main()
