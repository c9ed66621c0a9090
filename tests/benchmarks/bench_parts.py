"""The PARTS tracker, figure by figure: accuracy, the paper's tables, what each layer brings,
crowds, speed.

    python tests/benchmarks/bench_parts.py [accuracy] [table] [starts] [layers] [crowds] [speed]
    [--keep FOLDER] [--set SECTION.FIELD=VALUE ...]

- accuracy: PETS09-S2L1 and TUD-Campus from pixels, TUD being among what the shipped features were
  fitted on
- table: PARTS, Tables 1 and 2, on the ten PETS trajectories that are overlapped longest, started by
  hand and automatically, with and without hindsight, beside cv2.meanShift, cv2.CamShift and SORT
- starts: all PETS trajectories started by hand, each at the first free box and one and two seconds
  later, forward alone
- layers: the same scores with parts, heads, pruning, pieces and hindsight switched off, one at a
  time
- crowds: generated crowds of other seeds than those fitted on: hidden parts found, sudden moves
  survived
- speed: frames/s against a bare OpenCV loop, at 480x360 and 768x576, and the cost of a target

``--set`` changes parameters in all of them.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from bench_record import bare_loop
from plain_sort import PlainSort

from fixtures.logs import record_scene, write_scene_log
from fixtures.scenes import GeneratedScene, generate
from fixtures.truth import PARTS
from recorders.annotated.reader import AnnotatedLog
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from recorders.vision import cv2
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.evaluate import MotTable, Scores, evaluate, fit_truth, read_truth
from replay.evaluate.overlap import overlap as overlap_of
from replay.evaluate.track_table import read_tracks
from replay.run import ReplayOptions
from replay.trackers.association import assign, intersection, iou

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
PETS, TUD = DATA / "pets09-s2l1", DATA / "tud-campus"
PETS_LABELLED = (768, 576)
CHOSEN = 10
CROWD_SEEDS = (11, 12)
"""Not among those that the shipped features were fitted on (1 and 3)."""
FORWARD = "parts.hindsight=false"
GIVEN: list[str] = []
"""What ``--set`` changes."""
SWITCHES = {
    "everything": (),
    "parts off": ("parts.use_parts=false",),
    "heads off": ("parts.use_heads=false",),
    "pruning off": ("parts.use_pruning=false",),
    "pieces off": ("parts.pieces_least=1",),
    "hindsight off": (FORWARD,),
}


def scene_of(video: Path, folder: Path, fps: float | None) -> Path:
    """The scene log of a video or of a folder of pictures, recorded once."""
    out = folder / f"{video.parent.name}-{video.stem}.mcap"
    if not out.exists():
        record(open_source(video, fps=fps), out, RecordOptions())
    return out


def tracked(scene: Path, folder: Path, settings: tuple[str, ...] = ()) -> MotTable:
    """The tracks of a replay with PARTS."""
    out = folder / "annotated.mcap"
    config = replay_config("parts", assignments=(*GIVEN, *settings))
    replay(scene, out, ReplayOptions(tracker="parts", config=config, force=True))
    with AnnotatedLog(out) as log:
        return read_tracks(log).table


def pets_truth() -> MotTable:
    """The truth in the video's pixels."""
    return fit_truth(read_truth(PETS / "gt.txt"), (480, 360), PETS_LABELLED)


def row(name: str, s: Scores) -> None:
    """One line of scores."""
    e = s.trajectories.followed
    print(
        f"{name:<22} {s.hota.hota:5.1f} {s.clear.mota:6.1f} {s.identity.idf1:6.1f}"
        f" {s.clear.switches:4d} {s.clear.mostly_tracked:3d}/{s.true_ids:<3d}"
        f" {s.trajectories.mostly_tracked_single_id:3d} "
        f" {' / '.join(f'{v:.1f}' for v in e.headline)} % over {e.share:.0f} %"
    )


HEAD = (
    f"{'':<22} {'HOTA':>5} {'MOTA':>6} {'IDF1':>6} {'sw':>4} {'MT':>7} one id  x / y / w /"
    " h over all frames"
)


