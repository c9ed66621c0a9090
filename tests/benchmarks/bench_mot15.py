"""MOTChallenge 2015 sequences from their detection files alone, through record, replay and eval.

    python tests/benchmarks/bench_mot15.py                      every tracker's scores and curve
    python tests/benchmarks/bench_mot15.py --trackers events --set hindsight.blur=0.3
    python tests/benchmarks/bench_mot15.py --thresholds 0 0.9   plain SORT at these scores beside it
    python tests/benchmarks/bench_mot15.py --trackers --peers   five peers at six scores, and their best
    python tests/benchmarks/bench_mot15.py --parameters         one by one, 5 % up and down
    python tests/benchmarks/bench_mot15.py --first 200          recorded alone, and within the whole

"together" pools the counts of the four MOT15 sequences, as TrackEval's COMBINED does; PETS and TUD
stand beside them. The curve says how many of the boxes that are told with a confidence are right;
the calibration error is the mean distance of the two, weighted by boxes, in tenths of confidence.
That of `identity` is the same of boxes on somebody: how many are on whom their track began on. A
track's boxes stand and fall together, and a sequence has 6 to 70 tracks: beside its error stands the
one that it would show if every probability were right.
"""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from numpy.typing import NDArray
from peers import PEERS, Peer
from plain_sort import PlainSort

from recorders.annotated.reader import AnnotatedLog
from recorders.parameters import as_plain
from recorders.recording import RecordOptions, record
from recorders.sources import open_source
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.evaluate import MotTable, evaluate, read_truth
from replay.evaluate.clear import match
from replay.evaluate.hota import Hota
from replay.evaluate.overlap import overlap
from replay.evaluate.track_table import read_tracks
from replay.run import ReplayOptions

DATA = Path(
    os.environ.get("SCENETRACE_DATA", Path(__file__).parents[3] / "shared" / "data")
)
SEQUENCES = {
    "ADL-Rundle-8": ("mot15/ADL-Rundle-8", 30.0, (1920, 1080)),
    "ETH-Bahnhof": ("mot15/ETH-Bahnhof", 14.0, (640, 480)),
    "KITTI-13": ("mot15/KITTI-13", 10.0, (1242, 375)),
    "Venice-2": ("mot15/Venice-2", 30.0, (1920, 1080)),
    "PETS09-S2L1": ("pets09-s2l1", 7.0, (768, 576)),
    "TUD-Campus": ("tud-campus", 25.0, (640, 480)),
}
TOGETHER = 4
PEERS_FROM = (0.0, 0.5, 0.7, 0.8, 0.9, 0.95)
Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Result:
    """One sequence's counts, for pooling.

    Attributes:
        counts: true boxes, hits, extras, switches, IDTP, boxes told.
        parts: (19, 4) by alpha: hits, result boxes, true boxes, sum of the hits' association.
        sure, right: (N,) confidence of every box told, and whether it is a hit at IoU .5.
        known, same: (M,) identity of every hit, and whether it is on whom its track began on.
        whose: (M,) its track.
    """

    counts: Floats
    parts: Floats
    sure: Floats
    right: NDArray[np.bool_]
    known: Floats
    same: NDArray[np.bool_]
    whose: NDArray[np.int64]

    @property
    def scores(self) -> tuple[float, float, float]:
        """HOTA, MOTA, IDF1."""
        true, hits, extras, switches, idtp, told = self.counts.tolist()
        found, result, truth, associated = self.parts.T
        det = found / np.maximum(result + truth - found, 1)
        ass = associated / np.maximum(found, 1)
        return (
            100 * float(np.sqrt(det * ass).mean()),
            100 * (hits - extras - switches) / true,
            200 * idtp / (true + told),
        )

    def told(self, what: str) -> tuple[Floats, NDArray[np.bool_]]:
        """What was said of ``confidence`` or ``identity``, and whether it was right."""
        return (self.known, self.same) if what == "identity" else (self.sure, self.right)


