"""SORT, written here for comparison: the tracker alone, one filterpy filter per object, as its
paper describes it.

A. Bewley, Z. Ge, L. Ott, F. Ramos, B. Upcroft, "Simple online and realtime tracking", ICIP 2016,
section 3: state (u, v, s, r, u', v', s') of centre, area and aspect ratio; Hungarian assignment
on IoU of at least 0.3; a track is reported after three hits in a row and dropped after one frame
without.
"""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from filterpy.kalman import KalmanFilter

Boxes = NDArray[np.float64]
MIN_IOU, MIN_HITS, MAX_AGE = 0.3, 3, 1


def iou(a: Boxes, b: Boxes) -> Boxes:
    """Overlap of boxes (n, 4) with boxes (m, 4), both x, y, w, h: (n, m)."""
    ax, ay, aw, ah = (a[:, None, k] for k in range(4))
    bx, by, bw, bh = (b[None, :, k] for k in range(4))
    w = np.minimum(ax + aw, bx + bw) - np.maximum(ax, bx)
    h = np.minimum(ay + ah, by + bh) - np.maximum(ay, by)
    shared = np.maximum(w, 0) * np.maximum(h, 0)
    return np.asarray(shared / (aw * ah + bw * bh - shared))


class Object:
    """One tracked object with its filter."""

    def __init__(self, identity: int, box: Boxes) -> None:
        self.id, self.hits, self.age = identity, 0, 0
        f = self.filter = KalmanFilter(dim_x=7, dim_z=4)
        f.F = np.eye(7)
        f.F[0, 4] = f.F[1, 5] = f.F[2, 6] = 1
        f.H = np.eye(4, 7)
        f.R[2:, 2:] *= 10
        f.P[4:, 4:] *= 1000
        f.P *= 10
        f.Q[-1, -1] *= 0.01
        f.Q[4:, 4:] *= 0.01
        f.x[:4] = self._measured(box)

    @staticmethod
    def _measured(box: Boxes) -> Boxes:
        x, y, w, h = box
        return np.array([[x + w / 2], [y + h / 2], [w * h], [w / h]])

    def predict(self) -> Boxes:
        """Its box in the next frame."""
        if self.filter.x[6] + self.filter.x[2] <= 0:
            self.filter.x[6] = 0
        self.filter.predict()
        self.hits = 0 if self.age > 0 else self.hits
        self.age += 1
        return self.box()

    def update(self, box: Boxes) -> None:
        """It was seen."""
        self.age = 0
        self.hits += 1
        self.filter.update(self._measured(box))

    def box(self) -> Boxes:
        """Its box now."""
        u, v, s, r = self.filter.x[:4, 0]
        w = np.sqrt(max(s * r, 1e-9))
        h = s / w
        return np.array([u - w / 2, v - h / 2, w, h])


class Sort:
    """All objects."""

    def __init__(self) -> None:
        self.objects: list[Object] = []
        self.frame = self.count = 0

    def step(self, boxes: Boxes) -> list[tuple[int, Boxes]]:
        """Identities and boxes of one frame; ``boxes`` (n, 4): x, y, w, h."""
        self.frame += 1
        predicted = np.array([o.predict() for o in self.objects]).reshape(-1, 4)
        matched = np.zeros(len(boxes), bool)
        if len(predicted) and len(boxes):
            overlap = iou(boxes, predicted)
            for d, t in zip(*linear_sum_assignment(-overlap), strict=True):
                if overlap[d, t] >= MIN_IOU:
                    matched[d] = True
                    self.objects[t].update(boxes[d])
        for d in np.flatnonzero(~matched):
            self.count += 1
            self.objects.append(Object(self.count, boxes[d]))
        early = self.frame <= MIN_HITS
        found = [
            (o.id, o.box())
            for o in self.objects
            if o.age == 0 and (o.hits >= MIN_HITS or early)
        ]
        self.objects = [o for o in self.objects if o.age <= MAX_AGE]
        return found
