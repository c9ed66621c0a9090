"""HOTA: Luiten et al., HOTA: A Higher Order Metric for Evaluating Multi-Object Tracking, IJCV 2020.

Figures are those of TrackEval: one assignment per frame that favours pairs of identities which
agree over the whole recording, then a threshold alpha on the overlap from 0.05 to 0.95.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from replay.evaluate.overlap import EPS, Overlap
from replay.evaluate.truth import FloatArray, IntArray

ALPHAS = np.arange(0.05, 0.99, 0.05)


@dataclass(frozen=True)
class Hota:
    """HOTA and its parts in percent: means over all alphas, and HOTA, DetA, AssA, LocA at each of
    `alphas`.
    """

    hota: float
    det_a: float
    ass_a: float
    loc_a: float
    det_re: float
    det_pr: float
    ass_re: float
    ass_pr: float
    alphas: tuple[float, ...]
    hota_alpha: tuple[float, ...]
    det_a_alpha: tuple[float, ...]
    ass_a_alpha: tuple[float, ...]
    loc_a_alpha: tuple[float, ...]


def hota(both: Overlap) -> Hota:
    """Score the result against the truth by HOTA."""
    matched = _match(both)
    true_count, result_count = both.counts()
    similarity = both.iou[matched]
    parts = np.array(
        [
            _at(both, matched, similarity, alpha, true_count, result_count)
            for alpha in ALPHAS
        ]
    )
    det_a, ass_a, loc_a, det_re, det_pr, ass_re, ass_pr = (100 * parts.T).tolist()
    each = (100 * np.sqrt(parts[:, 0] * parts[:, 1])).tolist()
    return Hota(
        hota=float(np.mean(each)),
        det_a=float(np.mean(det_a)),
        ass_a=float(np.mean(ass_a)),
        loc_a=float(np.mean(loc_a)),
        det_re=float(np.mean(det_re)),
        det_pr=float(np.mean(det_pr)),
        ass_re=float(np.mean(ass_re)),
        ass_pr=float(np.mean(ass_pr)),
        alphas=tuple(round(float(a), 2) for a in ALPHAS),
        hota_alpha=tuple(each),
        det_a_alpha=tuple(det_a),
        ass_a_alpha=tuple(ass_a),
        loc_a_alpha=tuple(loc_a),
    )


def _match(both: Overlap) -> IntArray:
    """The pairs that are matched, before any threshold: IJCV 2020, section 5 (as TrackEval does
    it).
    """
    alignment = _alignment(both)
    score = (
        alignment[both.true_ids[both.true_row], both.result_ids[both.result_row]] * both.iou
    )
    chosen: list[IntArray] = []
    rows, columns = np.diff(both.true_start), np.diff(both.result_start)
    for k in np.flatnonzero((rows > 0) & (columns > 0)).tolist():
        begin, end = int(both.start[k]), int(both.start[k + 1])
        r, c = linear_sum_assignment(
            score[begin:end].reshape(rows[k], columns[k]), maximize=True
        )
        chosen.append(begin + r * columns[k] + c)
    return np.concatenate(chosen).astype(np.int64) if chosen else np.zeros(0, np.int64)


def _alignment(both: Overlap) -> FloatArray:
    """How well each two identities agree over the recording: (true identities, result
    identities), in [0, 1].
    """
    per_true = np.bincount(both.true_row, both.iou, minlength=len(both.truth))
    per_result = np.bincount(both.result_row, both.iou, minlength=len(both.result))
    rest = per_true[both.true_row] + per_result[both.result_row] - both.iou
    share = np.where(rest > EPS, both.iou, 0.0) / np.where(rest > EPS, rest, 1.0)
    potential = both.per_identity(np.arange(len(both.iou)), share)
    true_count, result_count = both.counts()
    return potential / (true_count + result_count - potential)


def _at(
    both: Overlap,
    matched: IntArray,
    similarity: FloatArray,
    alpha: float,
    true_count: FloatArray,
    result_count: FloatArray,
) -> tuple[float, ...]:
    """DetA, AssA, LocA, DetRe, DetPr, AssRe, AssPr at one alpha, in [0, 1]."""
    hit = similarity >= alpha - EPS
    hits = int(np.count_nonzero(hit))
    truth, result = len(both.truth), len(both.result)
    # LocA of nothing is 1: nothing is badly placed.
    loc_a = max(1e-10, float(similarity[hit].sum())) / max(1e-10, hits)
    count = both.per_identity(matched[hit])
    weighted = count * count
    total = max(1, hits)
    return (
        hits / max(1, truth + result - hits),
        float(np.sum(weighted / np.maximum(1, true_count + result_count - count))) / total,
        loc_a,
        hits / max(1, truth),
        hits / max(1, result),
        float(np.sum(weighted / np.maximum(1, true_count))) / total,
        float(np.sum(weighted / np.maximum(1, result_count))) / total,
    )