def judged(truth: MotTable, table: MotTable, identity: Floats | None = None) -> Result:
    """Count what a result has right; ``identity`` as its rows."""
    truth = truth.select(truth.confidences > 0)
    s, both = evaluate(truth, table), overlap(truth, table)
    rows = _parts(s.hota, len(truth), len(table))
    right = np.zeros(len(table), np.bool_)
    pairs = match(both, 0.5).pairs
    rows_hit, rows_true = both.result_row[pairs], both.true_row[pairs]
    right[rows_hit] = True
    c = s.clear
    counts = [
        len(truth), c.true_positives, c.false_positives, c.switches, s.identity.idtp, len(table)
    ]  # fmt: skip
    order = np.argsort(both.result.frames[rows_hit], kind="stable")
    begun: dict[int, int] = {}
    same = [
        begun.setdefault(track, person) == person
        for track, person in zip(
            both.result.ids[rows_hit][order].tolist(),
            both.truth.ids[rows_true][order].tolist(),
            strict=True,
        )
    ]
    identity = np.ones(len(table)) if identity is None else identity
    return Result(
        np.array(counts, np.float64),
        np.array(rows),
        both.result.confidences,
        right,
        identity[rows_hit][order],
        np.array(same, np.bool_),
        both.result.ids[rows_hit][order].astype(np.int64),
    )


def _parts(hota: Hota, truth: int, told: int) -> list[list[float]]:
    """Hits by alpha from DetA: hits / (true + told - hits)."""
    rows = []
    for det, ass in zip(hota.det_a_alpha, hota.ass_a_alpha, strict=True):
        share = det / 100
        hits = share * (truth + told) / (1 + share)
        rows.append([hits, told, truth, hits * ass / 100])
    return rows


def pooled(results: Sequence[Result]) -> Result:
    """Several sequences as one."""
    return Result(
        np.sum([r.counts for r in results], axis=0),
        np.sum([r.parts for r in results], axis=0),
        np.concatenate([r.sure for r in results]),
        np.concatenate([r.right for r in results]),
        np.concatenate([r.known for r in results]),
        np.concatenate([r.same for r in results]),
        np.concatenate([r.whose + 10**6 * k for k, r in enumerate(results)]),
    )


def curve(
    said: Floats, right: NDArray[np.bool_]
) -> tuple[list[tuple[float, float, int]], float]:
    """(mean said, share that is right, boxes) by tenths, and the calibration error."""
    rows, off = [], 0.0
    tenth = np.minimum((said * 10).astype(np.intp), 9)
    for k in range(10):
        here = tenth == k
        if here.any():
            mean, true = float(said[here].mean()), float(right[here].mean())
            rows.append((mean, true, int(here.sum())))
            off += abs(mean - true) * int(here.sum())
    return rows, off / max(1, len(said))


def expected(result: Result, times: int = 200) -> float:
    """The calibration error that identities would show if all of them were right: each track is
    lost for good somewhere, as likely as its identity says.
    """
    _, track = np.unique(result.whose, return_inverse=True)
    random = np.random.default_rng(0)
    errors = [
        curve(result.known, result.known >= random.random(track.max() + 1)[track])[1]
        for _ in range(times)
    ]
    return float(np.mean(errors))


def tracked(name: str, log: Path, tracker: str, settings: Sequence[str]) -> Result:
    """A sequence through one tracker."""
    return judged(truth_of(name), *told_of(log, tracker, settings))


def truth_of(name: str) -> MotTable:
    """A sequence's truth."""
    return read_truth(DATA / SEQUENCES[name][0] / "gt.txt")


def told_of(
    log: Path, tracker: str, settings: Sequence[str] = ()
) -> tuple[MotTable, Floats]:
    """What a tracker tells of a scene log, and the identity of its rows."""
    out = log.with_suffix(".annotated.mcap")
    config = replay_config(tracker, assignments=settings)
    replay(
        log,
        out,
        ReplayOptions(tracker=tracker, config=config, annotations_only=True, force=True),
    )
    with AnnotatedLog(out) as annotated:
        return read_tracks(annotated).table, identities(annotated)


