"""How near two must have come for `met` to be true: the answers on scenes with truth, place by place.

    python tests/benchmarks/bench_answers.py                  all scenes
    python tests/benchmarks/bench_answers.py pets campus      some of them

Each row of `met` that names two who are both of the truth, for most of its time, is held against
the true boxes: did the two come within one body size of one another on the ground, within a quarter
of a second of the row's time? ``shown``: rows of certainty .5 and more. ``sure``: rows over .9.
``missed``: pairs that did and are not shown. The last table is how near the row says that they
came against how often they did, and what `nearness.sure_near` says; then its two numbers as each
place would have them chosen by the others, and the mean distance from what was right there.

From pixels, also the other way round: of each time in which two of the truth are within a body size of one
another for two seconds, is it in any answer of `met`, at any certainty, for half of it?

On EWAP's street, whose people are labelled by who walks with whom, also `left-with`: how many of the
pairs that it names are labelled, of those that were together until then and of those that were not.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from bench_encounters import street
from bench_mot15 import DATA, SEQUENCES
from bench_scenes import AS_IS, VARIANTS, recorded, run, scenes, truth_of
from numpy.typing import NDArray

from reasoning.encounters import History
from reasoning.encounters.ground import ground_of
from reasoning.encounters.nearness import nearest, sure_near
from reasoning.encounters.pair import pairs, spans
from reasoning.questions import Case
from reasoning.questions.ready_questions import DEFAULT_CERTAINTY, Options, question
from recorders.segmentation.usual import ious
from recorders.sources import open_source
from replay.evaluate import MotTable, read_truth

PIXELS = ("pets", "campus", "two-cyclists")
STREET = "EWAP hotel"
FROM_BOXES = {**SEQUENCES, STREET: ("ewap-hotel", 7.5, (784, 513))}
PLACES = {"pets": "PETS09-S2L1", "campus": "TUD-Campus"}
"""Scenes from pixels that are of the same place as one from boxes."""
NEAR = 1.0
NEAR_S = 2.0
SLACK_S = 0.25
LEAST_SHARE = 0.5
EDGES = (0.0, 0.6, 0.8, 0.9, 1.0, 1.1, 1.2, 1.5, 9.0)
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Met:
    """One row of `met`: how near it says that the two came, how near they did, how sure it is."""

    said: float
    true: float
    certainty: float


def by_person(table: MotTable, fps: float) -> dict[int, History]:
    """Boxes over time of everybody of a truth."""
    people = {}
    for person in sorted({int(i) for i in table.ids[table.confidences != 0]}):
        own = (table.ids == person) & (table.confidences != 0)
        order = np.argsort(table.frames[own], kind="stable")
        frames = table.frames[own][order].astype(np.int64)
        boxes = table.boxes[own][order].astype(np.float64)
        people[person] = History(frames, frames / fps, boxes)
    return people


def who_is(log: Case, people: dict[int, History]) -> dict[tuple[int, int], int]:
    """Whom a track overlaps by half or more in a frame."""
    there: dict[int, list[tuple[int, Floats]]] = {}
    for person, history in people.items():
        for frame, box in zip(history.frames.tolist(), history.boxes, strict=True):
            there.setdefault(frame, []).append((person, box))
    found = {}
    for frame, track, *box in log.rows(
        "SELECT frame, track, x, y, w, h FROM tracks WHERE present ORDER BY frame, track"
    ):
        others = there.get(frame, [])
        if others:
            shared = ious(np.array([box]), np.array([b for _, b in others]))[0]
            if shared.max() >= 0.5:
                found[track, frame] = others[int(shared.argmax())][0]
    return found


def met(log: Path, truth: MotTable) -> list[Met]:
    """Every row of `met` whose two are both of the truth."""
    with Case([log]) as case:
        width, seconds, count = case.rows("SELECT width, seconds, frames FROM recordings")[
            0
        ]
        fps = (count - 1) / seconds
        people = by_person(truth, fps)
        ground = ground_of(people, float(width))
        who = who_is(case, people)
        rows = {}
        for (track,) in case.rows("SELECT DISTINCT track FROM tracks ORDER BY track"):
            found = case.sql(question("met").sure_sql([str(track)], Options(certainty=0.0)))
            for values in found.rows:
                row = dict(zip(found.columns, values, strict=True))
                pair = min(track, row["other"]), max(track, row["other"])
                rows[*pair, row["start_frame"]] = row
    out = []
    slack = round(SLACK_S * fps)
    for (a, b, first), row in sorted(rows.items()):
        span = range(first, row["end_frame"] + 1)
        pairs = Counter((who.get((a, n)), who.get((b, n))) for n in span)
        (one, two), times = pairs.most_common(1)[0]
        if one is None or two is None or one == two or times < LEAST_SHARE * len(span):
            continue
        close = nearest(
            people[one], people[two], first - slack, row["end_frame"] + slack, ground
        )
        if close is not None and row["nearest"] is not None:
            out.append(Met(row["nearest"], close, row["certainty"]))
    return out


def silent(log: Path, truth: MotTable) -> tuple[int, list[tuple[int, int, float, float]]]:
    """How often two of a truth are near for `NEAR_S`, and those times that no answer tells."""
    with Case([log]) as case:
        width, seconds, count = case.rows("SELECT width, seconds, frames FROM recordings")[
            0
        ]
        people = by_person(truth, (count - 1) / seconds)
        who = who_is(case, people)
        met_ones = case.rows("SELECT a, b, start_frame, end_frame FROM relations")
    told: dict[tuple[int, int], set[int]] = {}
    for a, b, first, last in met_ones:
        for n in range(first, last + 1):
            one, two = who.get((a, n)), who.get((b, n))
            if one is not None and two is not None:
                told.setdefault((min(one, two), max(one, two)), set()).add(n)
    stretch = ground_of(people, float(width)).stretch
    times, missed = 0, []
    for a, b in itertools.combinations(sorted(people), 2):
        for pair in pairs(people[a], people[b], SLACK_S, SLACK_S, False, stretch):
            for i, j in spans(pair.distance <= NEAR):
                start, end = float(pair.times_s[i]), float(pair.times_s[j])
                if end - start < NEAR_S:
                    continue
                times += 1
                frames = set(pair.frames[i : j + 1].tolist())
                if len(frames & told.get((a, b), set())) < LEAST_SHARE * len(frames):
                    missed.append((a, b, round(start, 1), round(end, 1)))
    return times, missed


def left_with(log: Path, truth: MotTable, labelled: frozenset[tuple[int, int]]) -> None:
    """How many pairs of `left-with` know one another."""
    with Case([log]) as case:
        seconds, count = case.rows("SELECT seconds, frames FROM recordings")[0]
        lives: dict[int, Counter[int]] = {}
        for (track, _), person in who_is(
            case, by_person(truth, (count - 1) / seconds)
        ).items():
            lives.setdefault(track, Counter())[person] += 1
        who = {track: found.most_common(1)[0][0] for track, found in lives.items()}
        together = set(case.rows("SELECT a, b FROM encounters"))
        counts = np.zeros((2, 2), int)
        for a in sorted(who):
            found = case.sql(
                question("left-with").sure_sql([str(a)], Options(certainty=0.0))
            )
            for row in found.rows:
                b = dict(zip(found.columns, row, strict=True))["other"]
                if b > a and b in who:
                    pair = min(who[a], who[b]), max(who[a], who[b])
                    counts[int((a, b) in together)] += [1, pair in labelled]
    print(
        f"\n`left-with`, EWAP: {counts[1, 1]} of {counts[1, 0]} pairs who were together until then"
        f" are labelled, {counts[0, 1]} of {counts[0, 0]} who were not"
    )


def measured(names: list[str]) -> dict[str, list[Met]]:
    """The rows of each scene."""
    found = {}
    with TemporaryDirectory() as name:
        folder = Path(name)
        log, out = folder / "scene.mcap", folder / "annotated.mcap"
        for scene in scenes():
            if scene.name in PIXELS and (not names or scene.name in names):
                recorded(scene, VARIANTS[AS_IS], "pixels", [], folder)
                source = open_source(scene.video, fps=scene.fps)
                truth = truth_of(scene, VARIANTS[AS_IS], (source.width, source.height))
                run("replay", log, "-o", out, "--force")
                found[scene.name] = met(out, truth)
                times, missed = silent(out, truth)
                print(
                    f"{scene.name}: {times} times two are near for {NEAR_S:g} s, {len(missed)} of them"
                    f" in no answer{': ' if missed else ''}{', '.join(map(str, missed))}"
                )
        for sequence, (where, fps, (width, height)) in FROM_BOXES.items():
            if names and sequence not in names:
                continue
            words = ["--fps", f"{fps:g}", "--size", f"{width}x{height}", "--force"]
            run("record", DATA / where / "det.txt", "-o", log, *words)
            run("replay", log, "-o", out, "--force")
            truth = read_truth(DATA / where / "gt.txt")
            found[sequence] = met(out, truth)
            if sequence == STREET:
                left_with(out, truth, street(DATA / where).together)
    return found


def fitted(said: Floats, right: Floats, weights: Floats) -> Floats:
    """A logistic function of the logarithm of how near the row says: its two numbers."""
    columns = np.column_stack([np.ones(len(said)), np.log(np.maximum(said, 0.01))])
    numbers = np.zeros(2)
    for _ in range(50):
        p = 1 / (1 + np.exp(-(columns * numbers).sum(axis=1)))
        slope = (columns * (weights * (right - p))[:, None]).sum(axis=0) - 1e-3 * numbers
        w = weights * p * (1 - p)
        x = columns[:, 1]
        a, b, d = w.sum() + 1e-3, (w * x).sum(), (w * x * x).sum() + 1e-3
        step = np.array([d * slope[0] - b * slope[1], a * slope[1] - b * slope[0]])
        numbers = numbers + step / (a * d - b * b)
    return numbers


def off(said: Floats, right: Floats) -> float:
    """Calibration error in tenths."""
    tenth = np.minimum((said * 10).astype(int), 9)
    parts = [said[tenth == k].sum() - right[tenth == k].sum() for k in range(10)]
    return float(np.abs(parts).sum() / len(said))


def report(found: dict[str, list[Met]]) -> None:
    print(
        f"{'`met`':16}{'rows':>6}{'shown':>7}{'true':>6}{'sure':>6}{'true':>6}{'missed':>8}"
    )
    for name, rows in [*found.items(), ("all", [m for r in found.values() for m in r])]:
        shown = [m for m in rows if m.certainty >= DEFAULT_CERTAINTY]
        sure = [m for m in rows if m.certainty > 0.9]
        true = [sum(m.true <= NEAR for m in group) for group in (rows, shown, sure)]
        print(
            f"{name:16}{len(rows):6}{len(shown):7}{true[1]:6}{len(sure):6}{true[2]:6}"
            f"{true[0] - true[1]:8}"
        )
    places = np.array([PLACES.get(n, n) for n, rows in found.items() for _ in rows])
    said = np.array([m.said for rows in found.values() for m in rows])
    right = np.array([m.true <= NEAR for rows in found.values() for m in rows], float)
    told = np.array([sure_near(d) for d in said])
    print("\nnearest, sizes   rows  were near  said")
    for low, high in itertools.pairwise(EDGES):
        k = (said >= low) & (said < high)
        if k.any():
            print(
                f"{low:4} to {high:<6}{k.sum():8}{right[k].mean():11.2f}{told[k].mean():6.2f}"
            )
    print(f"\ncalibration error of `sure_near` {off(told, right):.3f}; left out:")
    for place in np.unique(places):
        others = places != place
        if others.all() or not others.any():
            continue
        sizes = np.array([(places == p).sum() for p in places[others]])
        a, b = fitted(said[others], right[others], 1 / np.maximum(sizes, 30))
        p = 1 / (1 + np.exp(-(a + b * np.log(np.maximum(said[~others], 0.01)))))
        print(
            f"  {place:16} odds {np.exp(a):.2f} / nearest^{-b:.1f}: {off(p, right[~others]):.3f},"
            f" as it is {off(told[~others], right[~others]):.3f}"
        )


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("scenes", nargs="*", help=", ".join([*PIXELS, *FROM_BOXES]))
    args = p.parse_args()
    if unknown := [n for n in args.scenes if n not in (*PIXELS, *FROM_BOXES)]:
        p.error(f"no scene {unknown[0]}; there are {', '.join([*PIXELS, *FROM_BOXES])}")
    report(measured(args.scenes))
    return 0


if __name__ == "__main__":
    sys.exit(main())