def accuracy(folder: Path) -> None:
    """Both sequences from pixels."""
    print("\n## From pixels\n" + HEAD)
    row(
        "PETS09-S2L1",
        evaluate(pets_truth(), tracked(scene_of(PETS / "video.avi", folder, 7), folder)),
    )
    truth = read_truth(TUD / "gt.txt")
    row(
        "TUD-Campus (fitted on)",
        evaluate(truth, tracked(scene_of(TUD / "video.mp4", folder, None), folder)),
    )


def layers(folder: Path) -> None:
    """What each layer brings."""
    print("\n## What each layer brings, PETS09-S2L1 and TUD-Campus\n" + HEAD)
    pets, tud = (
        scene_of(PETS / "video.avi", folder, 7),
        scene_of(TUD / "video.mp4", folder, None),
    )
    for name, settings in SWITCHES.items():
        row(f"PETS, {name}", evaluate(pets_truth(), tracked(pets, folder, settings)))
    for name, settings in SWITCHES.items():
        row(
            f"TUD, {name}",
            evaluate(read_truth(TUD / "gt.txt"), tracked(tud, folder, settings)),
        )


def longest_overlapped(truth: MotTable, count: int = CHOSEN) -> list[tuple[int, int]]:
    """(identity, frames) of the trajectories whose boxes meet another true box in most frames,
    most first.
    """
    frames: dict[int, int] = {int(i): 0 for i in np.unique(truth.ids)}
    for frame in np.unique(truth.frames).tolist():
        now = truth.between(frame, frame + 1)
        meet = intersection(now.boxes, now.boxes)
        np.fill_diagonal(meet, 0.0)
        for k in np.flatnonzero(meet.max(axis=1, initial=0.0) > 0).tolist():
            frames[int(now.ids[k])] += 1
    return sorted(frames.items(), key=lambda item: (-item[1], item[0]))[:count]


def starts_of(
    truth: MotTable, ids: list[int], size: tuple[int, int]
) -> dict[int, tuple[int, np.ndarray]]:
    """Where somebody would draw each target: the first box wholly in the picture that no other
    meets by a fifth.
    """
    out: dict[int, tuple[int, np.ndarray]] = {}
    for identity in ids:
        own = truth.select(truth.ids == identity)
        for frame, box in zip(own.frames.tolist(), own.boxes, strict=True):
            others = truth.select((truth.frames == frame) & (truth.ids != identity)).boxes
            free = (
                float(intersection(box[None], others).max(initial=0.0))
                < 0.2 * box[2] * box[3]
            )
            inside = (
                box[0] >= 0
                and box[1] >= 0
                and box[0] + box[2] <= size[0]
                and box[1] + box[3] <= size[1]
            )
            if free and inside:
                out[identity] = (frame, box)
                break
    return out


def in_words(starts: dict[int, tuple[int, np.ndarray]]) -> str:
    """Starts as ``parts.init`` takes them."""
    return "; ".join(
        f"frame:{f}:{','.join(f'{v:.2f}' for v in b.tolist())}"
        for _, (f, b) in sorted(starts.items())
    )


def after_starts(truth: MotTable, starts: dict[int, tuple[int, np.ndarray]]) -> MotTable:
    """The chosen trajectories from where they were started on."""
    keep = np.zeros(len(truth), bool)
    for identity, (frame, _) in starts.items():
        keep |= (truth.ids == identity) & (truth.frames >= frame)
    return truth.select(keep)


def shifted(scene: Path, starts: dict[int, tuple[int, np.ndarray]], cam: bool) -> MotTable:
    """cv2.meanShift or CamShift on the hue's back projection, saturated pixels alone, from the
    same boxes.
    """
    rows: list[tuple[int, int, float, float, float, float, float]] = []
    held: dict[int, tuple[Any, np.ndarray]] = {}
    criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 1.0)
    with SceneLog(scene) as log:
        for frame in log.frames():
            hsv = cv2.cvtColor(np.asarray(frame.image), cv2.COLOR_BGR2HSV)
            for identity, (before, table) in list(held.items()):
                likeness = cv2.calcBackProject([hsv], [0, 2], table, [0, 180, 0, 256], 1)
                window = (cv2.CamShift if cam else cv2.meanShift)(
                    likeness, before, criteria
                )[1]
                if window[2] <= 0 or window[3] <= 0:
                    del held[identity]
                    continue
                held[identity] = (window, table)
                x, y, w, h = map(float, window)
                rows.append((frame.index, identity, x, y, w, h, 1.0))
            for identity, (start, box) in starts.items():
                if start == frame.index:
                    x, y, w, h = (round(v) for v in box.tolist())
                    patch, own = (
                        hsv[y : y + h, x : x + w],
                        np.asarray(frame.mask)[y : y + h, x : x + w],
                    )
                    table = cv2.calcHist([patch], [0, 2], own, [24, 24], [0, 180, 0, 256])
                    held[identity] = (
                        (x, y, w, h),
                        cv2.normalize(table, np.empty(0), 0, 255, cv2.NORM_MINMAX),
                    )
                    rows.append((frame.index, identity, *box.tolist(), 1.0))
    return MotTable.from_rows(rows)


