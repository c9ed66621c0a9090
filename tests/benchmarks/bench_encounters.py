"""Encounters on CAVIAR and EWAP: which pairs are together, beside a simple rule, leave-one-out.

    python tests/benchmarks/bench_encounters.py [CAVIAR_FOLDER] [--street EWAP_FOLDER]
    python tests/benchmarks/bench_encounters.py --log ANNOTATED.mcap --truth gt.txt --truth-size 768x576

Input: the labelled boxes of people, nothing else of the labels. CAVIAR: F1 per frame, interval
(IoU at least 0.5) and onset (within 1 s) against "same group", with bootstrap intervals over the
files; its labels hold approach and parting (joining, split up), so an encounter counts with both;
the time together alone stands beside it. EWAP: F1 of pairs against who was labelled as walking
together.

Thresholds are chosen from a small grid without the file that is scored (leave-one-out), or without
the place that it is from (leave-one-place-out). Of all settings within one labelled item of the
best, the one in the middle of the grid is taken: so few items cannot tell them apart.

Groups are who hangs together by pairs that are likelier together than not. A labelled one is found
if one of ours has two thirds of its members, and of whose own no more than a third are others; F1
of groups, of all of them and of three and more.

With ``--log``, what a tracker's errors cost: the encounters of an annotated log against those
that the same rule finds in the true boxes (MOTChallenge text), in frames of pairs; each target is
in each frame who it overlaps by half or more.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import caviar
import numpy as np

from reasoning.encounters import EncounterParameters, History, find_encounters
from reasoning.encounters.encounters import side_by_side
from reasoning.questions import Case

DATA = Path(__file__).parents[3] / "shared" / "data"
GRID = {
    "near_sizes": (0.9, 1.0, 1.1),
    "far_gap_sizes": (0.5, 0.7, 0.9),
    "pace_sizes_per_s": (0.5, 0.6, 0.7),
    "least_s": (1.0, 1.5, 2.0),
}
SIMPLE = {"gap_sizes": (0.2, 0.3, 0.4, 0.5), "least_s": (1.0, 2.0, 3.0)}
ONE_INTERVAL = 2 / 15
ONE_PAIR = 1 / 47
EWAP_FPS = 7.5
Setting = tuple[float, ...]
Counts = np.ndarray


@dataclass(frozen=True)
class Scored:
    """Counts per file, (files, 3, 3): held out and with the shipped thresholds, whole and the
    time together alone; the thresholds chosen per file.
    """

    names: list[str]
    held_out: np.ndarray
    chosen: list[Setting]
    shipped: np.ndarray
    together: np.ndarray
    live: np.ndarray


@dataclass(frozen=True)
class Street:
    """People seen from above and the pairs (a < b) that were labelled as walking together."""

    people: Mapping[int, History]
    together: frozenset[tuple[int, int]]


def street(folder: Path) -> Street:
    """Read EWAP as MOTChallenge text (``gt.txt``) with its pairs (``together.txt``)."""
    rows = np.loadtxt(folder / "gt.txt", delimiter=",")
    people = {}
    for person in sorted({int(i) for i in rows[:, 1]}):
        own = rows[rows[:, 1] == person]
        own = own[np.argsort(own[:, 0], kind="stable")]
        frames = own[:, 0].astype(np.int64) - 1
        people[person] = History(frames, frames / EWAP_FPS, own[:, 2:6].copy())
    lines = (folder / "together.txt").read_text().splitlines()
    pairs = [sorted(int(v) for v in x.split()) for x in lines if not x.startswith("#")]
    return Street(people, frozenset((a, b) for a, b in pairs))


def found(
    sequence: caviar.Sequence,
    p: EncounterParameters,
    live: bool = False,
    together: bool = False,
) -> list[caviar.Interval]:
    """Encounters with approach and parting, or the time together alone."""
    return [
        caviar.Interval(e.a, e.b, e.together_frame, e.apart_frame)
        if together
        else caviar.Interval(e.a, e.b, e.start_frame, e.end_frame)
        for e in find_encounters(sequence.people(), p, live=live)
    ]


def scored(
    sequences: list[caviar.Sequence], p: EncounterParameters, **how: bool
) -> np.ndarray:
    return np.array([caviar.counts(found(s, p, **how), s.together) for s in sequences])


def pair_counts(pairs: set[tuple[int, int]], there: Street) -> Counts:
    """True, false, missed pairs."""
    right = len(pairs & there.together)
    return np.array([right, len(pairs) - right, len(there.together) - right])


def pair_f1(counts: Counts) -> float:
    return float(2 * counts[0] / max(1, 2 * counts[0] + counts[1] + counts[2]))


def on_street(there: Street, p: EncounterParameters) -> Counts:
    """Pairs that have an encounter."""
    return pair_counts({(e.a, e.b) for e in find_encounters(there.people, p)}, there)


def simple_rule(
    people: Mapping[int, History], gap_sizes: float, least_s: float
) -> list[caviar.Interval]:
    """Boxes that touch once each is widened by half of ``gap_sizes``, for long enough; gaps of a
    second are closed: the rule that ours has to beat.
    """
    out = []
    for a, b in side_by_side(people):
        frames, in_a, in_b = np.intersect1d(
            people[a].frames, people[b].frames, return_indices=True
        )
        if len(frames) < 2:
            continue
        times, one, two = (
            people[a].times_s[in_a],
            people[a].boxes[in_a],
            people[b].boxes[in_b],
        )
        beyond = np.maximum(
            one[:, :2] - two[:, :2] - two[:, 2:], two[:, :2] - one[:, :2] - one[:, 2:]
        )
        room = np.hypot(*np.maximum(beyond, 0.0).T)
        size = (np.hypot(*one[:, 2:].T) + np.hypot(*two[:, 2:].T)) / 2
        at = np.flatnonzero(room <= gap_sizes * size)
        for run in np.split(at, np.flatnonzero(np.diff(times[at]) > 1.0) + 1):
            if len(run) and times[run[-1]] - times[run[0]] >= least_s:
                out.append(caviar.Interval(a, b, int(frames[run[0]]), int(frames[run[-1]])))
    return out


def settings(grid: Mapping[str, tuple[float, ...]]) -> list[Setting]:
    return list(itertools.product(*grid.values()))


def middle(
    grid: Mapping[str, tuple[float, ...]], quality: np.ndarray, one_item: float
) -> int:
    """Of the settings within one labelled item of the best, the one nearest to the grid's middle."""
    place = np.array(
        [
            [
                axis.index(v) / (len(axis) - 1)
                for axis, v in zip(grid.values(), s, strict=True)
            ]
            for s in settings(grid)
        ]
    )
    off_centre = np.abs(place - 0.5).sum(axis=1)
    good = quality >= quality.max() - one_item
    return int(np.argmin(np.where(good, off_centre - 1e-3 * quality, np.inf)))


