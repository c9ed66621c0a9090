"""The head's image template: an exhaustive search in integers for where a head is (PARTS 4.1, multiple responses)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]

SIDE = 12
"""Places along each side of a template."""
WIDE = 0.8
"""Half of the patch's width, of the head's height: hair, face and a little of the shoulders and of what is around."""
TALL = 1.5
"""The patch's height, of the head's height."""


def _flat(image: Bytes, tops: Floats, head_px: Floats) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Flat pixel indices of the patches under head tops (N, 2), and which lie in the picture: (N, SIDE * SIDE)."""
    height, width = image.shape[:2]
    u = (np.arange(SIDE) + 0.5) / SIDE
    x = tops[:, 0, None, None] + (2 * u[None, None, :] - 1) * WIDE * head_px[:, None, None]
    y = tops[:, 1, None, None] + u[None, :, None] * TALL * head_px[:, None, None]
    column, row = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
    column, row = np.broadcast_arrays(column, row)
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    flat = np.where(inside, row * width + column, 0)
    return flat.reshape(len(tops), -1), inside.reshape(len(tops), -1)


def patches(image: Bytes, tops: Floats, head_px: Floats) -> tuple[Bytes, NDArray[np.bool_]]:
    """Patches (N, SIDE * SIDE, 3) uint8 under head tops (N, 2), heads of heights (N,); and which lie in the picture."""
    flat, inside = _flat(image, tops, head_px)
    return image.reshape(-1, 3)[flat], np.asarray(inside.all(axis=1))


def distance(image: Bytes, template: Bytes, tops: Floats, head_px: float) -> NDArray[np.int64]:
    """Mean absolute difference of a template and the patches under tops (N, 2), (N,) in 0..255, rounded down.

    Places outside of the picture count as entirely different.
    """
    flat, inside = _flat(image, tops, np.full(len(tops), head_px))
    seen = image.reshape(-1, 3)[flat].astype(np.int32)
    apart = np.abs(seen - template.astype(np.int32)[None]).sum(axis=2)
    return np.asarray(np.where(inside, apart, 3 * 255).sum(axis=1, dtype=np.int64) // (3 * SIDE * SIDE))


def refine(
    image: Bytes, template: Bytes, top: tuple[float, float], head_px: float, reach_px: float
) -> tuple[tuple[float, float], int]:
    """The best place of a head's template around a top, exhaustively, pixel by pixel (coarser for large heads).

    Returns:
        The refined top, and the distance there (0 to 255). Ties go to the place nearest to the first one, then to
        the upper left.
    """
    step = max(1, round(head_px / 10))
    n = max(1, round(reach_px / step))
    dx, dy = (a.ravel() * float(step) for a in np.meshgrid(np.arange(-n, n + 1), np.arange(-n, n + 1)))
    order = np.lexsort((dx, dy, dx * dx + dy * dy))
    tops = np.stack([top[0] + dx[order], top[1] + dy[order]], axis=1)
    away = distance(image, template, tops, head_px)
    best = int(np.argmin(away))
    return (float(tops[best, 0]), float(tops[best, 1])), int(away[best])
