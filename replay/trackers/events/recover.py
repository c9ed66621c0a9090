"""Matching case 2 (EVENTS 2): an orphan takes over a new low-level track that looks like it and
may be it by place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.trackers.appearance import distance
from replay.trackers.association import assign
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracks import EventsTracks

UNKNOWN = 0.25
"""What unknown colours differ by: as much as one's own colours may after a while."""


@dataclass(frozen=True, slots=True)
class Recovery:
    """An orphan's row, the new track's row, and what the match cost by term."""

    orphan: int
    track: int
    cost: float
    motion: float
    size: float
    appearance: float | None


def recover(
    tracks: EventsTracks,
    orphans: list[int],
    fresh: list[int],
    time_ns: int,
    parameters: EventsParameters,
) -> list[Recovery]:
    """Match orphans to new tracks, the cheapest assignment within the threshold, by orphan."""
    found: dict[tuple[int, int], Recovery] = {}
    cost = np.full((len(orphans), len(fresh)), 100.0)
    allowed: NDArray[np.bool_] = np.zeros(cost.shape, bool)
    for i, orphan in enumerate(orphans):
        for j, b in enumerate(fresh):
            priced = _price(tracks, orphan, b, time_ns, parameters)
            # Who is not lost yet may be seen again where it is expected: only colours say more.
            unsure = priced.appearance is None and not tracks.items[orphan].lost
            if priced.cost <= parameters.recover_cost and not unsure:
                found[i, j] = priced
                cost[i, j], allowed[i, j] = priced.cost, True
    return [found[i, j] for i, j in assign(cost, allowed)]


def _price(
    tracks: EventsTracks, a: int, b: int, time_ns: int, parameters: EventsParameters
) -> Recovery:
    """Half the squared miss, of the straight path or of one who stood still, plus size and
    colours.
    """
    orphan, fresh, bank = tracks.items[a], tracks.items[b], tracks.bank
    gap = (time_ns - orphan.seen_ns) / 1e9
    x, y, w, h = bank.value[a, :4].tolist()
    vx, vy = bank.rate[a, :2].tolist()
    u, v, fw, fh = bank.value[b, :4].tolist()
    # Unseen, the filter went straight on, so the place where the target was last seen is one step
    # back in time.
    misses = [
        math.hypot(x - k * gap * vx - u, y - k * gap * vy - v) for k in (0.0, 0.5, 1.0)
    ]
    front = tracks.behind(a)
    if front is not None:
        # Who did not come out from behind somebody may come out there now.
        px, py, pw, ph = bank.value[front, :4].tolist()
        misses.append(
            math.hypot(max(0.0, abs(px - u) - pw / 2), max(0.0, abs(py - v) - ph / 2))
        )
    size = math.sqrt(max(1.0, w * h))
    motion = (
        0.5 * (min(misses) / (size * (parameters.drift + parameters.drift_rate * gap))) ** 2
    )
    if fresh.split and 0 < orphan.seen_ns <= orphan.apart_ns:
        # Both came out of the blob that it was last seen in: the place says no more.
        motion = 0.0
    differs = abs(math.log(max(fw, 1.0) / max(w, 1.0))) + abs(
        math.log(max(fh, 1.0) / max(h, 1.0))
    )
    colours = None
    if orphan.colours is not None and fresh.colours is not None:
        colours = distance(orphan.colours.table, fresh.colours.table)
    # Without colours nothing but the place speaks for it, so it has to be more exact.
    cost = (
        motion
        + 0.5 * differs
        + parameters.recover_colour_cost * (UNKNOWN if colours is None else colours)
    )
    return Recovery(a, b, cost, motion, differs, colours)