def chosen_parameters(setting: Setting) -> EncounterParameters:
    return replace(EncounterParameters(), **dict(zip(GRID, setting, strict=True)))


def leave_one_out(
    sequences: list[caviar.Sequence], table: np.ndarray | None = None
) -> Scored:
    """Score every setting on every file, then choose for each file on the others."""
    shipped = EncounterParameters()
    if table is None:
        table = caviar_table(sequences)
    held, chosen = held_out(GRID, table)
    return Scored(
        [s.name for s in sequences],
        held,
        [settings(GRID)[k] for k in chosen],
        scored(sequences, shipped),
        scored(sequences, shipped, together=True),
        scored(sequences, shipped, live=True),
    )


def caviar_table(sequences: list[caviar.Sequence]) -> np.ndarray:
    """(settings, files, 3, 3) counts."""
    return np.array([scored(sequences, chosen_parameters(s)) for s in settings(GRID)])


def held_out(
    grid: Mapping[str, tuple[float, ...]], table: np.ndarray
) -> tuple[np.ndarray, list[int]]:
    """Counts of each file with the setting chosen on the others, (files, 3, 3), and which it is."""
    held, chosen = [], []
    for k in range(table.shape[1]):
        quality = caviar.f1(table.sum(axis=1) - table[:, k]).sum(axis=1)
        best = middle(grid, quality, ONE_INTERVAL)
        held.append(table[best, k])
        chosen.append(best)
    return np.array(held), chosen


def bootstrap(per_file: np.ndarray, rounds: int = 2000, seed: int = 0) -> np.ndarray:
    """95 % intervals of the pooled F1, files drawn with replacement: (2, 3)."""
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, len(per_file), (rounds, len(per_file)))
    return np.asarray(
        np.percentile(caviar.f1(per_file[draws].sum(axis=1)), [2.5, 97.5], axis=0)
    )


