"""Plane geometry of boxes, circles, ellipses and polygons, vectorised over targets.

Only additions, products, quotients, square roots and comparisons decide anything here, so that
every answer is the same on every machine. All regions are closed: what touches a border from
within lies inside.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from recorders.messages import Box, Ellipse

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]
Polygon = Sequence[tuple[float, float]]

OUTSIDE, PARTLY, WHOLLY = 0, 1, 2
"""How a box lies in an area: no common interior, some of it, all of it."""

_SEAM_PX = 1e-6
"""Polygons that share an edge leave no gap between them although their crossings are rounded
(slab test).
"""


def centres(boxes: ArrayLike) -> Floats:
    """Centres (N, 2) of boxes (N, 4)."""
    b = np.asarray(boxes, np.float64).reshape(-1, 4)
    return b[:, :2] + 0.5 * b[:, 2:]


def half_diagonals(boxes: ArrayLike) -> Floats:
    """Radius (N,) of the smallest circle around each box of (N, 4)."""
    b = np.asarray(boxes, np.float64).reshape(-1, 4)
    return np.asarray(0.5 * np.sqrt(b[:, 2] * b[:, 2] + b[:, 3] * b[:, 3]))


def circle_around_ellipse(ellipse: Ellipse, centre: tuple[float, float]) -> float:
    """Radius of a circle around ``centre`` that encloses the ellipse (exact when the centres
    agree).
    """
    dx, dy = ellipse.x - centre[0], ellipse.y - centre[1]
    return math.sqrt(dx * dx + dy * dy) + 0.5 * max(ellipse.h, ellipse.w)


def share_inside(box: Box, other: Box) -> float:
    """Share of ``box``'s area that lies in ``other``, in [0, 1]; 0 for a box without area."""
    w = min(box[0] + box[2], other[0] + other[2]) - max(box[0], other[0])
    h = min(box[1] + box[3], other[1] + other[3]) - max(box[1], other[1])
    area = box[2] * box[3]
    return w * h / area if w > 0 and h > 0 and area > 0 else 0.0


def hidden_by(behind: Box, front: Box) -> bool:
    """Whether somebody with this predicted box is wholly hidden by somebody who is seen there:
    the middle of the one lies within the box of the other.

    SHELLS 2.3 lets an occluded object be anywhere within its occluder's shell, which reaches
    beyond the box.
    """
    x, y = behind[0] + behind[2] / 2, behind[1] + behind[3] / 2
    return front[0] <= x <= front[0] + front[2] and front[1] <= y <= front[1] + front[3]


def middles_inside(boxes: Floats, others: Floats) -> Bools:
    """(N,) which boxes' middles lie in the other box of their row: `hidden_by` for many."""
    middle = boxes[:, :2] + boxes[:, 2:] / 2
    low, high = others[:, :2], others[:, :2] + others[:, 2:]
    return np.asarray(((middle >= low) & (middle <= high)).all(axis=1))


def boxes_touch(boxes: Floats, others: Floats) -> Bools:
    """Which of boxes (N, 4) have an inner point in common with which of others (M, 4), (N, M)
    bool.
    """
    a, b = boxes[:, None, :], others[None, :, :]
    w = np.minimum(a[..., 0] + a[..., 2], b[..., 0] + b[..., 2]) - np.maximum(
        a[..., 0], b[..., 0]
    )
    h = np.minimum(a[..., 1] + a[..., 3], b[..., 1] + b[..., 3]) - np.maximum(
        a[..., 1], b[..., 1]
    )
    return np.asarray((w > 0) & (h > 0))


def circles_overlap_area(distance: float, r1: float, r2: float) -> float:
    """Area in square pixels that two discs with centres ``distance`` apart have in common."""
    if distance >= r1 + r2:
        return 0.0
    small = min(r1, r2)
    if distance <= abs(r1 - r2):
        return math.pi * small * small
    c1 = (distance * distance + r1 * r1 - r2 * r2) / (2 * distance)
    c2 = distance - c1
    segment1 = r1 * r1 * math.acos(max(-1.0, min(1.0, c1 / r1)))
    segment2 = r2 * r2 * math.acos(max(-1.0, min(1.0, c2 / r2)))
    kite = distance * math.sqrt(max(0.0, r1 * r1 - c1 * c1))
    return max(0.0, segment1 + segment2 - kite)


def circles_overlap_share(distance: float, r1: float, r2: float) -> float:
    """Common area of two discs over the smaller disc's, in [0, 1], rounded to 9 digits.

    Rounded, because the arc cosine's last bits belong to the machine's mathematics library. Discs
    without area share 1 if one lies in the other, else 0.
    """
    small = min(r1, r2)
    if small <= 0:
        return 1.0 if distance <= max(r1, r2) else 0.0
    return round(
        min(1.0, circles_overlap_area(distance, r1, r2) / (math.pi * small * small)), 9
    )


