"""Encounters on CAVIAR: leave-one-out F1 per frame, interval and onset, with bootstrap intervals
over the files.

    python tests/benchmarks/bench_encounters.py [FOLDER] python
    tests/benchmarks/bench_encounters.py --log ANNOTATED.mcap --truth gt.txt --truth-size 768x576

With ``--log``, what a tracker's errors cost: the encounters of an annotated log against those
that the same rule finds in the true boxes (MOTChallenge text), in frames of pairs; each target is
in each frame who it overlaps by half or more.

Input: the labelled boxes of people, nothing else of the labels. For each file the thresholds are
chosen on the other files from a small grid; of all settings that are within one labelled interval
of the best, the one in the middle of the grid is taken, because fifteen intervals cannot tell
them apart.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import caviar
import numpy as np

from reasoning.encounters import EncounterParameters, History, find_encounters
from reasoning.questions import Case

GRID = {
    "near_sizes": (0.8, 1.0, 1.2),
    "far_sizes": (1.6, 2.0, 2.4),
    "pace_sizes_per_s": (0.4, 0.6, 0.8),
    "least_s": (1.0, 1.5, 2.0),
}
ONE_INTERVAL = 2 / 15


@dataclass(frozen=True)
class Scored:
    """Counts per file, (files, 3, 3), held out and with the shipped thresholds; the thresholds
    chosen per file.
    """

    names: list[str]
    held_out: np.ndarray
    chosen: list[tuple[float, ...]]
    shipped: np.ndarray
    live: np.ndarray


def found(
    sequence: caviar.Sequence, p: EncounterParameters, live: bool = False
) -> list[caviar.Interval]:
    people = sequence.people()
    return [
        caviar.Interval(e.a, e.b, e.start_frame, e.end_frame)
        for e in find_encounters(people, p, live=live)
    ]


def scored(
    sequences: list[caviar.Sequence], p: EncounterParameters, live: bool = False
) -> np.ndarray:
    return np.array([caviar.counts(found(s, p, live), s.together) for s in sequences])


def leave_one_out(sequences: list[caviar.Sequence]) -> Scored:
    """Score every setting on every file, then choose for each file on the others."""
    shipped = EncounterParameters()
    settings = [s for s in itertools.product(*GRID.values()) if s[1] >= s[0]]
    table = np.array(
        [
            scored(sequences, replace(shipped, **dict(zip(GRID, s, strict=True))))
            for s in settings
        ]
    )
    place = np.array(
        [
            [
                axis.index(v) / (len(axis) - 1)
                for axis, v in zip(GRID.values(), s, strict=True)
            ]
            for s in settings
        ]
    )
    off_centre = np.abs(place - 0.5).sum(axis=1)
    held, chosen = [], []
    for k in range(len(sequences)):
        quality = caviar.f1(table.sum(axis=1) - table[:, k]).sum(axis=1)
        good = quality >= quality.max() - ONE_INTERVAL
        best = int(np.argmin(np.where(good, off_centre - 1e-3 * quality, np.inf)))
        held.append(table[best, k])
        chosen.append(settings[best])
    names = [s.name for s in sequences]
    return Scored(
        names,
        np.array(held),
        chosen,
        scored(sequences, shipped),
        scored(sequences, shipped, live=True),
    )


def bootstrap(per_file: np.ndarray, rounds: int = 2000, seed: int = 0) -> np.ndarray:
    """95 % intervals of the pooled F1, files drawn with replacement: (2, 3)."""
    rng = np.random.default_rng(seed)
    draws = rng.integers(0, len(per_file), (rounds, len(per_file)))
    return np.percentile(caviar.f1(per_file[draws].sum(axis=1)), [2.5, 97.5], axis=0)


def _row(name: str, per_file: np.ndarray) -> str:
    pooled, (low, high) = caviar.f1(per_file.sum(axis=0)), bootstrap(per_file)
    cells = "  ".join(
        f"{v:.3f} [{a:.2f}, {b:.2f}]" for v, a, b in zip(pooled, low, high, strict=True)
    )
    return f"{name:32s} {cells}"


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
        for n in range(e.start_frame, e.end_frame + 1)
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
    p.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=Path(__file__).parents[3] / "shared" / "data" / "caviar",
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
    s = leave_one_out(sequences)
    print(
        f"{'':32s} frame                interval             onset (F1, 95 % by bootstrap"
        f" over {len(sequences)} files)"
    )
    print(_row("leave-one-out", s.held_out))
    print(_row("shipped thresholds", s.shipped))
    print(_row("shipped thresholds, live", s.live))
    print("best simple rule, leave-one-out  0.90                 0.90                 0.62")
    print("RTEC on labelled activities      0.67                 0.30                 0.47")
    for name, c, t in zip(s.names, s.chosen, s.held_out, strict=True):
        print(f"  {name:24s} {dict(zip(GRID, c, strict=True))} tp fp fn: {t.tolist()}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