def sorted_boxes(scene: Path) -> MotTable:
    """SORT on the recorded detections."""
    sort, rows = PlainSort(), []
    with SceneLog(scene) as log:
        for frame in log.frames():
            rows += [(frame.index, i, *box, 1.0) for i, box in sort.step(frame.boxes)]
    return MotTable.from_rows(rows)


def of_chosen(truth: MotTable, result: MotTable, chosen: MotTable) -> MotTable:
    """The result without the boxes that belong to somebody who was not chosen."""
    ids = np.unique(chosen.ids)
    both = overlap_of(truth, result)
    best = np.zeros(len(result))
    whose = np.full(len(result), -1)
    for t, r, v in zip(
        both.true_row.tolist(), both.result_row.tolist(), both.iou.tolist(), strict=True
    ):
        if v > best[r]:
            best[r], whose[r] = v, both.truth.ids[t]
    return both.result.select(np.isin(whose, ids) | (whose < 0))


def table(folder: Path) -> None:
    """Tables 1 and 2."""
    truth, scene = pets_truth(), scene_of(PETS / "video.avi", folder, 7)
    chosen = longest_overlapped(truth)
    print(
        "\n## PETS09-S2L1, the ten trajectories overlapped longest: "
        + ", ".join(f"{i} ({n})" for i, n in chosen)
    )
    ids = [i for i, _ in chosen]
    starts = starts_of(truth, ids, (480, 360))
    by_hand = after_starts(truth, starts)
    whole = truth.select(np.isin(truth.ids, ids))
    words = in_words(starts)
    sorted_all = sorted_boxes(scene)
    results = {
        "PARTS by hand": (by_hand, tracked(scene, folder, (f"parts.init={words}",))),
        "  forward alone": (
            by_hand,
            tracked(scene, folder, (f"parts.init={words}", FORWARD)),
        ),
        "meanShift": (by_hand, shifted(scene, starts, cam=False)),
        "CamShift": (by_hand, shifted(scene, starts, cam=True)),
        "SORT from there on": (by_hand, of_chosen(truth, sorted_all, by_hand)),
        "PARTS automatic": (whole, of_chosen(truth, tracked(scene, folder), whole)),
        "  forward, automatic": (
            whole,
            of_chosen(truth, tracked(scene, folder, (FORWARD,)), whole),
        ),
        "SORT automatic": (whole, of_chosen(truth, sorted_all, whole)),
    }
    print(f"{'Table 1':<20} {'mostly':>7} {'one id':>7} {'lost':>5} {'missed':>7} {'under':>6} {'over':>5} "
          f"{'swaps':>6} {'ids':>5} {'per frame':>10}")  # fmt: skip
    scores = {name: evaluate(t, r) for name, (t, r) in results.items()}
    for name, s in scores.items():
        t = s.trajectories
        print(
            f"{name:<20} {t.mostly_tracked:7d} {t.mostly_tracked_single_id:7d}"
            f" {t.mostly_lost:5d} {t.missed:7d} {t.under_segmented:6d}"
            f" {t.over_segmented:5d} {t.swaps_per_trajectory:6.2f}"
            f" {t.ids_per_trajectory:5.2f} {t.ids_per_frame:10.2f}"
        )
    print(
        f"\n{'Table 2 (x y w h)':<20} {'as the paper, %':>24} {'by coordinate, %':>26}"
        f" {'by size, %':>26} {'over':>6}"
    )
    for name, s in scores.items():
        for label, e in (
            (name, s.trajectories.followed),
            ("  matched frames", s.trajectories.matched),
        ):
            kinds = (e.headline, e.coordinate, e.size)
            print(
                f"{label:<20} "
                + " ".join(f"{'/'.join(f'{v:.1f}' for v in k):>25}" for k in kinds)
                + f" {e.share:5.0f} %"
            )