class Area:
    """A union of simple polygons, any number, overlapping, abutting or apart; vertices in either
    direction.

    A polygon of fewer than three vertices encloses nothing.
    """

    def __init__(self, polygons: Sequence[Polygon]) -> None:
        kept = [
            np.asarray(polygon, np.float64).reshape(-1, 2)
            for polygon in polygons
            if len(polygon) >= 3
        ]
        self._edges = [np.hstack([p, np.roll(p, -1, axis=0)]) for p in kept]
        self._all = np.vstack(self._edges) if kept else np.zeros((0, 4))
        self._rectangle = _as_rectangle(kept[0]) if len(kept) == 1 else None

    @property
    def is_rectangle(self) -> bool:
        """The area is one upright rectangle."""
        return self._rectangle is not None

    def contains(self, points: ArrayLike) -> Bools:
        """Which points (N, 2) lie in the area or on its border, (N,) bool."""
        p = np.asarray(points, np.float64).reshape(-1, 2)
        if self._rectangle is not None:
            x0, y0, x1, y1 = self._rectangle
            return (p[:, 0] >= x0) & (p[:, 0] <= x1) & (p[:, 1] >= y0) & (p[:, 1] <= y1)
        inside = np.zeros(len(p), np.bool_)
        for edges in self._edges:
            inside |= points_in_polygon(p, edges)
        return inside

    def depth(self, points: ArrayLike) -> Floats:
        """How far points (N, 2) lie within the area, (N,): the distance to the nearest edge,
        negative outside.

        Of a point that lies in several of the polygons the distance is to the nearest edge of any
        of them.
        """
        p = np.asarray(points, np.float64).reshape(-1, 1, 2)
        if not len(self._all):
            return np.full(len(p), -np.inf)
        start, way = self._all[:, :2], self._all[:, 2:] - self._all[:, :2]
        square = (way * way).sum(axis=1)
        along = ((p - start) * way).sum(axis=2) / np.where(square > 0, square, 1.0)
        miss = p - start - np.clip(along, 0.0, 1.0)[:, :, None] * way
        nearest = np.sqrt((miss * miss).sum(axis=2)).min(axis=1)
        signed: Floats = np.where(self.contains(p[:, 0]), nearest, -nearest)
        return signed

    def covers(self, boxes: Sequence[Box]) -> list[int]:
        """The same as `cover` for boxes as plain numbers; of one upright rectangle, much quicker
        for a few of them.
        """
        if self._rectangle is None:
            found: list[int] = self.cover(boxes).tolist()
            return found
        return [_cover_of_box(box, self._rectangle) for box in boxes]

    def cover(self, boxes: ArrayLike) -> NDArray[np.int8]:
        """How each box of (N, 4) lies in the area: `WHOLLY`, `PARTLY` or `OUTSIDE`, (N,) int8,
        exactly.
        """
        b = np.asarray(boxes, np.float64).reshape(-1, 4)
        if self._rectangle is not None:
            return _cover_by_rectangle(b, self._rectangle)
        crossed = (
            _edges_in_boxes(self._all, b).any(axis=1)
            if len(self._all)
            else np.zeros(len(b), np.bool_)
        )
        inside = self.contains(centres(b))
        answer = np.where(crossed, PARTLY, np.where(inside, WHOLLY, OUTSIDE)).astype(
            np.int8
        )
        if len(self._edges) > 1:
            for i in np.flatnonzero(crossed):
                if _slabs_cover(b[i], self._edges):
                    answer[i] = WHOLLY
        return answer


def points_in_polygon(points: Floats, edges: Floats) -> Bools:
    """Which points (N, 2) lie in a polygon of edges (E, 4: x1, y1, x2, y2) or on it (even-odd
    rule), (N,) bool.
    """
    px, py = points[:, :1], points[:, 1:]
    x1, y1, x2, y2 = edges[:, 0], edges[:, 1], edges[:, 2], edges[:, 3]
    dx, dy = x2 - x1, y2 - y1
    crosses = (y1 > py) != (y2 > py)
    at = x1 + (py - y1) * (dx / np.where(dy == 0, 1.0, dy))
    odd = (np.count_nonzero(crosses & (px < at), axis=1) & 1).astype(np.bool_)
    on_line = dx * (py - y1) - dy * (px - x1) == 0
    within = (np.minimum(x1, x2) <= px) & (px <= np.maximum(x1, x2))
    within &= (np.minimum(y1, y2) <= py) & (py <= np.maximum(y1, y2))
    return np.asarray(odd | (on_line & within).any(axis=1))