def identities(annotated: AnnotatedLog) -> Floats:
    """The identity of every present track, in the order of `read_tracks`."""
    return np.array(
        [
            track.identity
            for frame in annotated.frames(("tracks",))
            for track in frame.tracks
            if track.present
        ]
    )


def plain(name: str, least: float) -> Result:
    """The same sequence through plain SORT, detections of lower scores thrown away first."""
    rows = np.loadtxt(
        DATA / SEQUENCES[name][0] / "det.txt", delimiter=",", usecols=range(7)
    )
    sort, told = PlainSort(), []
    for frame in range(int(rows[:, 0].max())):
        here = rows[(rows[:, 0] == frame + 1) & (rows[:, 6] >= least)]
        told += [(frame, i, *box, 1.0) for i, box in sort.step(here[:, 2:6])]
    return judged(truth_of(name), MotTable.from_rows(told))


def peer(name: str, sequence: str, least: float) -> Result:
    """A sequence through one of `PEERS`, detections of lower scores thrown away first."""
    where = DATA / SEQUENCES[sequence][0]
    rows = np.loadtxt(where / "det.txt", delimiter=",", usecols=range(7))
    # What byte throws away are beginnings, not detections.
    rows = rows if name == "byte" else rows[rows[:, 6] >= least]
    tracker, told = Peer(name, least), []
    for frame in range(int(rows[:, 0].max())):
        here = rows[rows[:, 0] == frame + 1]
        found = tracker.step(here[:, 2:6], here[:, 6])
        told += [(frame, identity, *box, 1.0) for identity, box in found]
    return judged(truth_of(sequence), MotTable.from_rows(told))


def compare_peers() -> None:
    """Every peer at every score, and the best of them by figure, the four together."""
    best = np.zeros(3)
    for name in ("sort", *PEERS):
        for least in PEERS_FROM:
            results = [
                plain(sequence, least) if name == "sort" else peer(name, sequence, least)
                for sequence in SEQUENCES
            ]
            best = np.maximum(best, pooled(results[:TOGETHER]).scores)
            print(line(f"{name} from {least}", results), flush=True)
    print("best of the peers, each figure its own: {:.1f}/{:.1f}/{:.1f}".format(*best))


def line(what: str, results: Sequence[Result]) -> str:
    """One row of the table: the four together, each sequence, mean and worst HOTA."""
    cells = [pooled(results[:TOGETHER]).scores, *(r.scores for r in results)]
    hota = [c[0] for c in cells[1:]]
    scores = "".join(f"{h:>8.1f}/{m:5.1f}/{i:4.1f}" for h, m, i in cells)
    return f"{what:24}{scores}{np.mean(hota):>7.1f}{min(hota):>7.1f}"


def recorded(folder: Path, first: int = 0) -> dict[str, Path]:
    """Scene logs by sequence; of its first frames alone."""
    logs = {}
    for name, (where, fps, size) in SEQUENCES.items():
        logs[name] = folder / f"{name}-{first}.mcap"
        detections = DATA / where / "det.txt"
        if first:
            rows = detections.read_text().splitlines(keepends=True)
            detections = folder / f"{name}-{first}.txt"
            detections.write_text("".join(r for r in rows if int(r.split(",")[0]) <= first))
        source = open_source(detections, fps=fps, size=size)
        record(source, logs[name], RecordOptions(force=True))
    return logs


