"""Truth and result side by side: identities from 0 without gaps, and the overlap of every pair
within a frame.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from replay.evaluate.truth import FloatArray, IntArray, MotTable

EPS = float(np.finfo(np.float64).eps)


@dataclass(frozen=True, eq=False)
class Overlap:
    """All pairs of a true and a result box of the same frame, frame by frame, true rows first.

    Frame k of `frames` has the true rows ``true_start[k]:true_start[k + 1]``, the result rows
    ``result_start[k]:result_start[k + 1]`` and the pairs ``start[k]:start[k + 1]``, which are its
    (true rows, result rows) matrix row by row.

    Attributes:
        truth, result: the tables.
        frames: (F,) frames in which either has a row, ascending.
        true_ids, result_ids: identities as positions in `true_names` and `result_names`, per row.
        true_names, result_names: the identities that occur, ascending.
        true_start, result_start, start: (F + 1,) bounds of a frame's rows and pairs.
        true_row, result_row: (P,) rows of each pair.
        iou: (P,) intersection over union.
    """

    truth: MotTable
    result: MotTable
    frames: IntArray
    true_names: IntArray
    result_names: IntArray
    true_ids: IntArray
    result_ids: IntArray
    true_start: IntArray
    result_start: IntArray
    start: IntArray
    true_row: IntArray
    result_row: IntArray
    iou: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """How many true and how many result identities there are."""
        return len(self.true_names), len(self.result_names)

    def matrix(self, k: int) -> FloatArray:
        """The (true rows, result rows) overlap of frame k."""
        rows = int(self.true_start[k + 1] - self.true_start[k])
        return (
            self.iou[self.start[k] : self.start[k + 1]].reshape(rows, -1)
            if rows
            else np.zeros((0, 0))
        )

    def per_identity(
        self, pairs: IntArray, weights: FloatArray | None = None
    ) -> FloatArray:
        """Sum over pairs (indices) into a (true identities, result identities) table."""
        n, m = self.shape
        cells = (
            self.true_ids[self.true_row[pairs]] * m
            + self.result_ids[self.result_row[pairs]]
        )
        return np.bincount(cells, weights, minlength=n * m).astype(np.float64).reshape(n, m)

    def counts(self) -> tuple[FloatArray, FloatArray]:
        """How many rows each true (n, 1) and each result identity (1, m) has."""
        n, m = self.shape
        true = np.bincount(self.true_ids, minlength=n).astype(np.float64)
        result = np.bincount(self.result_ids, minlength=m).astype(np.float64)
        return true[:, None], result[None, :]


def overlap(truth: MotTable, result: MotTable) -> Overlap:
    """Put truth and result side by side."""
    frames = np.union1d(truth.frames, result.frames)
    true_names, true_ids = np.unique(truth.ids, return_inverse=True)
    result_names, result_ids = np.unique(result.ids, return_inverse=True)
    true_start = np.searchsorted(truth.frames, np.append(frames, frames[-1:] + 1))
    result_start = np.searchsorted(result.frames, np.append(frames, frames[-1:] + 1))
    if not len(frames):
        true_start = result_start = np.zeros(1, np.int64)
    n, m = np.diff(true_start), np.diff(result_start)
    start = np.concatenate([[0], np.cumsum(n * m)])
    # Within a frame, pair p is row p // m, column p % m.
    frame_of = np.repeat(np.arange(len(frames)), n * m)
    place = np.arange(start[-1]) - start[frame_of]
    true_row = true_start[frame_of] + place // np.maximum(m, 1)[frame_of]
    result_row = result_start[frame_of] + place % np.maximum(m, 1)[frame_of]
    iou = box_iou(truth.boxes[true_row], result.boxes[result_row])
    return Overlap(
        truth,
        result=result,
        frames=frames,
        true_names=true_names,
        result_names=result_names,
        true_ids=true_ids,
        result_ids=result_ids,
        true_start=true_start,
        result_start=result_start,
        start=start,
        true_row=true_row,
        result_row=result_row,
        iou=iou,
    )


def box_iou(a: FloatArray, b: FloatArray) -> FloatArray:
    """Intersection over union of boxes row by row, (P, 4) each: x, y, w, h; 0 where a box has no
    area.
    """
    a_end, b_end = a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]
    side = np.maximum(np.minimum(a_end, b_end) - np.maximum(a[:, :2], b[:, :2]), 0)
    common = side[:, 0] * side[:, 1]
    a_side, b_side = a_end - a[:, :2], b_end - b[:, :2]
    a_area, b_area = a_side[:, 0] * a_side[:, 1], b_side[:, 0] * b_side[:, 1]
    union = a_area + b_area - common
    valid = (a_area > EPS) & (b_area > EPS) & (union > EPS)
    return np.where(valid, common, 0.0) / np.where(valid, union, 1.0)
