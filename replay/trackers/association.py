"""Gated data association: boxes' overlaps, and one assignment solver with a written tie rule.

The tie rule: costs are quantised to multiples of 2**-20 before solving, and among assignments of
equal quantised cost the solver of `scipy.optimize.linear_sum_assignment` sees rows and columns in
index order (rows: targets by id; columns: detections in the order of the recording). Its result
depends on nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box

Floats = NDArray[np.float64]
QUANTUM = 2.0**-20
FORBIDDEN = 2.0**20


def sizes_of(state: Floats) -> Floats:
    """Square roots of width times height, (N,) pixels, of states or boxes (N, 4 or more): x, y,
    width, height.
    """
    return np.asarray(np.sqrt(np.maximum(state[:, 2] * state[:, 3], 1.0)))


def boxes_of(state: Floats) -> Floats:
    """The boxes (N, 4): x, y, w, h of such states."""
    return np.concatenate([state[:, :2] - state[:, 2:4] / 2, state[:, 2:4]], axis=1)


def intersection(a: Floats, b: Floats) -> Floats:
    """Pairwise intersection areas of boxes (N, 4) and (M, 4) [x, y, w, h], (N, M) in square
    pixels.
    """
    side = np.maximum(_common(*_axes(a, b)), 0.0)
    return np.asarray(side[0] * side[1])


def _axes(a: Floats, b: Floats) -> tuple[Floats, Floats]:
    """Boxes (N, 4) and (M, 4) by axis, (4, N, 1) and (4, 1, M): both axes' overlap in one step, as
    of few boxes the steps cost and not the pairs; in memory so that of many the pairs of an
    axis stand together.
    """
    return a.T.copy()[:, :, None], b.T.copy()[:, None]


def _common(a: Floats, b: Floats) -> Floats:
    """How far boxes (`_axes`) reach into one another along x and y, (2, N, M) pixels; below 0: how
    far they are apart.
    """
    side = np.minimum(a[:2] + a[2:], b[:2] + b[2:])
    side -= np.maximum(a[:2], b[:2])
    return np.asarray(side)


def iou(a: Floats, b: Floats) -> Floats:
    """Pairwise intersection over union of boxes (N, 4) and (M, 4), (N, M) in [0, 1]."""
    inside = intersection(a, b)
    union = (a[:, 2] * a[:, 3])[:, None] + (b[:, 2] * b[:, 3])[None, :] - inside
    return np.asarray(inside / np.maximum(union, 1e-12))


def widened_iou(a: Floats, b: Floats, by: Floats) -> Floats:
    """Pairwise intersection over union, (N, M), of boxes (N, 4) and (M, 4) that are both wider by
    ``by`` (N, 2) pixels on the left and the right, at the top and the bottom.

    Boxes of somebody who went further than his own width do not overlap; widened ones do (Yang
    et al. 2023, "Hard to Track Objects with Irregular Motions ...", buffered IoU).
    """
    of_a, of_b = _axes(a, b)
    wider = (2 * by.T.copy())[:, :, None]
    side = np.maximum(_common(of_a, of_b) + wider, 0.0)
    inside = side[0] * side[1]
    of_a, of_b = of_a[2:] + wider, of_b[2:] + wider
    union = of_a[0] * of_a[1] + of_b[0] * of_b[1] - inside
    return np.asarray(inside / np.maximum(union, 1e-12))


def overlaps(boxes: Sequence[Box]) -> list[tuple[int, int, float]]:
    """Pairs (i, j), i < j, ascending, of boxes that overlap, and their intersection in square
    pixels: of many boxes few do, so that no table of all pairs is made.

    >>> overlaps([(0.0, 0.0, 4.0, 4.0), (9.0, 0.0, 1.0, 1.0), (2.0, 3.0, 4.0, 4.0)])
    [(0, 2, 2.0)]
    """
    order = sorted(range(len(boxes)), key=lambda k: boxes[k][0])
    found: list[tuple[int, int, float]] = []
    for place, i in enumerate(order):
        x, y, w, h = boxes[i]
        right, bottom = x + w, y + h
        for index in range(place + 1, len(order)):
            j = order[index]
            left, top, wide, high = boxes[j]
            if left >= right:
                break
            wide = min(right, left + wide) - left
            high = min(bottom, top + high) - max(y, top)
            if wide > 0.0 and high > 0.0:
                found.append((i, j, wide * high) if i < j else (j, i, wide * high))
    found.sort()
    return found


def iou_of_pairs(a: Floats, b: Floats) -> Floats:
    """Intersection over union of boxes (N, 4) and (N, 4), one by one, (N,) in [0, 1]."""
    low, high = (
        np.maximum(a[:, :2], b[:, :2]),
        np.minimum(a[:, :2] + a[:, 2:], b[:, :2] + b[:, 2:]),
    )
    size = np.maximum(high - low, 0.0)
    inside = size[:, 0] * size[:, 1]
    union = a[:, 2] * a[:, 3] + b[:, 2] * b[:, 3] - inside
    return np.asarray(inside / np.maximum(union, 1e-12))


def assign(cost: Floats, allowed: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Match rows to columns: as many allowed pairs as possible, of least total cost, by the
    module's tie rule.

    Args:
        cost: (N, M) finite costs, in [-1000, 1000].
        allowed: (N, M) the gate; pairs outside are never matched.

    Returns:
        Matched (row, column) pairs by row.
    """
    if cost.size == 0 or not allowed.any():
        return []
    rows, columns = np.nonzero(allowed)
    if len(set(rows.tolist())) == len(rows) == len(set(columns.tolist())):
        return list(zip(rows.tolist(), columns.tolist(), strict=True))  # nobody competes
    from replay.assignment import linear_sum_assignment

    quantised = np.rint(np.minimum(np.maximum(cost, -1000.0), 1000.0) / QUANTUM) * QUANTUM
    rows, columns = linear_sum_assignment(np.where(allowed, quantised, FORBIDDEN))
    return [
        (int(row), int(column))
        for row, column in zip(rows, columns, strict=True)
        if allowed[row, column]
    ]


def clusters(rows: list[int], linked: NDArray[np.bool_]) -> list[list[int]]:
    """Rows that have columns of ``linked`` (N, M) in common, directly or through others; by the
    least of each.

    >>> clusters([0, 1, 2], np.array([[True, False], [False, True], [True, False]]))
    [[0, 2], [1]]
    """
    found: list[tuple[list[int], NDArray[np.bool_]]] = []
    for row in rows:
        together, columns = [row], linked[row].copy()
        rest = []
        for members, theirs in found:
            if bool((theirs & columns).any()):
                together, columns = members + together, theirs | columns
            else:
                rest.append((members, theirs))
        found = [*rest, (together, columns)]
    return [sorted(members) for members, _ in sorted(found, key=lambda c: min(c[0]))]
