"""When nobody could be seen: the signal was lost, or the camera had turned away.

Who is missing then has not gone and is not hidden: nobody looked. Such a time counts for nothing
where it is asked how long somebody was not seen. Where the camera afterwards shows another view,
places before and after tell nothing of one another.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from recorders.messages import SceneChange


@dataclass(frozen=True, slots=True)
class Blind:
    """A time in which nothing was seen.

    Attributes:
        from_ns: capture time of the first frame that showed nothing.
        to_ns: of the first one after it that showed something.
        moved: it showed another view than the last one before.
    """

    from_ns: int
    to_ns: int
    moved: bool


def blind_times(
    changes: Iterable[tuple[int, SceneChange]], times: Sequence[int]
) -> list[Blind]:
    """The blind times of a recording, in order.

    Args:
        changes: how the picture changed as a whole, each with the time (ns) of the frame with which
            it was told.
        times: all frames' capture times, ns.
    """
    found: list[Blind] = []
    lost: int | None = None
    away: tuple[int, object] | None = None
    for told_ns, change in changes:
        told = change.evidence
        began = told.get("since_frame")
        if not isinstance(began, int):
            continue
        at = bisect_left(times, told_ns) - change.frame + began
        if not 0 <= at < len(times):
            continue  # it began before a piece that was cut out
        if change.kind == "signal_lost":
            lost = times[at]
        elif change.kind == "signal_back" and lost is not None:
            found.append(Blind(lost, times[at], moved=False))
            lost = None
        elif change.kind == "panned" and told.get("view") is None:
            away = times[at], told.get("view_before")
        elif change.kind == "panned" and away is not None:
            found.append(Blind(away[0], times[at], moved=told["view"] != away[1]))
            away = None
    return sorted(found, key=lambda blind: (blind.from_ns, blind.to_ns))


def blind_within(blind: Sequence[Blind], from_ns: int, to_ns: int) -> tuple[float, bool]:
    """How long of a span nothing was seen, in seconds, and whether the view changed in it."""
    seconds, moved = 0.0, False
    for span in blind:
        inside = min(to_ns, span.to_ns) - max(from_ns, span.from_ns)
        if inside > 0:
            seconds += inside * 1e-9
            moved |= span.moved
    return seconds, moved


def seen_until(blind: Sequence[Blind], from_ns: int, seconds: float) -> int:
    """When so many seconds, in which something could be seen, have gone by since a time, ns."""
    end = from_ns + int(seconds * 1e9)
    for span in blind:
        if span.to_ns > from_ns and span.from_ns <= end:
            end += span.to_ns - max(from_ns, span.from_ns)
    return end
