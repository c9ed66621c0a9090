"""One box for each thing: of boxes of one class that overlap, the best stays (greedy non-maximum
suppression).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
MOST_BOXES = 3000
"""Of more boxes before suppression, the best are looked at."""


def suppress(corners: Floats, scores: Floats, classes: Rows, overlap: float) -> Rows:
    """Rows to keep, best score first (of equals the lower row).

    Args:
        corners: (N, 4) x1, y1, x2, y2.
        scores: (N,).
        classes: (N,); boxes of different classes never suppress one another.
        overlap: from this intersection over union on the worse box goes.
    """
    order = np.argsort(-scores, kind="stable")[:MOST_BOXES]
    kept: list[int] = []
    while len(order):
        best, rest = int(order[0]), order[1:]
        kept.append(best)
        same = classes[rest] == classes[best]
        over = overlaps(corners[best][None], corners[rest])[0] >= overlap
        order = rest[~(same & over)]
    return np.array(kept, np.intp)


def overlaps(a: Floats, b: Floats) -> Floats:
    """Intersection over union of boxes (N, 4) and (M, 4) by their corners, (N, M)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    size = np.maximum(high - low, 0.0)
    inside = size[..., 0] * size[..., 1]
    areas = _areas(a)[:, None] + _areas(b)[None, :]
    return np.asarray(inside / np.maximum(areas - inside, 1e-12))


def _areas(boxes: Floats) -> Floats:
    return np.asarray((boxes[:, 2] - boxes[:, 0]) * (boxes[:, 3] - boxes[:, 1]))