def starts(folder: Path) -> None:
    """Everybody started by hand, three times: how often the forward pass alone holds them."""
    truth, scene = pets_truth(), scene_of(PETS / "video.avi", folder, 7)
    ids = np.unique(truth.ids).tolist()
    first = starts_of(truth, ids, (480, 360))
    print("\n## PETS09-S2L1, everybody started by hand, forward alone")
    print(f"{'':<16}   of  mostly  one id  lost   HOTA   MOTA   IDF1")
    rows = []
    for later in (0, 7, 14):
        chosen: dict[int, tuple[int, np.ndarray]] = {}
        for i, (f, _) in first.items():
            rest = truth.select((truth.ids != i) | (truth.frames >= f + later))
            chosen |= starts_of(rest, [i], (480, 360))
        found = tracked(scene, folder, (f"parts.init={in_words(chosen)}", FORWARD))
        s = evaluate(after_starts(truth, chosen), found)
        t = s.trajectories
        counts = (len(chosen), t.mostly_tracked, t.mostly_tracked_single_id, t.mostly_lost)
        rows.append((*counts, s.hota.hota, s.clear.mota, s.identity.idf1))
        print(starts_row(f"{later} frames later", rows[-1]))
    table = np.array(rows)
    print(starts_row("together", (*table[:, :4].sum(0), *table[:, 4:].mean(0))))


def starts_row(name: str, values: tuple[float, ...]) -> str:
    """One line of what became of those who were started by hand."""
    of, mostly, single, lost, *rates = values
    return f"{name:<16} {of:4.0f} {mostly:7.0f} {single:7.0f} {lost:5.0f} " + " ".join(
        f"{v:6.1f}" for v in rates
    )


def crowds(folder: Path) -> None:
    """Hidden parts and sudden moves in generated crowds."""
    print(
        "\n## Generated crowds (a part is hidden where less than half of it is to be seen)"
    )
    for what in (
        "from pixels",
        "from boxes of bodies that are to be seen to 30 %, pixels and masks",
    ):
        one_crowd(folder, what)


def one_crowd(folder: Path, what: str) -> None:
    """One kind of detections."""
    total = np.zeros(3, np.int64)
    moves = {"PARTS": [0, 0], "SORT": [0, 0]}
    for seed in CROWD_SEEDS:
        scene = generate("crowd", seed=seed)
        log = folder / f"crowd-{seed}-{what[5:10].strip()}.mcap"
        if not log.exists() and what == "from pixels":
            record_scene(scene, log)
        elif not log.exists():
            write_scene_log(scene, log)
        table = tracked(log, folder)
        with AnnotatedLog(folder / "annotated.mcap") as annotated:
            total += hidden_parts(scene, annotated)
        for name, result in (("PARTS", table), ("SORT", sorted_boxes(log))):
            kept, all_moves = survived(scene, result)
            moves[name][0] += kept
            moves[name][1] += all_moves
    hit, said, true = (int(v) for v in total)
    print(
        f"{what}:\nhidden parts: precision {100 * hit / max(said, 1):.0f} %, recall"
        f" {100 * hit / max(true, 1):.0f} %, of {true}"
    )
    for name, (kept, count) in moves.items():
        print(f"sudden moves under occlusion survived, {name}: {kept} of {count}")


def hidden_parts(scene: GeneratedScene, log: AnnotatedLog) -> np.ndarray:
    """(said and true, said, true) over all parts of tracks that lie on an actor."""
    out = np.zeros(3, np.int64)
    for frame in log.frames(("tracks",)):
        actors = [
            a
            for a in scene.truth.frames[frame.index].actors
            if a.in_picture > 0.8 * a.pixels
        ]
        tracks = [t for t in frame.tracks if t.present]
        if not actors or not tracks:
            continue
        overlap = iou(
            np.array([a.full_box for a in actors]), np.array([t.box for t in tracks])
        )
        for k, best in assign(1 - overlap, overlap >= 0.5):
            true = np.array(actors[k].part_visibility) < 0.5
            said = np.array([name in tracks[best].hidden_parts for name in PARTS])
            out += np.array([int((true & said).sum()), int(said.sum()), int(true.sum())])
    return out


