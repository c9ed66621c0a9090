"""The answers that were looked at in the frames, against the answers of today.

    python tests/benchmarks/looked_at.py FOLDER                      the list, as docs/answers.md has it
    python tests/benchmarks/looked_at.py FOLDER --scenes mice pets   of some scenes
    python tests/benchmarks/looked_at.py FOLDER --new                answers that nobody has looked at
    python tests/benchmarks/looked_at.py FOLDER --pictures OUT       their frames, with boxes, to look at

Each scene is recorded and replayed by the commands with their defaults into ``FOLDER``, once; then the
ready questions are asked as anybody would, with the default certainty and no parameter of ours. What was seen stands
in ``looked_at.csv`` beside this file: an answer of today is one that was looked at if it is of
the same question, begins and ends within a second and a tenth of its length of it, and is of targets that
stand at the same places in its first and its last frame. So numbers of targets may change, and an
answer that moved is one that nobody has looked at.
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from bench_scenes import DATA, MODEL, run
from numpy.typing import NDArray

from fixtures.logs import export_video
from fixtures.surroundings import surrounded
from reasoning.questions import Case
from reasoning.questions.ready_questions import DEFAULT_CERTAINTY, Options, question
from recorders.sources import open_source
from recorders.vision import cv2

SEEN = Path(__file__).with_suffix(".csv")
COLUMNS = ("scene", "question", "start_s", "end_s", "places", "verdict", "seen")
NETWORK = ("--detect", "motion,onnx", "--model", str(MODEL), "--labels", "person")
CAMPUS = "tud-campus/video.mp4"
SCENES: dict[str, tuple[str, tuple[str, ...]]] = {
    "pets": ("pets09-s2l1/video.avi", ("--fps", "7")),
    "pets+": ("pets09-s2l1/video.avi", ("--fps", "7", *NETWORK)),
    "campus": (CAMPUS, ("--fps", "25")),
    "campus+": (CAMPUS, ("--fps", "25", "--detections", str(DATA / "tud-campus/det.txt"))),
    "cyclists": ("scenes/two-cyclists/video.mp4", ("--fps", "30")),
    "one-by-one": ("scenes/one-by-one/video.mp4", ("--fps", "10")),
    "corridor": ("caviar-corridor/OneLeaveShopReenter1cor.mpg", ("--fps", "25")),
    "corridor 2": ("caviar-corridor/EnterExitCrossingPaths1cor.mpg", ("--fps", "25")),
    "highway": ("scenes/cdnet-highway/img1", ("--fps", "25")),
    "mice": ("scenes/two-mice/video.mp4", ("--fps", "47")),
    "flies": (
        "scenes/flies-courting-45s/video.mp4",
        ("--fps", "25", "--detect", "threshold"),
    ),
    "glossy_mall": ("", ()),
    "left_bag": ("", ()),
}
"""Where a scene's pictures are and how it is recorded; without pictures one of `SURROUNDED`."""
TRACKERS = {"events": "", "shells": ", shells", "parts": ", parts"}
VERDICTS = ("true", "half", "false")
SURE = 0.9
SLACK_S, SLACK_SHARE, SLACK_SIZES = 1.0, 0.1, 0.5
AROUND_S = 0.6
PANEL = (330, 230)
COLOURS = ((0, 0, 255), (255, 120, 0), (0, 200, 0), (200, 0, 200))
Box = NDArray[np.float64]
Boxes = dict[tuple[int, int], Box]
Row = dict[str, Any]


@dataclass(frozen=True)
class Told:
    """One answer: who, from which frame to which, how sure, and what else it says."""

    question: str
    tracks: tuple[int, ...]
    start: int
    end: int
    certainty: float
    note: str = ""


@dataclass(frozen=True)
class Seen:
    """One answer that was looked at: when, where its targets stood first and last, and what was
    seen.
    """

    question: str
    start_s: float
    end_s: float
    places: tuple[tuple[float, float, float, float], ...]
    verdict: str
    seen: str


def met(row: Row, a: int, fps: float) -> Told:
    near = "" if row["nearest"] is None else f"{row['nearest']:.2f} sizes"
    tracks = (min(a, row["other"]), max(a, row["other"]))
    return Told("met", tracks, row["start_frame"], row["end_frame"], row["certainty"], near)


def together(row: Row, _: int, fps: float) -> Told:
    also = f"`company`: {', '.join(map(str, row['company']))}" if row["company"] else ""
    tracks = (row["a"], row["b"])
    return Told(
        "together", tracks, row["start_frame"], row["end_frame"], row["certainty"], also
    )


def left_with(row: Row, a: int, fps: float) -> Told:
    times = round(row["track_left_t"] * fps), round(row["other_left_t"] * fps)
    return Told("left-with", (a, row["other"]), min(times), max(times), row["certainty"])


