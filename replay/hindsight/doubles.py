"""Two tracks on one body: one that covers, or is covered by, another for most of its life is none.

A person behind another comes out again; a second track on one body stays with the first for as
long as it lives. Where both live as long, the larger one is the body, the other one a part of it.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence

import numpy as np

from recorders.messages import Targets
from replay.trackers.association import intersection

SAME_PLACE = 0.7
"""Share of the smaller of two boxes that lies within the other: they are at one place."""
MOSTLY = 0.75
"""Share of a life that is spent at one place with another one: it is no life of its own."""


class Within:
    """Which identities of the forward pass were at one place, in how many frames."""

    def __init__(self) -> None:
        self._frames: dict[int, int] = {}
        self._areas: dict[int, float] = {}
        self._shared: dict[tuple[int, int], int] = {}

    def watch(self, stream: Iterable[Targets]) -> Iterator[Targets]:
        """Pass a forward pass on, taking note."""
        for answer in stream:
            self._take(answer)
            yield answer

    def _take(self, answer: Targets) -> None:
        here = [target for target in answer.targets if target.present]
        for t in here:
            self._frames[t.id] = self._frames.get(t.id, 0) + 1
            self._areas[t.id] = self._areas.get(t.id, 0.0) + t.box[2] * t.box[3]
        if len(here) < 2:
            return
        boxes = np.array([t.box for t in here])
        areas = np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)
        smaller = np.minimum(areas[:, None], areas[None, :])
        together = np.triu(intersection(boxes, boxes) >= SAME_PLACE * smaller, 1)
        for i, j in np.argwhere(together).tolist():
            pair = min(here[i].id, here[j].id), max(here[i].id, here[j].id)
            self._shared[pair] = self._shared.get(pair, 0) + 1

    def doubles(self, lives: Mapping[int, Sequence[int]]) -> dict[int, tuple[int, float]]:
        """Of lives (id -> the forward ids that it is made of) those that are second tracks on a
        body: the body's id, and the share of its life that it was at one place with it.
        """
        of = {identity: life for life, ids in lives.items() for identity in ids}
        shared: dict[tuple[int, int], int] = {}
        for (i, j), n in sorted(self._shared.items()):
            if i in of and j in of and of[i] != of[j]:
                pair = min(of[i], of[j]), max(of[i], of[j])
                shared[pair] = shared.get(pair, 0) + n
        found: dict[int, tuple[int, float]] = {}
        for a, b in sorted(shared):
            shares = {k: shared[a, b] / self._seen(lives[k]) for k in (a, b)}
            second = [k for k in (a, b) if shares[k] >= MOSTLY and k not in found]
            if second and not {a, b} & found.keys():
                less = min(second, key=lambda k: (self._area(lives[k]), k))
                found[less] = a + b - less, shares[less]
        return found

    def _seen(self, ids: Sequence[int]) -> int:
        """Frames in which a life was present."""
        return max(1, sum(self._frames.get(identity, 0) for identity in ids))

    def _area(self, ids: Sequence[int]) -> float:
        """Mean area of a life's boxes, square pixels."""
        return sum(self._areas.get(identity, 0.0) for identity in ids) / self._seen(ids)