def _as_rectangle(polygon: Floats) -> tuple[float, float, float, float] | None:
    """(x0, y0, x1, y1) if the polygon is an upright rectangle, else None."""
    if len(polygon) != 4:
        return None
    x0, y0 = polygon.min(axis=0)
    x1, y1 = polygon.max(axis=0)
    follow = np.roll(polygon, -1, axis=0)
    upright = bool(np.all((polygon == follow).sum(axis=1) == 1))
    corners = {(float(x), float(y)) for x, y in polygon}
    if upright and corners == {(float(x), float(y)) for x in (x0, x1) for y in (y0, y1)}:
        return float(x0), float(y0), float(x1), float(y1)
    return None


def _cover_by_rectangle(
    boxes: Floats, rectangle: tuple[float, float, float, float]
) -> NDArray[np.int8]:
    x0, y0, x1, y1 = rectangle
    left, top = boxes[:, 0], boxes[:, 1]
    right, bottom = left + boxes[:, 2], top + boxes[:, 3]
    wholly = (left >= x0) & (right <= x1) & (top >= y0) & (bottom <= y1)
    apart = (left >= x1) | (right <= x0) | (top >= y1) | (bottom <= y0)
    return np.where(wholly, WHOLLY, np.where(apart, OUTSIDE, PARTLY)).astype(np.int8)


def _cover_of_box(box: Box, rectangle: tuple[float, float, float, float]) -> int:
    x0, y0, x1, y1 = rectangle
    left, top, w, h = box
    right, bottom = left + w, top + h
    if left >= x0 and right <= x1 and top >= y0 and bottom <= y1:
        return WHOLLY
    return OUTSIDE if left >= x1 or right <= x0 or top >= y1 or bottom <= y0 else PARTLY


def _edges_in_boxes(edges: Floats, boxes: Floats) -> Bools:
    """Which edges (E, 4) pass through the open interior of which boxes (N, 4), (N, E) bool."""
    start = np.zeros((len(boxes), len(edges)))
    end = np.ones_like(start)
    for axis in (0, 1):
        low = boxes[:, axis, None]
        high = low + boxes[:, axis + 2, None]
        origin, step = edges[:, axis], edges[:, axis + 2] - edges[:, axis]
        still = step == 0
        divisor = np.where(still, 1.0, step)
        t1, t2 = (low - origin) / divisor, (high - origin) / divisor
        between = (origin > low) & (origin < high)
        enter = np.where(still, np.where(between, -np.inf, np.inf), np.minimum(t1, t2))
        leave = np.where(still, np.where(between, np.inf, -np.inf), np.maximum(t1, t2))
        start, end = np.maximum(start, enter), np.minimum(end, leave)
    return np.asarray(start < end)


def _slabs_cover(box: Floats, polygons: Sequence[Floats]) -> bool:
    """Whether the union of polygons (edge arrays) covers the box: cut into horizontal slabs in
    which no edge turns, crosses another or crosses the box's side, then compare intervals on each
    slab's middle line.
    """
    x0, y0, w, h = (float(v) for v in box)
    x1, y1 = x0 + w, y0 + h
    edges = [tuple(float(v) for v in e) for polygon in polygons for e in polygon]
    sides = [(x0, y0, x0, y1), (x1, y0, x1, y1)]
    cuts = {y0, y1} | {y for edge in edges for y in (edge[1], edge[3]) if y0 < y < y1}
    for index, edge in enumerate(edges):
        for other in edges[index + 1 :] + sides:
            y = _crossing_y(edge, other)
            if y is not None and y0 < y < y1:
                cuts.add(y)
    levels = sorted(cuts)
    return all(
        _line_covered(polygons, (a + b) / 2, x0, x1) for a, b in itertools.pairwise(levels)
    )


def _crossing_y(e: Sequence[float], f: Sequence[float]) -> float | None:
    """The y where two segments cross, None if they do not or are parallel."""
    ex, ey, fx, fy = e[2] - e[0], e[3] - e[1], f[2] - f[0], f[3] - f[1]
    det = ex * fy - ey * fx
    if det == 0:
        return None
    t = ((f[0] - e[0]) * fy - (f[1] - e[1]) * fx) / det
    s = ((f[0] - e[0]) * ey - (f[1] - e[1]) * ex) / det
    return e[1] + t * ey if 0 <= t <= 1 and 0 <= s <= 1 else None


def _line_covered(polygons: Sequence[Floats], y: float, x0: float, x1: float) -> bool:
    """Whether the polygons' intervals at height y together cover [x0, x1]."""
    intervals: list[tuple[float, float]] = []
    for polygon in polygons:
        xs = sorted(
            float(ax + (y - ay) * (bx - ax) / (by - ay))
            for ax, ay, bx, by in polygon
            if (ay > y) != (by > y)
        )
        intervals += zip(xs[::2], xs[1::2], strict=False)
    reach = x0
    for low, high in sorted(intervals):
        if low > reach + _SEAM_PX:
            break
        reach = max(reach, high)
    return reach >= x1 - _SEAM_PX