def followed(row: Row, a: int, fps: float) -> Told:
    who = (row["follower"], a)
    note = f"{row['behind_s']:.1f} s behind"
    return Told(
        "followed", who, row["start_frame"], row["end_frame"], row["certainty"], note
    )


def first_last(row: Row, a: int, fps: float) -> Told:
    frame = row["frame"]
    return Told(row["what"], (a,), frame, frame, row["certainty"], row["place"])


def never_left(row: Row, _: int, fps: float) -> Told:
    ends = row["entered_frame"], row["last_seen_frame"]
    return Told("entered-never-left", (row["track"],), *ends, row["certainty"])


def grouping(row: Row, _: int, fps: float) -> Told:
    to, out_of = row["grouping_with"], row["splitting_from"]
    note = f"to {', '.join(map(str, to))}, from {', '.join(map(str, out_of))}"
    who = (row["track"], *to, *out_of)
    return Told(
        "grouping-and-splitting",
        who,
        row["start_frame"],
        row["end_frame"],
        row["certainty"],
        note,
    )


def thing(name: str) -> Callable[[Row, int, float], Told]:
    def of(row: Row, _: int, fps: float) -> Told:
        who = (row["who"], row["object"])
        return Told(name, who, row["frame"], row["frame"], row["certainty"], "who, thing")

    return of


def hidden(row: Row, _: int, fps: float) -> Told:
    return Told(
        "hidden",
        (row["track"],),
        row["start_frame"],
        row["end_frame"],
        row["certainty"],
        row["part"],
    )


OF_EACH = {
    "met": met, "together": together, "left-with": left_with, "followed": followed, "first-last": first_last,
}  # fmt: skip
OF_ALL = {
    "entered-never-left": never_left, "grouping-and-splitting": grouping,
    "left": thing("left"), "took": thing("took"), "hidden": hidden,
}  # fmt: skip


def answers(case: Case, certainty: float = DEFAULT_CERTAINTY) -> list[Told]:
    """Every answer of the questions, each once; the surest first."""
    tracks = [
        t
        for (t,) in case.rows("SELECT DISTINCT track FROM tracks WHERE present ORDER BY 1")
    ]
    frames, seconds = case.rows("SELECT frames, seconds FROM recordings")[0]
    fps = (frames - 1) / seconds

    def ask(name: str, *words: int) -> Iterator[Row]:
        sql = question(name).sure_sql([str(w) for w in words], Options(certainty=certainty))
        found = case.sql(sql)
        for values in found.rows:
            yield dict(zip(found.columns, values, strict=True))

    told = [
        make(row, a, fps)
        for q, make in OF_EACH.items()
        for a in tracks
        for row in ask(q, a)
    ]
    told += [make(row, 0, fps) for q, make in OF_ALL.items() for row in ask(q)]
    order = [*OF_EACH, "first seen", "last seen", *OF_ALL]
    unique = list(dict.fromkeys(told))
    return sorted(
        unique, key=lambda x: (order.index(x.question), -x.certainty, x.start, x.tracks)
    )


def boxes_of(case: Case) -> Boxes:
    """Each target's box in each frame, (x, y, w, h, 1 where it is seen)."""
    rows = case.rows("SELECT track, frame, x, y, w, h, seen FROM sure_tracks WHERE present")
    return {(track, frame): np.array(rest, float) for track, frame, *rest in rows}


def nearest_frame(boxes: Boxes, track: int, frame: int) -> int:
    """The frame nearest to one in which a target is there."""
    return min((n for t, n in boxes if t == track), key=lambda n: (abs(n - frame), n))


def place(boxes: Boxes, track: int, told: Told) -> tuple[float, float, float, float]:
    """Where a target stands in its first and its last frame of an answer: feet, in pixels."""
    ends = [boxes[track, nearest_frame(boxes, track, n)] for n in (told.start, told.end)]
    x, y, u, v = (
        round(float(value), 1) for b in ends for value in (b[0] + b[2] / 2, b[1] + b[3])
    )
    return x, y, u, v


def same(told: Told, seen: Seen, boxes: Boxes, fps: float) -> bool:
    """Whether an answer of today is the one that was looked at."""
    slack = SLACK_S + SLACK_SHARE * (seen.end_s - seen.start_s)
    off = max(abs(told.start / fps - seen.start_s), abs(told.end / fps - seen.end_s))
    if told.question != seen.question or off > slack:
        return False
    left = list(seen.places)
    for track in told.tracks:
        if not left:
            return False
        ways = [np.abs(np.subtract(place(boxes, track, told), p)).max() for p in left]
        size = float(np.hypot(*boxes[track, nearest_frame(boxes, track, told.start)][2:4]))
        if min(ways) > SLACK_SIZES * size:
            return False
        left.pop(int(np.argmin(ways)))
    return not left


