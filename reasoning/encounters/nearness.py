"""How near two people came to one another on the ground, as far as their boxes tell."""

from __future__ import annotations

import numpy as np

from reasoning.encounters.ground import GroundSlope
from reasoning.encounters.pair import Floats, History

NEAR_ODDS, NEAR_POWER = 1.7, 8
"""See `sure_near`."""


def sure_near(nearest: float) -> float:
    """How likely two whose boxes came so near, in body sizes, came within one body size of one
    another, where the shells of two who stand touch.

    The odds fall with a power of the distance, a logistic function of its logarithm: fitted on
    what trackers made of scenes with truth, each place left out (`bench_answers.py`). How long they
    were near adds nothing.

    >>> [round(sure_near(d), 2) for d in (0.5, 0.8, 1.0, 1.2, 1.5)]
    [1.0, 0.91, 0.63, 0.28, 0.06]
    """
    return NEAR_ODDS / (NEAR_ODDS + nearest**NEAR_POWER)


ONE_PLACE = 0.6
"""Share of the smaller of two boxes that lies within the other: they may be one body's."""


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
    _, away = _ways(a, b, first, last, ground)
    return round(float(away.min()), 2) if len(away) else None


def ever_apart(a: History, b: History) -> bool:
    """Whether two targets were ever at two places in the picture: else they may be one body with
    two numbers.
    """
    _, i, j = np.intersect1d(a.frames, b.frames, assume_unique=True, return_indices=True)
    one, two = a.boxes[i], b.boxes[j]
    shared = np.minimum(one[:, :2] + one[:, 2:], two[:, :2] + two[:, 2:]) - np.maximum(
        one[:, :2], two[:, :2]
    )
    inside = np.maximum(shared, 0.0).prod(axis=1)
    smaller = np.minimum(one[:, 2:].prod(axis=1), two[:, 2:].prod(axis=1))
    return bool((inside < ONE_PLACE * smaller).any())


def drawing_away(
    a: History, b: History, since_s: float, until_s: float, ground: GroundSlope
) -> float | None:
    """By how much two draw away from one another in a span of time, body sizes per second; less
    than nothing where they close in. The straight line through all distances, so that a stride
    that widens a box counts for little.

    Args:
        a: one target.
        b: the other one.
        since_s: the span's start, s.
        until_s: its end, included.
        ground: of the recording.

    Returns:
        None where both are there in fewer than two of the frames.
    """
    first, last = np.searchsorted(a.times_s, (since_s - 5e-4, until_s + 5e-4))
    if last - first < 2:
        return None
    t, away = _ways(a, b, int(a.frames[first]), int(a.frames[last - 1]), ground)
    if len(t) < 2:
        return None
    t = t - t.mean()
    return round(float((t * away).sum() / (t * t).sum()), 3)


def _ways(
    a: History, b: History, first: int, last: int, ground: GroundSlope
) -> tuple[Floats, Floats]:
    """The times of the frames in which both are there, and the distances then."""
    mine = slice(*np.searchsorted(a.frames, (first, last + 1)))
    others = slice(*np.searchsorted(b.frames, (first, last + 1)))
    _, i, j = np.intersect1d(
        a.frames[mine], b.frames[others], assume_unique=True, return_indices=True
    )
    one, two = a.boxes[mine][i], b.boxes[others][j]
    size = (np.hypot(one[:, 2], one[:, 3]) + np.hypot(two[:, 2], two[:, 3])) / 2
    across = (one[:, 0] + one[:, 2] / 2) - (two[:, 0] + two[:, 2] / 2)
    deep = (one[:, 1] + one[:, 3]) - (two[:, 1] + two[:, 3])
    stretch = ground.stretch((one[:, 3] + two[:, 3]) / 2)
    away: Floats = np.hypot(across, deep * stretch) / np.maximum(size, 1.0)
    return a.times_s[mine][i], away
