"""CLEAR MOT scores: Bernardin and Stiefelhagen 2008, with the matching of TrackEval.

In every frame a true identity first keeps the result identity that it had in the frame before, if
they still overlap enough; what is left is matched so that the overlap is largest.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from replay.evaluate.overlap import EPS, Overlap
from replay.evaluate.truth import IntArray

KEEP_BONUS = 1000.0
NONE = -1


@dataclass(frozen=True)
class Clear:
    """CLEAR scores; shares in percent.

    ``motp`` is the mean overlap of the matches. Mostly tracked: more than 80 % of its frames
    matched; mostly lost: less than 20 % (PARTS draws its line at 40 %, see `trajectories`);
    partly tracked: the rest.
    """

    mota: float
    motp: float
    recall: float
    precision: float
    true_positives: int
    false_positives: int
    false_negatives: int
    switches: int
    fragments: int
    mostly_tracked: int
    partly_tracked: int
    mostly_lost: int


@dataclass(frozen=True, eq=False)
class Matches:
    """Which boxes were matched.

    Attributes:
        pairs: (M,) int64 positions of the matched pairs in the `Overlap`, by frame.
        switched: (M,) bool, the true identity's last match was another result identity.
        fragments: (true identities,) how often it was found again after a gap.
    """

    pairs: IntArray
    switched: NDArray[np.bool_]
    fragments: IntArray


def match(both: Overlap, iou: float) -> Matches:
    """Match frame by frame, keeping what was matched in the frame before."""
    n = both.shape[0]
    last, before = np.full(n, NONE), np.full(n, NONE)
    found = np.zeros(n, np.int64)
    pairs: list[IntArray] = []
    switched: list[NDArray[np.bool_]] = []
    rows, columns = np.diff(both.true_start), np.diff(both.result_start)
    # A frame with only truth or only results leaves the memory of the frame before untouched, as
    # in TrackEval.
    for k in np.flatnonzero((rows > 0) & (columns > 0)).tolist():
        begin, end = int(both.start[k]), int(both.start[k + 1])
        true = both.true_ids[both.true_start[k] : both.true_start[k + 1]]
        result = both.result_ids[both.result_start[k] : both.result_start[k + 1]]
        similarity = both.iou[begin:end].reshape(len(true), len(result))
        score = KEEP_BONUS * (result[None, :] == before[true][:, None]) + similarity
        score[similarity < iou - EPS] = 0
        r, c = linear_sum_assignment(score, maximize=True)
        hit = score[r, c] > EPS
        r, c = r[hit], c[hit]
        who, by = true[r], result[c]
        pairs.append(begin + r * len(result) + c)
        switched.append((last[who] != NONE) & (last[who] != by))
        found[who[before[who] == NONE]] += 1
        last[who] = by
        before[:] = NONE
        before[who] = by
    return Matches(
        np.concatenate(pairs).astype(np.int64) if pairs else np.zeros(0, np.int64),
        np.concatenate(switched) if switched else np.zeros(0, np.bool_),
        np.maximum(found - 1, 0),
    )


def clear(both: Overlap, matches: Matches) -> Clear:
    """Score the result by CLEAR MOT."""
    truth, result, hits = len(both.truth), len(both.result), len(matches.pairs)
    switches = int(np.count_nonzero(matches.switched))
    n = both.shape[0]
    rows = np.bincount(both.true_ids, minlength=n)
    matched = np.bincount(both.true_ids[both.true_row[matches.pairs]], minlength=n)
    share = matched / np.maximum(rows, 1)
    mostly = int(np.count_nonzero(share > 0.8))
    partly = int(np.count_nonzero(share >= 0.2)) - mostly
    misses, extras = truth - hits, result - hits
    return Clear(
        mota=100 * (hits - extras - switches) / truth if truth else 0.0,
        motp=100 * float(both.iou[matches.pairs].sum()) / max(1, hits),
        recall=100 * hits / max(1, truth),
        precision=100 * hits / max(1, result),
        true_positives=hits,
        false_positives=extras,
        false_negatives=misses,
        switches=switches,
        fragments=int(matches.fragments.sum()),
        mostly_tracked=mostly,
        partly_tracked=partly,
        mostly_lost=n - mostly - partly,
    )
