"""SORT as everybody writes it: constant velocity, overlap, one assignment; blind to colours. The
peer in benchmarks.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import assign, iou
from replay.trackers.kalman import KalmanBank

Floats = NDArray[np.float64]


class PlainSort:
    """Bewley et al. 2016: boxes in, (id, box) out; a track that misses ``max_age`` frames ends."""

    def __init__(self, max_age: int = 5, min_hits: int = 3, min_iou: float = 0.2) -> None:
        self._max_age, self._min_hits, self._min_iou = max_age, min_hits, min_iou
        self._bank = KalmanBank(4)
        self._ids: list[int] = []
        self._hits: list[int] = []
        self._missed: list[int] = []
        self._next = 1
        self._frames = 0

    @property
    def boxes(self) -> Floats:
        """Estimated boxes, (N, 4)."""
        v = self._bank.value
        return np.stack(
            [v[:, 0] - v[:, 2] / 2, v[:, 1] - v[:, 3] / 2, v[:, 2], v[:, 3]], axis=1
        )

    def step(
        self, detections: Floats
    ) -> list[tuple[int, tuple[float, float, float, float]]]:
        """One frame's detections (M, 4); the tracks that were seen in it."""
        self._frames += 1
        size = np.sqrt(np.maximum(self._bank.value[:, 2] * self._bank.value[:, 3], 1.0))[
            :, None
        ]
        self._bank.predict(1.0, (size * np.array([0.02, 0.02, 0.01, 0.01])) ** 2)
        overlap = iou(self.boxes, detections)
        pairs = assign(1.0 - overlap, overlap >= self._min_iou)
        centred = np.concatenate(
            [detections[:, :2] + detections[:, 2:] / 2, detections[:, 2:]], axis=1
        )
        self._missed = [m + 1 for m in self._missed]
        for row, column in pairs:
            box = detections[column]
            noise = 0.05 * float(np.sqrt(box[2] * box[3]))
            self._bank.update(np.array([row]), centred[column][None], noise * noise)
            self._hits[row] += 1
            self._missed[row] = 0
        for column in sorted(set(range(len(detections))) - {c for _, c in pairs}):
            noise = 0.05 * float(np.sqrt(detections[column, 2] * detections[column, 3]))
            self._bank.add(
                centred[column], np.full(4, noise * noise), np.full(4, (4 * noise) ** 2)
            )
            self._ids.append(self._next)
            self._hits.append(1)
            self._missed.append(0)
            self._next += 1
        keep = [k for k, missed in enumerate(self._missed) if missed <= self._max_age]
        self._bank.keep(np.array(keep, np.intp))
        self._ids, self._hits, self._missed = (
            [values[k] for k in keep] for values in (self._ids, self._hits, self._missed)
        )
        shown = [
            k
            for k in range(len(keep))
            if self._missed[k] == 0
            and (self._hits[k] >= self._min_hits or self._frames <= self._min_hits)
        ]
        return [(self._ids[k], tuple(self.boxes[k].tolist())) for k in shown]
