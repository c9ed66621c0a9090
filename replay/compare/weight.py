"""Which differences matter most to a person: who is there and who is whom before what they do,
and that before measured values.
"""

from __future__ import annotations

from collections.abc import Sequence

from recorders.messages import EVENT_LEVELS
from replay.compare.difference import Difference

_THERE = ("appeared", "vanished")
_MEASURED = 8
"""Sorts from this one on are told where there is nothing else to tell."""
_OF_A_SORT = 3
"""So many of one sort are shown before every sort has had its place."""


def weightiest(differences: Sequence[Difference], most: int) -> list[Difference]:
    """The differences that matter most, the weightiest first; of one sort only a few where others
    would have no place.
    """
    ranked = sorted(differences, key=_rank)
    counts: dict[int, int] = {}
    first: list[Difference] = []
    for d in ranked:
        sort = _sort(d)
        counts[sort] = counts.get(sort, 0) + 1
        if counts[sort] <= _OF_A_SORT and sort < _MEASURED:
            first.append(d)
    chosen = first[:most]
    chosen += [d for d in ranked if d not in chosen][: most - len(chosen)]
    return sorted(chosen, key=_rank)


def _rank(difference: Difference) -> tuple[int, float, int, list[int], str]:
    return (
        _sort(difference),
        -_size(difference),
        difference.frame,
        difference.subjects,
        difference.text,
    )


def _sort(difference: Difference) -> int:
    """The lower the weightier."""
    if difference.what in ("recording", "frames"):
        return 0
    if difference.what == "identity":
        return 1
    if difference.what == "track" and difference.change in _THERE:
        return 2 if "partner" not in difference.details else 7
    if difference.change in _THERE:
        quiet = EVENT_LEVELS.get(str(difference.details.get("kind", ""))) == "DEBUG"
        return {"encounter": 3, "group": 4, "relation": 6}.get(
            difference.what, 9 if quiet else 5
        )
    return 8 if difference.change == "moved" else 10


def _size(difference: Difference) -> float:
    """How many frames it is about."""
    if "frames" in difference.details:
        return float(difference.details["frames"])
    lengths = [
        span[1] - span[0]
        for span in (difference.details.get("a"), difference.details.get("b"))
        if difference.what in ("encounter", "group", "relation") and isinstance(span, list)
    ]
    return float(max(lengths, default=0))
