"""Sets of frames as sorted, disjoint intervals (first, last), both included."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence

Interval = tuple[int, int]


def extend(spans: list[Interval], frame: int, gap: int = 1) -> None:
    """Take a frame in that lies behind all others."""
    if spans and frame - spans[-1][1] <= gap:
        spans[-1] = (spans[-1][0], frame)
    else:
        spans.append((frame, frame))


def union(spans: Iterable[Interval]) -> list[Interval]:
    """Frames of any of them, whatever their order.

    >>> union([(8, 9), (0, 3), (2, 5), (6, 6)])
    [(0, 6), (8, 9)]
    """
    out: list[Interval] = []
    for first, last in sorted(spans):
        if out and first <= out[-1][1] + 1:
            out[-1] = (out[-1][0], max(out[-1][1], last))
        else:
            out.append((first, last))
    return out


def intersect(a: Sequence[Interval], b: Sequence[Interval]) -> list[Interval]:
    """Frames of both.

    >>> intersect([(0, 5), (8, 9)], [(3, 8)])
    [(3, 5), (8, 8)]
    """
    out: list[Interval] = []
    i = j = 0
    while i < len(a) and j < len(b):
        low, high = max(a[i][0], b[j][0]), min(a[i][1], b[j][1])
        if low <= high:
            out.append((low, high))
        if a[i][1] < b[j][1]:
            i += 1
        else:
            j += 1
    return out


def subtract(a: Sequence[Interval], b: Sequence[Interval]) -> list[Interval]:
    """Frames of ``a`` that are not in ``b``.

    >>> subtract([(0, 5), (8, 9)], [(3, 8)])
    [(0, 2), (9, 9)]
    """
    out: list[Interval] = []
    for first, last in a:
        begin = first
        for low, high in b[bisect_left(b, begin, key=lambda interval: interval[1]) :]:
            if low > last:
                break
            if low > begin:
                out.append((begin, low - 1))
            begin = high + 1
        if begin <= last:
            out.append((begin, last))
    return out


def count(spans: Sequence[Interval]) -> int:
    """How many frames.

    >>> count([(0, 2), (9, 9)])
    4
    """
    return sum(last - first + 1 for first, last in spans)
