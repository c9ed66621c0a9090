"""Bodies that are seen in pieces only: dark clothes before dark windows leave a head, hands and
legs, each of which stands alone and looks as clean as a body.

What tells them is that they go together: one above the other, by the same way in a moment. Bodies
that pass one another do so seldom, the pieces of one body always.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

TORN = 0.07
"""Bodies are torn where this share of what is seen clean and moves, by area, goes together with
something else: of whole bodies it is under .03, of torn ones over .1.
"""
STANDING = 0.4
"""And where together they are of a width, of their height, as people who stand or walk: .2 to .3. Of cars that
follow one another it is .45 to .65.
"""
TORN_GAP = 0.75
"""Between the pieces of a torn body lies at most this, of the usual height."""
ABOVE = 0.5
"""Pieces lie above one another if they share this of the narrower one's columns, and no row."""
SAME_WAY, LEAST_WAY = 0.3, 1.5
"""Their ways across the picture differ by this share, or by this, px; they move by more than that."""
OF_ONE_KIND = 0.1
"""A piece has at least this share of the other's area: hands and heads, not specks."""


def going_together(regions: Floats, way: Floats) -> NDArray[np.intp]:
    """Which regions of a picture go together: (N,) for each the first one that it goes with.

    Args:
        regions: (N, 5+) x, y, w, h, area, px.
        way: (N,) how far each moves to the right in a moment, px; 0 for one that is not seen again.
    """
    x, y, w, h, area = regions[:, :5].T

    def shared(low: Floats, size: Floats) -> Floats:
        high = low + size
        return np.minimum(high[:, None], high) - np.maximum(low[:, None], low)

    far = np.abs(way)
    pairs = shared(x, w) >= ABOVE * np.minimum(w[:, None], w)
    pairs &= shared(y, h) <= 0
    pairs &= (far > LEAST_WAY)[:, None] & (far > LEAST_WAY)
    off = np.maximum(LEAST_WAY, SAME_WAY * np.minimum(far[:, None], far))
    pairs &= np.abs(way[:, None] - way) <= off
    pairs &= np.minimum(area[:, None], area) >= OF_ONE_KIND * np.maximum(
        area[:, None], area
    )
    first = np.arange(len(regions))
    while True:
        lower = np.minimum(
            first, np.where(pairs, first, len(regions)).min(axis=1, initial=len(regions))
        )
        if (lower == first).all():
            return first
        first = lower


def joined(regions: Floats, first: NDArray[np.intp]) -> Floats:
    """The bodies that regions (N, 5+) make which go together: (K, 5) x, y, w, h, area, px."""
    found = []
    for number in np.flatnonzero(np.bincount(first, minlength=1) > 1).tolist():
        own = regions[first == number]
        low = own[:, :2].min(axis=0)
        size = (own[:, :2] + own[:, 2:4]).max(axis=0) - low
        found.append([*low, *size, own[:, 4].sum()])
    return np.array(found, np.float64).reshape(-1, 5)
