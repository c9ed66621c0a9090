"""Regions of a scene from a JSON file: region of interest, security border, named zones (EVENTS
3.2).

    {"roi": [[x, y], ...], "border": [[x, y], ...], "zones": {"door": [[x, y], ...]}}

``roi`` and ``border`` are one polygon or a list of them, in pixels of the recording; ``border``
is the outer outline of the region of interest and its border together. Each may be left out: without
``border`` there is none, without ``roi`` it is the recorded one, else the whole picture.
"""

from __future__ import annotations

import itertools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NoReturn

import numpy as np

from recorders.errors import SourceError
from recorders.files import existing_file
from recorders.message_checks import LARGEST, MOST_POLYGONS, MOST_VERTICES
from recorders.messages import Regions, Zone

Point = tuple[float, float]
Polygon = list[Point]

_LARGEST_FILE = 1 << 20
_SMALLEST_AREA = 1e-6


def read_regions(
    path: str | Path, width: int, height: int, recorded: Regions | None = None
) -> Regions:
    """The regions of a file for pictures of this size; ``recorded`` has the region of interest and
    the border of a file that names zones alone.

    Raises:
        SourceError: not such a file: a polygon with under three vertices, without area, that
            crosses itself or lies wholly beyond the picture, a border that does not enclose the
            region of interest; names which.
    """
    path = existing_file(Path(path))
    return _Reader(path, width, height, recorded).read()


def checked(
    polygon: Polygon, name: str, size: tuple[int, int] | None = None
) -> tuple[str, Polygon]:
    """What is wrong with an outline, empty if nothing is; and the outline, its end left out where
    that repeats its start. ``size`` is the picture's, in which some of it must lie.
    """
    if len(polygon) > 1 and polygon[0] == polygon[-1]:
        polygon = polygon[:-1]
    fault = ""
    if len(polygon) < 3:
        fault = f"{name} has {len(polygon)} vertices, at least 3 are wanted"
    elif len(polygon) > MOST_VERTICES:
        fault = f"{name} has {len(polygon)} vertices, at most {MOST_VERTICES}"
    elif _crosses_itself(polygon):
        fault = f"{name} crosses itself"
    elif abs(_area(polygon)) < _SMALLEST_AREA:
        fault = f"{name} has no area"
    elif size is not None and beyond(polygon, size):
        fault = f"{name} lies wholly beyond the picture of {size[0]}x{size[1]}"
    return fault, polygon


def beyond(points: Polygon, size: tuple[int, int]) -> bool:
    """Whether all points lie beyond one side of a picture of (width, height)."""
    xs, ys = [point[0] for point in points], [point[1] for point in points]
    return max(xs) <= 0 or max(ys) <= 0 or min(xs) >= size[0] or min(ys) >= size[1]