def read_seen(path: Path = SEEN) -> dict[str, list[Seen]]:
    """What was looked at, by scene."""
    found: dict[str, list[Seen]] = {}
    if not path.exists():
        return found
    with path.open(newline="", encoding="utf-8") as file:
        for row in csv.DictReader(file):
            places = [tuple(map(float, p.split())) for p in row["places"].split(";")]
            found.setdefault(row["scene"], []).append(
                Seen(
                    row["question"],
                    float(row["start_s"]),
                    float(row["end_s"]),
                    tuple((x, y, u, v) for x, y, u, v in places),
                    row["verdict"],
                    row["seen"],
                )
            )
    return found


def source_of(scene: str, folder: Path) -> Path:
    """Where a scene's pictures are; those of a generated one are made."""
    where = SCENES[scene][0]
    if where:
        return DATA / where
    video = folder / f"{scene}.mkv"
    if not video.exists():
        export_video(surrounded(scene), video)
    return video


def log_of(scene: str, tracker: str, folder: Path) -> Path:
    """A scene's annotated log, made where it is not there yet."""
    stem = scene.replace(" ", "_")
    log, out = folder / f"{stem}.scene.mcap", folder / f"{stem}.{tracker}.mcap"
    if not log.exists():
        run("record", source_of(scene, folder), "-o", log, *SCENES[scene][1])
    if not out.exists():
        run("replay", log, "-o", out, "--tracker", tracker)
    return out


def clock(told: Told, fps: float) -> str:
    """When: a moment, or from when to when."""
    first, last = f"{told.start / fps:.1f}", f"{told.end / fps:.1f}"
    return f"{first} s" if first == last else f"{first}-{last} s"


def drawn(image: Any, index: int, told: Told, boxes: Boxes) -> NDArray[np.uint8]:
    """One frame, cut to where the answer's targets are: theirs in colours, others grey; thin where
    one is not seen.
    """
    own = np.array(
        [
            b
            for (t, n), b in boxes.items()
            if t in told.tracks and told.start - 20 <= n <= told.end + 20
        ]
    )
    x0, y0 = np.maximum(np.subtract(own[:, :2].min(axis=0), (40, 30)), 0).astype(int)
    x1, y1 = np.add((own[:, :2] + own[:, 2:4]).max(axis=0), (40, 30)).astype(int)
    picture = cv2.resize(np.ascontiguousarray(image), None, fx=2, fy=2)
    for (track, frame), (x, y, w, h, seen) in sorted(boxes.items()):
        if frame != index:
            continue
        mine = track in told.tracks
        colour = COLOURS[told.tracks.index(track) % 4] if mine else (170, 170, 170)
        corner = round(2 * x), round(2 * y)
        cv2.rectangle(
            picture,
            corner,
            (round(2 * x + 2 * w), round(2 * y + 2 * h)),
            colour,
            2 if seen else 1,
        )
        cv2.putText(picture, str(track), (corner[0], corner[1] - 3), 0, 0.6, colour, 2)
    cut = picture[2 * y0 : 2 * y1, 2 * x0 : 2 * x1]
    scale = min(PANEL[0] / cut.shape[1], PANEL[1] / cut.shape[0])
    size = int(cut.shape[1] * scale), int(cut.shape[0] * scale)
    return np.asarray(cv2.resize(cut, size, interpolation=cv2.INTER_AREA))


@dataclass(frozen=True)
class Listed:
    """An answer of today, and what was seen of it."""

    label: str
    number: int
    told: Told
    when: str
    fps: float
    seen: Seen | None

    def line(self) -> str:
        """As a row of a table."""
        t, s = self.told, self.seen
        assert s is not None
        note = f" ({t.note})" if t.note else ""
        return (
            f"| {self.label} | `{t.question}` | {', '.join(map(str, t.tracks))}: {self.when}{note}"
            f" | {t.certainty:.2f} | {s.seen} | {s.verdict} |"
        )


def summary(found: Sequence[Listed]) -> Iterator[str]:
    """How many answers of each question are true, and how sure the others are."""
    yield "| question | asked | looked at | true | half | false | surest half | surest false |"
    yield "|---|---|---|---|---|---|---|---|"
    names = list(dict.fromkeys(x.told.question for x in found))
    for name in [*names, "all"]:
        mine = [x for x in found if name in ("all", x.told.question)]
        by = {
            verdict: [
                x.told.certainty for x in mine if x.seen and x.seen.verdict == verdict
            ]
            for verdict in VERDICTS
        }
        surest = [f"{max(by[k]):.2f}" if by[k] else "" for k in ("half", "false")]
        counts = [len(by[k]) for k in VERDICTS]
        yield f"| {name} | {len(mine)} | {sum(counts)} | {' | '.join(map(str, [*counts, *surest]))} |"
    sure = [x.seen.verdict for x in found if x.seen and x.told.certainty > SURE]
    yield f"\nOver {SURE:g}: {dict(sorted(Counter(sure).items()))}"