def _row(name: str, per_file: np.ndarray) -> str:
    pooled, (low, high) = caviar.f1(per_file.sum(axis=0)), bootstrap(per_file)
    cells = "  ".join(
        f"{v:.3f} [{a:.2f}, {b:.2f}]" for v, a, b in zip(pooled, low, high, strict=True)
    )
    told = per_file[per_file[:, 0].sum(axis=1) > 0]
    files = caviar.f1(told)
    return f"{name:32s} {cells}   {_few(files.mean(axis=0))}   {_few(files.min(axis=0))}"


def _few(values: np.ndarray) -> str:
    return " / ".join(f"{v:.2f}" for v in values)


def report_caviar(sequences: list[caviar.Sequence], table: np.ndarray) -> None:
    s = leave_one_out(sequences, table)
    print(
        f"{'CAVIAR':32s} frame                interval             onset (F1, 95 % by bootstrap"
        f" over {len(sequences)} files)   mean and worst file with anything in it"
    )
    print(_row("leave-one-out", s.held_out))
    print(_row("shipped thresholds", s.shipped))
    print(_row("shipped, time together alone", s.together))
    print(_row("shipped thresholds, live", s.live))
    simple = np.array(
        [
            [caviar.counts(simple_rule(q.people(), *x), q.together) for q in sequences]
            for x in settings(SIMPLE)
        ]
    )
    print(_row("simple rule, leave-one-out", held_out(SIMPLE, simple)[0]))
    print("RTEC on labelled activities      0.67                 0.30                 0.47")
    for name, c, t in zip(s.names, s.chosen, s.held_out, strict=True):
        print(f"  {name:24s} {dict(zip(GRID, c, strict=True))} tp fp fn: {t.tolist()}")


def report_street(there: Street) -> None:
    def line(name: str, counts: Counts) -> None:
        print(f"{name:32s} {pair_f1(counts):.3f} tp fp fn: {counts.tolist()}")

    print("EWAP, pair F1")
    line("shipped thresholds", on_street(there, EncounterParameters()))
    simple = [
        pair_counts({(x.a, x.b) for x in simple_rule(there.people, *s)}, there)
        for s in settings(SIMPLE)
    ]
    line("simple rule, best setting", max(simple, key=pair_f1))


def report_places(
    sequences: list[caviar.Sequence], table: np.ndarray, there: Street
) -> None:
    """What each place chooses, scored on the other one."""
    pooled = caviar.f1(table.sum(axis=1))
    by_caviar = settings(GRID)[middle(GRID, pooled.sum(axis=1), ONE_INTERVAL)]
    seen: dict[Setting, float] = {}
    reach = GRID["far_gap_sizes"][1]
    quality = []
    for s in settings(GRID):
        # how far approach and parting reach does not change who is together on a street
        key = (s[0], reach, *s[2:])
        if key not in seen:
            seen[key] = pair_f1(on_street(there, chosen_parameters(key)))
        quality.append(seen[key])
    by_street = middle(GRID, np.array(quality), ONE_PAIR)
    print("leave-one-place-out")
    print(f"  chosen on CAVIAR {by_caviar}: EWAP pair F1"
          f" {pair_f1(on_street(there, chosen_parameters(by_caviar))):.3f}")  # fmt: skip
    print(
        f"  chosen on EWAP {settings(GRID)[by_street]}: CAVIAR {_few(pooled[by_street])}"
        " (frame / interval / onset)"
    )


def hang_together(pairs: Iterable[tuple[int, int]]) -> list[set[int]]:
    """The groups that pairs make."""
    groups: list[set[int]] = []
    for pair in pairs:
        mine = [g for g in groups if g & set(pair)]
        groups = [g for g in groups if not g & set(pair)] + [set(pair).union(*mine)]
    return groups


def likely(people: Mapping[int, History]) -> list[tuple[int, int]]:
    """Pairs that are likelier together than not."""
    return [(e.a, e.b) for e in find_encounters(people) if e.confidence >= 0.5]


def group_counts(
    ours: Iterable[tuple[int, int]], labelled: Iterable[tuple[int, int]], least: int
) -> Counts:
    """True, false, missed groups of so many and more."""
    told, meant = hang_together(ours), hang_together(labelled)

    def same(mine: set[int], theirs: set[int]) -> bool:
        both = len(mine & theirs)
        return 3 * both >= 2 * len(theirs) and 3 * both >= 2 * len(mine)

    found = sum(len(t) >= least and any(same(m, t) for m in told) for t in meant)
    false = sum(len(m) >= least and not any(same(m, t) for t in meant) for m in told)
    return np.array([found, false, sum(len(t) >= least for t in meant) - found])


