"""How near two people came to one another on the ground, as far as their boxes tell."""

from __future__ import annotations

import numpy as np

from reasoning.encounters.ground import GroundSlope
from reasoning.encounters.pair import History


def nearest(
    a: History, b: History, first: int, last: int, ground: GroundSlope
) -> float | None:
    """The least distance of two targets' feet in some frames, in body sizes (the mean diagonal of
    their boxes), ways in depth as long as the ground makes them.

    Args:
        a: one target.
        b: the other one.
        first: frame from which on.
        last: frame up to which, included.
        ground: of the recording.

    Returns:
        None where both are there in none of the frames.
    """
    mine = slice(*np.searchsorted(a.frames, (first, last + 1)))
    others = slice(*np.searchsorted(b.frames, (first, last + 1)))
    _, i, j = np.intersect1d(
        a.frames[mine], b.frames[others], assume_unique=True, return_indices=True
    )
    one, two = a.boxes[mine][i], b.boxes[others][j]
    if not len(one):
        return None
    size = (np.hypot(one[:, 2], one[:, 3]) + np.hypot(two[:, 2], two[:, 3])) / 2
    across = (one[:, 0] + one[:, 2] / 2) - (two[:, 0] + two[:, 2] / 2)
    deep = (one[:, 1] + one[:, 3]) - (two[:, 1] + two[:, 3])
    stretch = ground.stretch((one[:, 3] + two[:, 3]) / 2)
    away = np.hypot(across, deep * stretch) / np.maximum(size, 1.0)
    return round(float(away.min()), 2)
