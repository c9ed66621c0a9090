"""The head's image template: an exhaustive search in integers for where a head is (PARTS 4.1,
multiple responses).
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]

SIDE = 12
"""Places along each side of a template."""
WIDE = 0.8
"""Half of the patch's width, of the head's height: hair, face and a little of the shoulders and
of what is around.
"""
TALL = 1.5
"""The patch's height, of the head's height."""


_U = (np.arange(SIDE) + 0.5) / SIDE
_ACROSS, _DOWN = (2 * _U - 1) * WIDE, _U * TALL


def patches(image: Bytes, tops: Floats, head_px: Floats) -> tuple[Bytes, NDArray[np.bool_]]:
    """Patches (N, SIDE * SIDE, 3) uint8 under head tops (N, 2), heads of heights (N,); and which
    lie in the picture.
    """
    height, width = image.shape[:2]
    column = np.floor(tops[:, :1] + _ACROSS * head_px[:, None]).astype(np.intp)
    row = np.floor(tops[:, 1:] + _DOWN * head_px[:, None]).astype(np.intp)
    across, down = (column >= 0) & (column < width), (row >= 0) & (row < height)
    row, column = np.where(down, row, 0), np.where(across, column, 0)
    seen = image[row[:, :, None], column[:, None, :]].reshape(len(tops), -1, 3)
    return seen, np.asarray(across.all(axis=1) & down.all(axis=1))


def distances(
    image: Bytes, template: Bytes, x: Floats, y: Floats, head_px: float
) -> NDArray[np.int64]:
    """Mean absolute differences of a template and the patches under all tops at ``x`` (X,) and
    ``y`` (Y,).

    Returns:
        (Y, X) in 0..255, rounded down. Places outside of the picture count as entirely different.
    """
    height, width = image.shape[:2]
    column = np.floor(x[:, None] + _ACROSS * head_px).astype(np.intp).ravel()
    row = np.floor(y[:, None] + _DOWN * head_px).astype(np.intp)
    beside, beyond = (column < 0) | (column >= width), (row < 0) | (row >= height)
    row = np.minimum(np.maximum(row, 0), height - 1)
    first = int(row.min())
    # All that any row of any patch sees, patch beside patch: what is left is to compare rows, all
    # of them 8-bit.
    strip = image[first : int(row.max()) + 1].take(
        np.minimum(np.maximum(column, 0), width - 1), axis=1
    )
    strip = strip.reshape(len(strip), -1)
    wanted = np.tile(template.reshape(SIDE, -1), len(x))
    outside = np.repeat(beside, 3)
    total = np.zeros((len(y), len(x) * SIDE * 3), np.uint16)
    for v in range(SIDE):
        seen = strip.take(row[:, v] - first, axis=0)
        apart = np.maximum(seen, wanted[v]) - np.minimum(seen, wanted[v])
        apart[beyond[:, v]] = 255
        apart[:, outside] = 255
        total += apart
    return np.asarray(
        total.reshape(len(y), len(x), -1).sum(axis=2, dtype=np.int64) // (3 * SIDE * SIDE)
    )


@lru_cache(maxsize=64)
def _nearest_first(n: int) -> NDArray[np.intp]:
    """Flat indices of a grid of 2 n + 1 times 2 n + 1 places, from the middle outwards, then the
    upper left first.
    """
    dx, dy = (a.ravel() for a in np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1)))
    return np.lexsort((dx, dy, dx * dx + dy * dy))


def refine(
    image: Bytes, template: Bytes, top: tuple[float, float], head_px: float, reach_px: float
) -> tuple[tuple[float, float], int]:
    """The best place of a head's template around a top, exhaustively, pixel by pixel (coarser for
    large heads).

    Returns:
        The refined top, and the distance there (0 to 255). Ties go to the place nearest to the
        first one, then to the upper left.
    """
    step = max(1, round(head_px / 10))
    n = max(1, round(reach_px / step))
    off = np.arange(-n, n + 1) * step
    x, y = np.asarray(top[0] + off, np.float64), np.asarray(top[1] + off, np.float64)
    away = distances(image, template, x, y, head_px).ravel()
    order = _nearest_first(n)
    best = int(order[np.argmin(away[order])])
    down, across = divmod(best, len(off))
    return (float(x[across]), float(y[down])), int(away[best])