def report_groups(sequences: list[caviar.Sequence], there: Street) -> None:
    print("groups, F1 (tp fp fn)")
    for least in (2, 3):
        lobby = [
            group_counts(likely(s.people()), [(x.a, x.b) for x in s.together], least)
            for s in sequences
        ]
        on_it = group_counts(likely(there.people), sorted(there.together), least)
        cells = [
            f"{place} {pair_f1(counts):.2f} {counts.tolist()}"
            for place, counts in (("CAVIAR", np.sum(lobby, axis=0)), ("EWAP", on_it))
        ]
        print(f"  of {least} and more: {', '.join(cells)}")


def compare(log: Path, truth: Path, truth_size: tuple[int, int]) -> None:
    """Print precision, recall and F1 of (person, person, frame) together, tracked against the
    true boxes.
    """
    with Case([log]) as case:
        width, height, seconds, frames = case.rows(
            "SELECT width, height, seconds, frames FROM recordings"
        )[0]
        rows = case.rows(
            "SELECT frame, track, x, y, w, h FROM tracks ORDER BY frame, track"
        )
        found = case.rows("SELECT a, b, start_frame, end_frame FROM encounters")
    scale = np.array([width / truth_size[0], height / truth_size[1]] * 2)
    true: dict[int, list[tuple[int, np.ndarray]]] = {}
    for line in truth.read_text().splitlines():
        cells = [float(v) for v in line.split(",")]
        if cells[6] != 0:
            true.setdefault(int(cells[0]) - 1, []).append(
                (int(cells[1]), np.array(cells[2:6]) * scale)
            )
    histories = {}
    for person in sorted({i for boxes in true.values() for i, _ in boxes}):
        own = [(n, box) for n in sorted(true) for i, box in true[n] if i == person]
        numbers = np.array([n for n, _ in own], np.int64)
        histories[person] = History(
            numbers, numbers * seconds / (frames - 1), np.array([b for _, b in own])
        )
    who: dict[tuple[int, int], int] = {}
    for frame, track, *box in rows:
        overlaps = [(_iou(np.array(box), other), i) for i, other in true.get(frame, ())]
        if overlaps and max(overlaps)[0] >= 0.5:
            who[track, frame] = max(overlaps)[1]
    wanted = {
        (e.a, e.b, n)
        for e in find_encounters(histories)
        for n in range(e.together_frame, e.apart_frame + 1)
    }
    had = set()
    for a, b, start, end in found:
        for n in range(start, end + 1):
            pair = who.get((a, n), -a), who.get((b, n), -b)
            had.add((min(pair), max(pair), n))
    hits = len(wanted & had)
    print(
        f"{log.name}: {len(found)} encounters, precision {hits / max(1, len(had)):.2f},"
        f" recall {hits / max(1, len(wanted)):.2f}, F1"
        f" {2 * hits / max(1, len(had) + len(wanted)):.2f} of frames together"
    )


def _iou(a: np.ndarray, b: np.ndarray) -> float:
    inside = np.minimum(a[:2] + a[2:], b[:2] + b[2:]) - np.maximum(a[:2], b[:2])
    shared = float(np.prod(np.maximum(inside, 0.0)))
    return shared / (float(a[2] * a[3] + b[2] * b[3]) - shared)


def main() -> int:
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("folder", nargs="?", type=Path, default=DATA / "caviar")
    p.add_argument(
        "--street", type=Path, default=DATA / "ewap-hotel", help="a street of EWAP"
    )
    p.add_argument(
        "--log",
        type=Path,
        nargs="+",
        help="annotated logs, to be compared with the true boxes",
    )
    p.add_argument("--truth", type=Path, help="the true boxes, MOTChallenge text")
    p.add_argument("--truth-size", default="768x576", help="the truth's picture size")
    args = p.parse_args()
    if args.log:
        width, height = (int(v) for v in args.truth_size.split("x"))
        for log in args.log:
            compare(log, args.truth, (width, height))
        return 0
    sequences = [caviar.read(path) for path in sorted(args.folder.glob("*.xml"))]
    table = caviar_table(sequences)
    report_caviar(sequences, table)
    there = street(args.street)
    report_street(there)
    report_places(sequences, table, there)
    report_groups(sequences, there)
    return 0


if __name__ == "__main__":
    sys.exit(main())