def listed(
    scene: str, tracker: str, folder: Path, seen: Sequence[Seen]
) -> tuple[list[Listed], Boxes]:
    """The answers to a scene."""
    with Case([log_of(scene, tracker, folder)]) as case:
        told, boxes = answers(case), boxes_of(case)
        count, seconds = case.rows("SELECT frames, seconds FROM recordings")[0]
    fps = (count - 1) / seconds
    found = []
    for number, t in enumerate(told):
        known = next((s for s in seen if same(t, s, boxes, fps)), None)
        found.append(
            Listed(scene + TRACKERS[tracker], number, t, clock(t, fps), fps, known)
        )
    return found, boxes


def sheet(
    scene: str, chosen: Sequence[Listed], boxes: Boxes, folder: Path
) -> NDArray[np.uint8]:
    """The frames behind some answers: before, start, two between, end, after."""
    around, end = max(1, round(AROUND_S * chosen[0].fps)), max(n for _, n in boxes)
    wanted: dict[int, list[tuple[int, int]]] = {}
    for row, listed_one in enumerate(chosen):
        s, e = listed_one.told.start, listed_one.told.end
        frames = (s - around, s, (2 * s + e) // 3, (s + 2 * e) // 3, e, e + around)
        for column, frame in enumerate(frames):
            wanted.setdefault(min(max(frame, 0), end), []).append((row, column))
    width, height = PANEL
    out = np.zeros((len(chosen) * (height + 20), 6 * width, 3), np.uint8)
    words = SCENES[scene][1]
    rate = float(words[1]) if "--fps" in words else None
    for picture in open_source(source_of(scene, folder), fps=rate).frames():
        for row, column in wanted.get(picture.index, []):
            panel = drawn(picture.image, picture.index, chosen[row].told, boxes)
            top, left = row * (height + 20) + 20, column * width
            out[top : top + panel.shape[0], left : left + panel.shape[1]] = panel
            at = left + 280, top + height - 6
            text = f"{picture.index / chosen[0].fps:.1f}"
            cv2.putText(out, text, at, 0, 0.45, (0, 255, 255), 1)
        if picture.index > max(wanted):
            break
    for row, x in enumerate(chosen):
        text = f"{x.number} {x.told.question} {x.told.tracks} {x.when} {x.told.certainty:.2f} {x.told.note}"
        cv2.putText(out, text, (4, row * (height + 20) + 14), 0, 0.5, (255, 255, 255), 1)
    return out


def pictures(
    chosen: Sequence[Listed], scene: str, boxes: Boxes, folder: Path, out: Path
) -> None:
    """Ten answers to a picture."""
    out.mkdir(parents=True, exist_ok=True)
    for k in range(0, len(chosen), 10):
        part = chosen[k : k + 10]
        name = f"{part[0].label.replace(' ', '_').replace(',', '')}-{part[0].number}.png"
        cv2.imwrite(str(out / name), sheet(scene, part, boxes, folder))


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("folder", type=Path, help="logs are made there, once")
    p.add_argument(
        "--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="SCENE"
    )
    p.add_argument(
        "--trackers", nargs="+", choices=TRACKERS, default=["events"], metavar="NAME"
    )
    p.add_argument("--questions", nargs="+", default=[], metavar="NAME")
    p.add_argument("--all", action="store_true", help="also those that are true")
    p.add_argument("--new", action="store_true", help="those that nobody has looked at")
    p.add_argument("--pictures", type=Path, help="their frames as pictures, ten to one")
    args = p.parse_args()
    args.folder.mkdir(parents=True, exist_ok=True)
    seen = read_seen()
    found: list[Listed] = []
    for scene in args.scenes:
        for tracker in args.trackers:
            label = scene + TRACKERS[tracker]
            rows, boxes = listed(scene, tracker, args.folder, seen.get(label, []))
            rows = [
                r for r in rows if not args.questions or r.told.question in args.questions
            ]
            found += rows
            new = [r for r in rows if r.seen is None]
            if args.new:
                for r in new:
                    places = ";".join(
                        " ".join(f"{v:g}" for v in place(boxes, k, r.told))
                        for k in r.told.tracks
                    )
                    print(f"{r.number:3} {label},{r.told.question},{r.when},{places}  # {r.told.tracks}"
                          f" {r.told.certainty:.2f} {r.told.note}")  # fmt: skip
            if args.pictures and new:
                pictures(new, scene, boxes, args.folder, args.pictures)
    if not args.new:
        for r in found:
            if r.seen is not None and (args.all or r.seen.verdict != "true"):
                print(r.line())
        print("\n".join(["", *summary(found)]))
    return 0


if __name__ == "__main__":
    sys.exit(main())
