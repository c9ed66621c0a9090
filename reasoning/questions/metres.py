"""Metres: where feet are on the ground, from points that were measured there, or roughly from how
tall people are.

Four points or more with their places on the ground give a homography (least squares, without
BLAS); what the points miss it by is an error of every place. Without any, people's height gives a
rough scale: heights of boxes that grow with the foot's place in the picture say where the horizon
is and how high the camera stands (A. Criminisi, I. Reid, A. Zisserman, Single view metrology, IJCV
2000), the focal length is guessed; heights that do not grow give one scale for all. Every answer
says its error.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import duckdb

from reasoning.questions.literals import literal
from reasoning.questions.schema import SURE
from recorders.errors import UsageError

Point = tuple[float, float]
Matrix = tuple[float, ...]
FOCAL_WIDTHS = 1.1
"""A focal length in picture widths, where nothing is known of it: half of all cameras within 25 %."""
ROUGH, ROUGHER = 0.25, 0.35
"""Shares that distances from people's height may be off by: with a horizon, with one scale."""
_FOOT_PX, _FOOT_SHARE = 2.0, 0.03
_LEAST_ROWS, _LEAST_GROWTH = 20, 0.25
_BINS = 12


@dataclass(frozen=True)
class GroundPlane:
    """How pixels become metres.

    Attributes:
        points: ((x, y) in pixels, (X, Y) in metres), four or more; or none.
        height_m: how tall people are, where there are no points.
    """

    points: tuple[tuple[Point, Point], ...] = ()
    height_m: float | None = None


@dataclass(frozen=True)
class Fit:
    """A recording's homography (nine numbers, row by row), the root mean square of what its
    points miss it by in metres, and the share that distances may be off by.
    """

    matrix: Matrix
    residual_m: float
    share: float


def read_points(path: Path) -> GroundPlane:
    """The points of a CSV with the columns x, y (pixels) and X, Y (metres), in any order.

    Raises:
        UsageError: it cannot be read, or has under four points.
    """
    try:
        rows = list(csv.reader(path.read_text(encoding="utf-8-sig").splitlines()))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UsageError(f"--homography {path}: cannot be read: {error}") from error
    names = [name.strip() for name in rows[0]] if rows else []
    if not set(names) >= {"x", "y", "X", "Y"}:
        raise UsageError(
            f"--homography {path}: wanted the columns x, y (pixels) and X, Y (metres), it has"
            f" {', '.join(names[:8]) or 'none'}"
        )
    at = [names.index(name) for name in ("x", "y", "X", "Y")]
    points = []
    for number, row in enumerate(rows[1:], 2):
        if not any(cell.strip() for cell in row):
            continue
        try:
            x, y, east, north = (float(row[k]) for k in at)
            if not all(map(math.isfinite, (x, y, east, north))):
                raise ValueError(row)
        except (ValueError, IndexError):
            raise UsageError(
                f"--homography {path}: line {number} holds no four numbers"
            ) from None
        points.append(((x, y), (east, north)))
    if len(points) < 4:
        raise UsageError(
            f"--homography {path}: {len(points)} points, at least 4 are wanted"
        )
    return GroundPlane(points=tuple(points))


def homography(points: Sequence[tuple[Point, Point]]) -> Fit:
    """The homography that takes pixels to metres.

    Raises:
        UsageError: the points lie on a line, or so nearly that nothing can be said.
    """
    (cx, cy, s), (gx, gy, g) = (_frame([p[k] for p in points]) for k in (0, 1))
    rows, values = [], []
    for (px, py), (mx, my) in points:
        x, y, u, v = (px - cx) / s, (py - cy) / s, (mx - gx) / g, (my - gy) / g
        rows += [[x, y, 1, 0, 0, 0, -u * x, -u * y], [0, 0, 0, x, y, 1, -v * x, -v * y]]
        values += [u, v]
    a, b, c, d, e, f, p, q = _least_squares(rows, values)
    first = [a * g + p * gx, b * g + q * gx, c * g + gx]
    second = [d * g + p * gy, e * g + q * gy, f * g + gy]
    matrix = tuple(
        v for r in (first, second, [p, q, 1.0])
        for v in (r[0] / s, r[1] / s, r[2] - (r[0] * cx + r[1] * cy) / s)
    )  # fmt: skip
    misses = [math.dist(placed(matrix, pixel), metre) for pixel, metre in points]
    return Fit(matrix, math.sqrt(sum(m * m for m in misses) / len(misses)), 0.0)


def placed(matrix: Matrix, pixel: Point) -> Point:
    """A pixel on the ground."""
    x, y = pixel
    a, b, c, d, e, f, p, q, r = matrix
    deep = p * x + q * y + r
    return (a * x + b * y + c) / deep, (d * x + e * y + f) / deep


def _frame(points: Sequence[Point]) -> tuple[float, float, float]:
    """Middle and spread, so that all numbers are about one."""
    n = len(points)
    cx, cy = sum(p[0] for p in points) / n, sum(p[1] for p in points) / n
    return cx, cy, sum(math.dist(p, (cx, cy)) for p in points) / n or 1.0


