"""Pairs that may be near one another, found along one axis: what decides about a pair is asked of
these alone.

A scene's targets are few and most pairs are far apart. Sorting them along x and looking only at
those whose extents meet there costs less than a matrix of all pairs, and grows with the number of
neighbours, not of pairs.
"""

from __future__ import annotations

from collections.abc import Sequence

_SLACK = 1e-9
"""Extents reach further by this share and by this many pixels: rounding never leaves out a pair
that meets exactly.
"""


def near_pairs(middles: Sequence[float], reaches: Sequence[float]) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, ascending, among which are all with ``|middle_i - middle_j| <= reach_i
    + reach_j``.

    Args:
        middles: N places on an axis.
        reaches: N half extents, not negative; a row with a NaN is near nobody.

    >>> near_pairs([0.0, 9.0, 30.0], [5.0, 5.0, 5.0])
    [(0, 1)]
    """
    extents: list[tuple[float, float, int]] = []
    for k, (middle, reach) in enumerate(zip(middles, reaches, strict=True)):
        wide = reach + _SLACK * (abs(middle) + reach + 1.0)
        if wide >= 0.0 and middle == middle:  # noqa: PLR0124
            extents.append((middle - wide, middle + wide, k))
    extents.sort()
    found: list[tuple[int, int]] = []
    for index, (_, end, i) in enumerate(extents, 1):
        for start, _, j in extents[index:]:
            if start > end:
                break
            found.append((i, j) if i < j else (j, i))
    found.sort()
    return found