class _Reader:
    def __init__(
        self, path: Path, width: int, height: int, recorded: Regions | None
    ) -> None:
        self._path = path
        self._recorded = recorded
        self._size = width, height

    def _fail(self, reason: str) -> NoReturn:
        raise SourceError(reason, self._path)

    def read(self) -> Regions:
        if self._path.stat().st_size > _LARGEST_FILE:
            self._fail(f"over {_LARGEST_FILE} bytes: not a file of regions")
        try:
            data = json.loads(self._path.read_bytes(), object_pairs_hook=self._object)
        except (ValueError, RecursionError) as error:
            self._fail(f"not JSON: {error}")
        if not isinstance(data, dict) or not data:
            self._fail('wanted an object with "roi", "border" or "zones"')
        unknown = sorted(set(data) - {"roi", "border", "zones"})
        if unknown:
            self._fail(f"unknown field {unknown[0]!r}; known are roi, border, zones")
        width, height = self._size
        whole: list[Polygon] = [[(0, 0), (width, 0), (width, height), (0, height)]]
        roi, border = whole, whole
        if "roi" in data:
            roi = border = self._polygons(data["roi"], "roi")
        elif self._recorded is not None:
            roi, border = self._recorded.roi, self._recorded.border
        if "border" in data:
            border = self._polygons(data["border"], "border")
        for polygon in roi:
            if not any(_encloses(outer, polygon) for outer in border) and not (
                _covers(border, polygon, self._size)
            ):
                self._fail(
                    "the border does not enclose the roi: it is the outer outline of both together"
                )
        return Regions(*self._size, roi, border, self._zones(data.get("zones", {})), "file")

    def _object(self, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
        found = dict(pairs)
        if len(found) != len(pairs):
            twice = next(
                key for key, _ in pairs if [pair[0] for pair in pairs].count(key) > 1
            )
            self._fail(f"{twice!r} is there twice")
        return found

    def _zones(self, data: object) -> list[Zone]:
        if not isinstance(data, Mapping):
            self._fail('zones must be an object: {"name": [[x, y], ...]}')
        if len(data) > MOST_POLYGONS:
            self._fail(f"{len(data)} zones, at most {MOST_POLYGONS}")
        for name in data:
            if not name.strip():
                self._fail("a zone without a name")
        return [
            Zone(name, self._polygon(data[name], f"zone {name!r}")) for name in sorted(data)
        ]

    def _polygons(self, data: object, name: str) -> list[Polygon]:
        if not isinstance(data, list) or not data:
            self._fail(f"{name} must be a polygon [[x, y], ...] or a list of polygons")
        nested = (
            isinstance(data[0], list) and bool(data[0]) and isinstance(data[0][0], list)
        )
        if not nested:
            return [self._polygon(data, name)]
        if len(data) > MOST_POLYGONS:
            self._fail(f"{len(data)} polygons in {name}, at most {MOST_POLYGONS}")
        return [
            self._polygon(point, f"{name} {index + 1}") for index, point in enumerate(data)
        ]

    def _polygon(self, data: object, name: str) -> Polygon:
        if not isinstance(data, list):
            self._fail(f"{name} must be a list of vertices [x, y]")
        fault, polygon = checked(
            [self._point(point, name) for point in data], name, self._size
        )
        if fault:
            self._fail(fault)
        return polygon

    def _point(self, data: object, name: str) -> Point:
        if not isinstance(data, list) or len(data) != 2:
            self._fail(f"{name}: a vertex must be [x, y], not {str(data)[:40]}")
        for value in data:
            number = isinstance(value, (int, float)) and not isinstance(value, bool)
            if not number or not math.isfinite(value) or abs(value) > LARGEST:
                self._fail(f"{name}: {str(value)[:40]} is not a coordinate in pixels")
        return float(data[0]), float(data[1])


def _covers(outlines: list[Polygon], polygon: Polygon, size: tuple[int, int]) -> bool:
    """Whether several outlines together leave no pixel of a polygon uncovered, in the picture."""
    from recorders.vision import cv2

    width, height = size
    inside, around = (np.zeros((height, width), np.uint8) for _ in range(2))
    cv2.fillPoly(inside, [np.rint(polygon).astype(np.int32)], (1,))
    for outline in outlines:
        cv2.fillPoly(around, [np.rint(outline).astype(np.int32)], (1,))
    return len(outlines) > 1 and not bool((inside > around).any())


def _area(polygon: Polygon) -> float:
    return sum(_cross((0.0, 0.0), a, b) for a, b in _edges(polygon)) / 2


def _edges(polygon: Polygon) -> list[tuple[Point, Point]]:
    return list(zip(polygon, polygon[1:] + polygon[:1], strict=True))


def _cross(o: Point, a: Point, b: Point) -> float:
    return (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0])


def _on(p: Point, a: Point, b: Point) -> bool:
    """Whether p, in line with a and b, lies between them."""
    return min(a[0], b[0]) <= p[0] <= max(a[0], b[0]) and min(a[1], b[1]) <= p[1] <= max(
        a[1], b[1]
    )


