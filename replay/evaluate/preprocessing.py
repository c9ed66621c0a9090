"""MOTChallenge's preprocessing, as TrackEval does it: what a truth says is not to be judged.

MOT16 and later label every row with a class. Pedestrians (class 1) are judged. Results that lie on
a distractor (a person on a vehicle, who stands for good, a mannequin, a reflection) are taken out,
as are all rows of truth that are not marked to count. Truths without classes lose the latter alone.
Where a truth says that nobody was labelled (KITTI's DontCare, COCO's crowds), results that follow
nobody are taken out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from replay.evaluate.truth import BoolArray, FloatArray, MotTable

PEDESTRIAN = 1
DISTRACTORS = (2, 7, 8, 12)
_LEAST_IOU = 0.5


@dataclass(frozen=True)
class Prepared:
    """A truth and a result to be scored.

    Attributes:
        truth, result: what is left of them.
        dropped: results that lay on a distractor, or in what nobody labelled.
        ignored: rows of the truth that do not count.
    """

    truth: MotTable
    result: MotTable
    dropped: int
    ignored: int


def prepared(truth: MotTable, result: MotTable) -> Prepared:
    """Truth and result as TrackEval's MOTChallenge2DBox prepares them."""
    counting = truth.confidences != 0
    keep = np.ones(len(result), np.bool_)
    if truth.classes is not None:
        distracting = np.isin(truth.classes, DISTRACTORS)
        for frame in np.unique(truth.frames[distracting]).tolist():
            _drop(truth, result, distracting, keep, frame)
        counting &= truth.classes == PEDESTRIAN
    if truth.regions is not None:
        for frame in np.unique(truth.regions[:, 0]).tolist():
            _drop_unlabelled(truth, truth.regions, result, keep, int(frame))
    kept = truth.select(counting)
    return Prepared(
        kept, result.select(keep), int(np.count_nonzero(~keep)), len(truth) - len(kept)
    )


def _drop(
    truth: MotTable, result: MotTable, distracting: BoolArray, keep: BoolArray, frame: int
) -> None:
    """Take out the results of a frame that the best assignment puts on a distractor."""
    rows = np.flatnonzero(truth.frames == frame)
    found = np.flatnonzero(result.frames == frame)
    if not len(rows) or not len(found):
        return
    shares = _iou(truth.boxes[rows], result.boxes[found])
    shares[shares < _LEAST_IOU - np.finfo(float).eps] = 0
    for a, b in zip(*linear_sum_assignment(-shares), strict=True):
        if shares[a, b] > 0 and distracting[rows[a]]:
            keep[found[b]] = False


def _drop_unlabelled(
    truth: MotTable, regions: FloatArray, result: MotTable, keep: BoolArray, frame: int
) -> None:
    """Take out the results of a frame that lie in what nobody labelled and follow nobody who is,
    as TrackEval's Kitti2DBox does.
    """
    found = np.flatnonzero(result.frames == frame)
    if not len(found):
        return
    rows = np.flatnonzero(truth.frames == frame)
    followed = np.zeros(len(found), np.bool_)
    if len(rows):
        shares = _iou(truth.boxes[rows], result.boxes[found])
        shares[shares < _LEAST_IOU - np.finfo(float).eps] = 0
        for a, b in zip(*linear_sum_assignment(-shares), strict=True):
            followed[b] = shares[a, b] > 0
    inside = _own_share(result.boxes[found], regions[regions[:, 0] == frame, 1:])
    keep[found[(inside.max(axis=1) > _LEAST_IOU) & ~followed]] = False


def _own_share(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N, M) how much of each of (N, 4) boxes lies in each of (M, 4) boxes."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0), axis=2)
    areas = np.prod(a[:, 2:], axis=1)[:, None]
    return np.asarray(shared / np.where(areas > 0, areas, 1.0), np.float64)


def _iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """(N, M) intersection over union of (N, 4) and (M, 4) boxes x, y, w, h."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0), axis=2)
    areas = np.prod(a[:, 2:], axis=1)[:, None] + np.prod(b[:, 2:], axis=1)[None, :]
    whole: FloatArray = areas - shared
    return np.asarray(shared / np.where(whole > 0, whole, 1.0), np.float64)