def _least_squares(rows: Sequence[Sequence[float]], values: Sequence[float]) -> list[float]:
    """Solve by normal equations and elimination with pivots: the same bits on every machine."""
    n = len(rows[0])
    m = [
        [sum(r[i] * r[j] for r in rows) for j in range(n)]
        + [sum(r[i] * v for r, v in zip(rows, values, strict=True))]
        for i in range(n)
    ]
    for k in range(n):
        best = max(range(k, n), key=lambda i: abs(m[i][k]))
        m[k], m[best] = m[best], m[k]
        if abs(m[k][k]) < 1e-9:
            raise UsageError(
                "--homography: the points lie on a line; give four corners of something"
            )
        for i in range(n):
            if i != k:
                factor = m[i][k] / m[k][k]
                m[i] = [v - factor * w for v, w in zip(m[i], m[k], strict=True)]
    return [m[i][n] / m[i][i] for i in range(n)]


def from_heights(
    seen: Sequence[tuple[float, float]], size: tuple[int, int], height_m: float
) -> Fit | None:
    """A homography from (foot's y, height) of boxes, in pixels; None with too few of them."""
    if len(seen) < _LEAST_ROWS or size[0] <= 0:
        return None
    ordered = sorted(seen)
    step = max(1, len(ordered) // _BINS)
    bins = [_middle(ordered[k : k + step]) for k in range(0, len(ordered) - step + 1, step)]
    slopes = sorted(
        (b[1] - a[1]) / (b[0] - a[0])
        for n, a in enumerate(bins) for b in bins[n + 1 :] if b[0] > a[0]
    )  # fmt: skip
    usual = sorted(h for _, h in seen)[len(seen) // 2]
    slope = slopes[len(slopes) // 2] if slopes else 0.0
    reach = bins[-1][0] - bins[0][0]
    if slope * reach < _LEAST_GROWTH * usual:
        scale = height_m / usual
        return Fit((scale, 0.0, 0.0, 0.0, scale, 0.0, 0.0, 0.0, 1.0), 0.0, ROUGHER)
    offsets = sorted(h - slope * y for y, h in bins)
    horizon = -offsets[len(offsets) // 2] / slope
    camera = height_m / slope
    deep = FOCAL_WIDTHS * size[0] * camera
    middle = size[0] / 2
    return Fit(
        (camera, 0.0, -camera * middle, 0.0, 0.0, deep, 0.0, 1.0, -horizon), 0.0, ROUGH
    )


def _middle(some: Sequence[tuple[float, float]]) -> tuple[float, float]:
    heights = sorted(h for _, h in some)
    return some[len(some) // 2][0], heights[len(heights) // 2]


def make_metres(con: duckdb.DuckDBPyConnection, ground: GroundPlane | None) -> None:
    """Make the view ``metres``: where each present target stood on the ground, with its error.

    Raises:
        UsageError: a recording shows too few people to tell a scale by.
    """
    parts = []
    if ground is not None:
        for recording, width, height in con.execute(
            "SELECT recording, width, height FROM recordings ORDER BY recording"
        ).fetchall():
            parts.append(_part(recording, _fit(con, ground, recording, (width, height))))
    empty = (
        "SELECT recording, track, frame, t, x AS x_m, y AS y_m, x AS error_m, x AS off_share, seen"
        f" FROM {SURE}tracks WHERE false"
    )
    con.execute(f"CREATE VIEW metres AS {' UNION ALL '.join(parts) or empty}")


def _fit(
    con: duckdb.DuckDBPyConnection,
    ground: GroundPlane,
    recording: str,
    size: tuple[int, int],
) -> Fit:
    if ground.height_m is None:
        return homography(ground.points)
    rows = con.execute(
        f"SELECT y + h, h FROM {SURE}tracks WHERE recording = ? AND present AND seen AND h > w"
        " AND x > 2 AND y > 2 AND y + h < ? - 2 ORDER BY frame, track",
        [recording, size[1] or 1_000_000],
    ).fetchall()
    fit = from_heights(rows, size, ground.height_m)
    if fit is None:
        raise UsageError(
            f"--height: {recording} shows too few upright people, whole, to tell a scale by;"
            " give --homography points.csv"
        )
    return fit


def _part(recording: str, fit: Fit) -> str:
    a, b, c, d, e, f, p, q, r = (repr(v) for v in fit.matrix)

    def at(x: str, y: str) -> tuple[str, str]:
        deep = f"nullif(greatest({p} * {x} + {q} * {y} + {r}, 0), 0)"
        if fit.share == 0:  # of measured points the sign says nothing
            deep = f"nullif({p} * {x} + {q} * {y} + {r}, 0)"
        return (
            f"({a} * {x} + {b} * {y} + {c}) / {deep}",
            f"({d} * {x} + {e} * {y} + {f}) / {deep}",
        )

    here, beside = at("fx", "fy"), at("(fx + off)", "fy")
    below = at("fx", "(fy + off)")
    error = " + ".join(
        f"pow({other[k]} - {here[k]}, 2)" for other in (beside, below) for k in (0, 1)
    )
    return (
        f"SELECT recording, track, frame, t, {here[0]} AS x_m, {here[1]} AS y_m,"
        f" sqrt({error} + {fit.residual_m**2!r}) AS error_m, {fit.share!r} AS off_share, seen FROM"
        f" (SELECT *, x + w / 2 AS fx, y + h AS fy, greatest({_FOOT_PX}, {_FOOT_SHARE} * h) AS off"
        f" FROM {SURE}tracks WHERE present AND recording = {literal(recording)})"
    )