def begun(folder: Path, tracker: str, first: int) -> None:
    """The first frames of each sequence, as recorded alone and as told within the whole."""
    within, alone = recorded(folder), recorded(folder, first)
    names = [name for name in SEQUENCES if name != "TUD-Campus"]  # it has no more than that
    off = []
    for name in names:
        truth = truth_of(name)
        truth = truth.select(truth.frames < first)
        table, _ = told_of(within[name], tracker)
        whole = judged(truth, table.select(table.frames < first)).scores
        short = judged(truth, told_of(alone[name], tracker)[0]).scores
        off.append([s - w for s, w in zip(short, whole, strict=True)])
        print(
            f"{tracker:8}{name:14} alone {'/'.join(f'{s:.1f}' for s in short)}, within the whole"
            f" {'/'.join(f'{w:.1f}' for w in whole)}",
            flush=True,
        )
    mean, worst = np.mean(off, axis=0), np.min(off, axis=0)
    print(
        f"{tracker:8}alone less within: mean {'/'.join(f'{m:+.1f}' for m in mean)},"
        f" worst {'/'.join(f'{w:+.1f}' for w in worst)}"
    )


def shaken(logs: dict[str, Path], tracker: str) -> None:
    """What 5 % more or less of each parameter does to the mean HOTA over the sequences."""

    def mean(settings: Sequence[str]) -> float:
        return float(
            np.mean(
                [tracked(n, log, tracker, settings).scores[0] for n, log in logs.items()]
            )
        )

    base = mean(())
    print(f"{tracker}: mean HOTA {base:.2f}; by 5 % less, by 5 % more:")
    config = replay_config(tracker)
    for section in (tracker, "hindsight"):
        for name, value in as_plain(config)[section].items():
            if isinstance(value, float) and value:
                low, high = (mean([f"{section}.{name}={value * f}"]) for f in (0.95, 1.05))
                print(
                    f"  {section}.{name:24}{low - base:>+7.2f}{high - base:>+7.2f}",
                    flush=True,
                )


def main() -> int:
    """All trackers, all sequences."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trackers", nargs="*", default=["events", "shells", "parts"])
    parser.add_argument("--set", nargs="*", default=[], metavar="KEY=VALUE")
    parser.add_argument("--thresholds", nargs="*", type=float, default=[0.0, 0.7, 0.9])
    parser.add_argument("--peers", action="store_true")
    parser.add_argument("--parameters", action="store_true")
    parser.add_argument("--first", type=int, default=0, metavar="FRAMES")
    args = parser.parse_args()
    if not (DATA / "mot15").exists():
        print(f"no MOT15 at {DATA}; set SCENETRACE_DATA", file=sys.stderr)
        return 0
    with TemporaryDirectory() as temporary:
        if args.first:
            for tracker in args.trackers:
                begun(Path(temporary), tracker, args.first)
            return 0
        logs = recorded(Path(temporary))
        if args.parameters:
            for tracker in args.trackers:
                shaken(logs, tracker)
            return 0
        print(
            f"{'HOTA/MOTA/IDF1':24}"
            + "".join(f"{n:>19}" for n in ("together", *SEQUENCES)),
            "  mean  worst",
        )
        for least in args.thresholds:
            print(
                line(f"plain SORT from {least}", [plain(n, least) for n in SEQUENCES]),
                flush=True,
            )
        if args.peers:
            compare_peers()
        for tracker in args.trackers:
            results = [tracked(n, log, tracker, args.set) for n, log in logs.items()]
            print(line(tracker, results), flush=True)
            for what in ("confidence", "identity"):
                rows, off = curve(*pooled(results).told(what))
                each = [f"{curve(*r.told(what))[1]:.3f}" for r in results]
                if what == "identity":
                    each = [
                        f"{e} ({expected(r):.3f})"
                        for e, r in zip(each, results, strict=True)
                    ]
                print(
                    f"  calibration error of {what} {off:.3f}, of each "
                    + ", ".join(each)
                    + "; told, right, boxes: "
                    + ", ".join(f"{s:.2f} {t:.2f} {n}" for s, t, n in rows)
                )
    return 0


if __name__ == "__main__":
    sys.exit(main())
