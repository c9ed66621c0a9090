"""Upright boxes around what has corners or is turned."""

from __future__ import annotations

import math
from collections.abc import Sequence

from recorders.messages import Box


def box_around(xs: Sequence[float], ys: Sequence[float]) -> Box:
    """The box x, y, w, h around points.

    >>> box_around([3.0, 1.0, 2.0], [5.0, 9.0, 6.0])
    (1.0, 5.0, 2.0, 4.0)
    """
    left, top = min(xs), min(ys)
    return left, top, max(xs) - left, max(ys) - top


def extent_of_box(w: float, h: float, turn: float) -> tuple[float, float]:
    """Width and height of the box around a box that is turned; or half of each, of half of each.

    Args:
        w: its own width.
        h: its own height.
        turn: radians.
    """
    cos, sin = abs(math.cos(turn)), abs(math.sin(turn))
    return w * cos + h * sin, w * sin + h * cos


def extent_of_ellipse(a: float, b: float, turn: float) -> tuple[float, float]:
    """Half the width and height of the box around an ellipse that is turned.

    Args:
        a: half of its axis along x, before it is turned.
        b: half of the other one.
        turn: radians.
    """
    cos, sin = math.cos(turn), math.sin(turn)
    return math.hypot(a * cos, b * sin), math.hypot(a * sin, b * cos)
