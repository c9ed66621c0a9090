"""Where the five parts lie in a person's box (PARTS 2.1, Figure 2).

The head is the top seventh, over the whole width. Below it the centroid (x_c, y_c) parts torso
from legs and left from right. ``alpha`` and ``beta`` say where the centroid lies within the box,
so that it can be laid into a box of which only the head is seen (eq. 1 and 2).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

PARTS = ("head", "left_torso", "right_torso", "left_legs", "right_legs")
"""Left and right as in the picture."""
HEAD = 1.0 / 7.0
"""The head's share of the height."""
ALPHA, BETA = 0.5, 0.42
"""Usual places of the centroid, before a target's own are known."""

_RECTANGLES = np.array(
    [[0, 3, 2, 4], [0, 4, 1, 5], [1, 4, 2, 5], [0, 5, 1, 6], [1, 5, 2, 6]]
)
"""Left, top, right and bottom of each part among the edges: left, x_c, right, then top,
shoulders, y_c, foot.
"""


def alpha_of(boxes: Floats, x_c: Floats) -> Floats:
    """Where x_c lies: alpha = (x_c - x_tl) / w, eq. 1, kept in the box's middle half; (N, 4),
    (N,) -> (N,).
    """
    return np.asarray(
        np.clip((x_c - boxes[:, 0]) / np.maximum(boxes[:, 2], 1e-9), 0.25, 0.75)
    )


def beta_of(boxes: Floats, y_c: Floats) -> Floats:
    """Where y_c lies: beta = (y_c - y_tl - h/7) / (h - h/7), eq. 2 with its signs set right, kept
    plausible; (N,).
    """
    h = np.maximum(boxes[:, 3], 1e-9)
    return np.asarray(
        np.clip((y_c - boxes[:, 1] - HEAD * h) / ((1 - HEAD) * h), 0.25, 0.65)
    )


def parts_of(boxes: Floats, alpha: Floats, beta: Floats) -> Floats:
    """The parts' rectangles of N boxes, (N, 5, 4) x, y, w, h in pixels, in the order of `PARTS`.

    Args:
        boxes: (N, 4) x, y, w, h.
        alpha: (N,) place of the centroid across, of the width.
        beta: (N,) and down the body, of the height below the head.
    """
    x, y, w, h = boxes.T
    edges = np.empty((len(boxes), 7))
    edges[:, 0], edges[:, 1], edges[:, 2] = x, x + alpha * w, x + w
    shoulders = edges[:, 4] = y + HEAD * h
    edges[:, 3], edges[:, 5], edges[:, 6] = y, shoulders + beta * (h - HEAD * h), y + h
    out = edges[:, _RECTANGLES]
    out[:, :, 2:] -= out[:, :, :2]
    return out


def hung(heads: Floats, sizes: Floats, alpha: Floats) -> Floats:
    """Boxes of given sizes hung from the tops of heads: x_c and y_tl are the head's, alpha gives
    x_tl (PARTS 2.1).

    Args:
        heads: (N, 2) x, y of each head's top in pixels.
        sizes: (N, 2) width, height.
        alpha: (N,).
    """
    return np.stack(
        [heads[:, 0] - alpha * sizes[:, 0], heads[:, 1], sizes[:, 0], sizes[:, 1]], axis=1
    )


def covered(parts: Floats, boxes: Floats, nearer: NDArray[np.bool_]) -> Floats:
    """How much of each part other boxes cover, (N, 5) in [0, 1].

    Args:
        parts: (N, 5, 4).
        boxes: (M, 4) the others.
        nearer: (N, M) whether the other stands in front of whom the parts belong to.
    """
    if not nearer.any():
        return np.zeros((len(parts), parts.shape[1]))
    p, b = parts[:, :, None, :], boxes[None, None, :, :]
    meet = np.minimum(p[..., :2] + p[..., 2:], b[..., :2] + b[..., 2:])
    meet -= np.maximum(p[..., :2], b[..., :2])
    np.maximum(meet, 0.0, out=meet)
    both = meet[..., 0] * meet[..., 1] * nearer[:, None, :]
    area = np.maximum(parts[..., 2] * parts[..., 3], 1e-9)
    return np.asarray(np.minimum(both.sum(axis=2) / area, 1.0))