def _meet(a: Point, b: Point, c: Point, d: Point) -> bool:
    """Whether two closed segments share a point."""
    s, t, u, v = _cross(a, b, c), _cross(a, b, d), _cross(c, d, a), _cross(c, d, b)
    if ((s > 0) != (t > 0)) and ((u > 0) != (v > 0)) and 0.0 not in (s, t, u, v):
        return True
    touching = ((s, c, a, b), (t, d, a, b), (u, a, c, d), (v, b, c, d))
    return any(side == 0 and _on(point, q, r) for side, point, q, r in touching)


def _crosses_itself(polygon: Polygon) -> bool:
    edges = _edges(polygon)
    count = len(edges)
    for index, (a, b) in enumerate(edges):
        if a == b:
            return True
        for j in range(index + 1, count):
            c, d = edges[j]
            if j == index + 1 or (index == 0 and j == count - 1):
                # Neighbours share a vertex; they must not fold back over one another.
                shared, before, after = (b, a, d) if j == index + 1 else (a, b, c)
                folded = _cross(shared, before, after) == 0 and count > 3
                if folded and (_on(before, shared, after) or _on(after, shared, before)):
                    return True
            elif _meet(a, b, c, d):
                return True
    return False


def _inside(p: Point, polygon: Polygon) -> bool:
    """Whether a point lies in a polygon or on its edge."""
    within = False
    for a, b in _edges(polygon):
        if _cross(a, b, p) == 0 and _on(p, a, b):
            return True
        if (a[1] > p[1]) != (b[1] > p[1]) and p[0] < a[0] + (p[1] - a[1]) * (
            b[0] - a[0]
        ) / (b[1] - a[1]):
            within = not within
    return within


def _encloses(outer: Polygon, inner: Polygon) -> bool:
    """Whether no point of the inner polygon lies outside the outer one; edges may be shared."""
    if not all(_inside(point, outer) for point in inner):
        return False
    for a, b in _edges(inner):
        # Between its meetings with the outer outline an edge lies on one side: ask in the middle
        # of each piece.
        cuts = sorted(
            {
                0.0,
                1.0,
                *(meeting for c, d in _edges(outer) for meeting in _meetings(a, b, c, d)),
            }
        )
        for s, t in itertools.pairwise(cuts):
            middle = (
                a[0] + (b[0] - a[0]) * (s + t) / 2,
                a[1] + (b[1] - a[1]) * (s + t) / 2,
            )
            if not _inside(middle, outer) and _distance(middle, outer) > _SMALLEST_AREA:
                return False
    return True


def _meetings(a: Point, b: Point, c: Point, d: Point) -> list[float]:
    """Where along a-b (0 to 1) it meets the line segment c-d."""
    direction = (b[0] - a[0]) * (d[1] - c[1]) - (b[1] - a[1]) * (d[0] - c[0])
    if direction == 0:
        length = (b[0] - a[0]) ** 2 + (b[1] - a[1]) ** 2
        along = [
            ((point[0] - a[0]) * (b[0] - a[0]) + (point[1] - a[1]) * (b[1] - a[1])) / length
            for point in (c, d)
        ]
        return [t for t in along if 0 < t < 1]
    t = ((c[0] - a[0]) * (d[1] - c[1]) - (c[1] - a[1]) * (d[0] - c[0])) / direction
    return [t] if 0 < t < 1 else []


def _distance(p: Point, polygon: Polygon) -> float:
    best = math.inf
    for a, b in _edges(polygon):
        dx, dy = b[0] - a[0], b[1] - a[1]
        t = max(
            0.0, min(1.0, ((p[0] - a[0]) * dx + (p[1] - a[1]) * dy) / (dx * dx + dy * dy))
        )
        best = min(best, math.hypot(p[0] - a[0] - t * dx, p[1] - a[1] - t * dy))
    return best
