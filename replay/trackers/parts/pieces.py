"""What is left of somebody who stands behind a thing that nobody tracks: a sign, a post, a parked
car.

The paper knows parts that other people cover (PARTS 2.2). A thing in the scene covers as much,
but has no box, and what is seen beside it is too small for any body. (Ours.)
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import intersection
from replay.trackers.parts.parameters import PartsParameters

Floats = NDArray[np.float64]


def held_by_pieces(
    box: Floats, blobs: Floats, filled: Floats, taken: Floats, p: PartsParameters
) -> tuple[Floats, int] | None:
    """A standing target's box, moved just so far that it holds the pieces that are left of it.

    Args:
        box: (4,) of the predicted size where it was last.
        blobs: (M, 4) all blobs.
        filled: (M,) their foreground pixels.
        taken: (K, 4) boxes of the targets that have been found: what lies in them is explained.
        p: the parameters.

    Returns:
        The box (4,) and the row of the largest piece; None where there are too few pixels, or a
        whole body.
    """
    w, h = box[2:].tolist()
    near = p.pieces_near * w
    grown = box + np.array([-near, -near, 2 * near, 2 * near])
    sizes = blobs[:, 2] * blobs[:, 3]
    inside = intersection(blobs, grown[None])[:, 0] >= p.pieces_inside * sizes
    if len(taken):
        inside &= intersection(blobs, taken).max(axis=1) < 0.5 * sizes
    pieces = np.flatnonzero(inside)
    left = float(filled[pieces].sum())
    if not len(pieces) or not p.pieces_least * w * h <= left <= p.pieces_most * w * h:
        return None
    low = blobs[pieces, :2].min(axis=0)
    high = (blobs[pieces, :2] + blobs[pieces, 2:]).max(axis=0)
    place = np.minimum(np.maximum(box[:2], high - box[2:]), np.maximum(low, high - box[2:]))
    return np.concatenate([place, box[2:]]), int(pieces[np.argmax(filled[pieces])])