def survived(scene: GeneratedScene, result: MotTable) -> tuple[int, int]:
    """How many sudden moves under occlusion a tracker's identities survive, and how many there are.

    A move is sudden if the velocity changes by more than its own size within 0.4 s; it is under
    occlusion if a fifth or more of the actor is hidden within half a second; an identity survives
    if it is on the actor a second before and a second after.
    """
    fps, frames = scene.fps, scene.truth.frames
    step, second = max(1, fps // 5), fps
    kept = count = 0
    for info in scene.actors:
        last = -second
        for f in range(second, len(frames) - second):
            around = [frames[k].actor(info.id) for k in range(f - second, f + second + 1)]
            if (
                any(a is None or a.in_picture < 0.9 * a.pixels for a in around)
                or f - last < second
            ):
                continue
            before, after = frames[f - step].actor(info.id), frames[f + step].actor(info.id)
            assert before is not None
            assert after is not None
            v, u = np.array(before.velocity), np.array(after.velocity)
            sudden = (
                float(np.hypot(*(u - v)))
                > max(float(np.hypot(*v)), float(np.hypot(*u)))
                > 5.0
            )
            near = around[second - fps // 2 : second + fps // 2]
            if not sudden or min(a.visibility for a in near if a is not None) > 0.8:
                continue
            last = f
            count += 1
            first, final = (
                _holder(frames, result, info.id, f - second),
                _holder(frames, result, info.id, f + second),
            )
            kept += first is not None and first == final
    return kept, count


def _holder(
    frames: tuple[Any, ...], result: MotTable, identity: int, index: int
) -> int | None:
    actor = frames[index].actor(identity)
    low, high = np.searchsorted(result.frames, [index, index + 1])
    if actor is None or low == high:
        return None
    overlap = iou(np.array([actor.full_box]), result.boxes[low:high])[0]
    best = int(np.argmax(overlap))
    return int(result.ids[low + best]) if overlap[best] >= 0.4 else None


def speed(folder: Path) -> None:
    """Frames per second, by the clock and of processor, by turns."""
    print("\n## Speed, by turns in one process")
    cases = [("480x360", PETS / "video.avi", scene_of(PETS / "video.avi", folder, 7))]
    if (PETS / "img1").is_dir():
        cases.append(("768x576", PETS / "img1", scene_of(PETS / "img1", folder, 7)))
    for name, video, scene in cases:
        loops: list[float] = []
        replays: list[float] = []
        frames = targets = 0
        for _ in range(3):
            if video.is_file():
                start = time.perf_counter()
                loops.append(bare_loop(video) / (time.perf_counter() - start))
            start = time.perf_counter()
            result = tracked(scene, folder)
            frames, targets = int(result.frames[-1]) + 1, len(result)
            replays.append(frames / (time.perf_counter() - start))
        rate = max(replays)
        line = (
            f"{name}: replay {rate:.0f} frames/s, {1e6 * frames / rate / targets:.0f} us"
            " per target"
        )
        print(
            line
            + (
                f"; bare loop {max(loops):.0f}, {rate / max(loops):.2f} of it"
                if loops
                else ""
            )
        )


SECTIONS = {
    "accuracy": accuracy,
    "table": table,
    "starts": starts,
    "layers": layers,
    "crowds": crowds,
    "speed": speed,
}


def main() -> int:
    """Run the chosen sections."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "sections",
        nargs="*",
        metavar="SECTION",
        help=f"of {', '.join(SECTIONS)}; default: all",
    )
    parser.add_argument(
        "--keep", type=Path, metavar="FOLDER", help="keep the recorded scenes there"
    )
    parser.add_argument(
        "--set", nargs="+", default=[], metavar="SECTION.FIELD=VALUE", help="parameters"
    )
    args = parser.parse_args()
    GIVEN[:] = args.set
    for name in args.sections:
        if name not in SECTIONS:
            parser.error(f"no section {name!r}")
    if not PETS.is_dir() or not TUD.is_dir():
        print(f"no recordings in {DATA}; set SCENETRACE_DATA", file=sys.stderr)
        return 1
    with tempfile.TemporaryDirectory() as temporary:
        folder = args.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        for name in args.sections or SECTIONS:
            SECTIONS[name](folder)
    return 0


if __name__ == "__main__":
    sys.exit(main())
