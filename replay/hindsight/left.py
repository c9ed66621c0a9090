"""Things that somebody left: what never goes anywhere, but was first seen beside somebody who then
went away from it.

What stays in one place is seldom somebody (`replay.hindsight.verdicts`): light on a wall, a boot
lid, what the background had taken up. It is not told, unless it came with somebody: a bag that is
put down is seen apart from its owner for the first time beside him, is smaller than he is, and is
still there when he is not.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence

from recorders.messages import Box, Target, Targets

LATELY_S = 1.0
"""A thing is known some sightings after its first: who was beside it so short a time ago counts."""
TOUCH = 0.5
"""Who has the thing within so many of his own widths on either side, and within his height, is
beside it.
"""
SMALLER = 0.5
"""A thing has at most this share of its owner's area: he carried it."""
STAYS_S = 2.0
"""So long is it seen after he has gone: a piece of a body goes with the body."""


class BesideWhom:
    """Beside whom each identity of the forward pass was first seen, and how often it was seen
    without him from then on; a frame lasts ``frame_s`` seconds.
    """

    def __init__(self, frame_s: float) -> None:
        self._frame_s = max(frame_s, 1e-6)
        self._begun: set[int] = set()
        self._boxes: deque[dict[int, Box]] = deque(
            maxlen=max(2, round(LATELY_S / self._frame_s))
        )
        self._without: dict[int, dict[int, int]] = {}

    def watch(self, stream: Iterable[Targets]) -> Iterator[Targets]:
        """Pass a forward pass on, taking note."""
        for answer in stream:
            self._take([target for target in answer.targets if target.present])
            yield answer

    def _take(self, here: Sequence[Target]) -> None:
        boxes = {t.id: t.box for t in here}
        for t in here:
            if t.id not in self._begun:
                self._begun.add(t.id)
                self._begin(t)
            elif t.observed:
                for old in self._without.get(t.id, ()):
                    if old not in boxes or not is_beside(t.box, boxes[old]):
                        self._without[t.id][old] += 1
        self._boxes.append(boxes)

    def _begin(self, thing: Target) -> None:
        """Take note of who was there before, and beside it lately."""
        beside: dict[int, int] = {}
        for boxes in self._boxes:
            for old, box in boxes.items():
                if _smaller(thing.box, box) and is_beside(thing.box, box):
                    beside[old] = 0
        if beside:
            self._without[thing.id] = beside

    def left(self, ids: Sequence[int], people: Mapping[int, Sequence[int]]) -> bool:
        """Whether what was seen under some forward ids was left by one of the people: lives, id ->
        the forward ids that they are made of.
        """
        somebody = {k for chain in people.values() for k in chain}
        without = self._without.get(ids[0], {})
        return any(
            old in somebody and frames * self._frame_s >= STAYS_S
            for old, frames in without.items()
        )


def is_beside(thing: Box, body: Box) -> bool:
    """Whether a thing is in touch with somebody."""
    x, y, w, h = body
    return (
        thing[0] <= x + w + TOUCH * w
        and thing[0] + thing[2] >= x - TOUCH * w
        and thing[1] <= y + h + TOUCH * w
        and thing[1] + thing[3] >= y
    )


def _smaller(thing: Box, body: Box) -> bool:
    return thing[2] * thing[3] <= SMALLER * body[2] * body[3]
