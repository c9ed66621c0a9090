"""Two tracks on one body: one that covers, or is covered by, another for most of its life is none.

A person behind another comes out again; a second track on one body stays with the first for as
long as it lives. Where both live as long, the larger one is the body, the other one a part of it.

A body that comes apart, dark trousers before a dark floor, leaves two tracks that each have a piece
of it, and neither lies within the other. Two bodies are as large as two; pieces are together no
larger than the one that was there before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence

from recorders.messages import Box, Target, Targets
from replay.trackers.association import overlaps

SAME_PLACE = 0.7
"""Share of the smaller of two boxes that lies within the other: they are at one place."""
MOSTLY = 0.75
"""Share of a life that is spent at one place with another one: it is no life of its own."""


WIDER, HIGHER, LARGER = 1.5, 1.35, 1.5
"""Pieces lie within a body's box times so much in width and in height, and have so many times its
area together.
"""
SHRUNK, PIECE = 0.95, 0.25
"""What is left of it is smaller than it was, and the piece is not as small as somebody far away."""
TORN = 0.5
"""Share of a life for which it was a piece of another's body: it is no life of its own."""
COVERED = 0.4
"""Share of a place that others have, who were there before: it is no place of its own."""
MEMORY = 0.1
"""Share of a frame in what is remembered of a body's size."""
KNOWN = 5
"""Frames after which a body's size is known."""


class Within:
    """Which identities of the forward pass were at one place, in how many frames."""

    def __init__(self) -> None:
        self._frames: dict[int, int] = {}
        self._areas: dict[int, float] = {}
        self._shared: dict[tuple[int, int], int] = {}
        self._sizes: dict[int, tuple[float, float]] = {}
        self._whole: dict[tuple[int, int], tuple[float, float]] = {}
        self._pieces: dict[tuple[int, int], int] = {}
        self._merged: dict[int, int] = {}
        self._covered: dict[tuple[int, int], float] = {}

    def watch(self, stream: Iterable[Targets]) -> Iterator[Targets]:
        """Pass a forward pass on, taking note."""
        for answer in stream:
            self._take(answer)
            yield answer

    def _take(self, answer: Targets) -> None:
        here = [target for target in answer.targets if target.present]
        self._come_apart(here)
        for t in here:
            self._frames[t.id] = self._frames.get(t.id, 0) + 1
            self._areas[t.id] = self._areas.get(t.id, 0.0) + t.box[2] * t.box[3]
            if t.mode != "motion":
                self._merged[t.id] = self._merged.get(t.id, 0) + 1
        if len(here) < 2:
            return
        for i, j, inside in overlaps([t.box for t in here]):
            (_, _, w, h), (_, _, wide, high) = here[i].box, here[j].box
            if inside >= SAME_PLACE * min(max(w * h, 1.0), max(wide * high, 1.0)):
                pair = min(here[i].id, here[j].id), max(here[i].id, here[j].id)
                self._shared[pair] = self._shared.get(pair, 0) + 1
            later, before = (
                (here[i], here[j]) if here[i].id > here[j].id else (here[j], here[i])
            )
            if later.mode != "motion":
                ids = later.id, before.id
                share = inside / max(later.box[2] * later.box[3], 1.0)
                self._covered[ids] = self._covered.get(ids, 0.0) + share

    def _come_apart(self, here: Sequence[Target]) -> None:
        """Take note of who was born in somebody's place, and of how large both are since then."""
        for new in (t for t in here if t.id not in self._frames):
            for old in here:
                if self._frames.get(old.id, 0) >= KNOWN and _in_place(
                    new.box, old.box, self._sizes[old.id]
                ):
                    self._whole[old.id, new.id] = self._sizes[old.id]
        boxes = {t.id: t.box for t in here}
        for pair, (w, h) in self._whole.items():
            if pair[0] in boxes and pair[1] in boxes:
                one, two = boxes[pair[0]], boxes[pair[1]]
                wide, high = _around(one, two)
                left, piece = one[2] * one[3] / (w * h), two[2] * two[3] / (w * h)
                torn = left <= SHRUNK and piece >= PIECE and left + piece <= LARGER
                if torn and wide <= WIDER * w and high <= HIGHER * h:
                    self._pieces[pair] = self._pieces.get(pair, 0) + 1
        for t in here:
            w, h = self._sizes.get(t.id, t.box[2:])
            self._sizes[t.id] = (
                w + MEMORY * (t.box[2] - w),
                h + MEMORY * (t.box[3] - h),
            )

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
        for (old, new), n in sorted(self._pieces.items()):
            share = n / max(1, self._frames[new])
            if share >= TORN and old in of and lives.get(of.get(new, -1)) == [new]:
                found.setdefault(new, (of[old], share))
        for a, b in sorted(shared):
            shares = {k: shared[a, b] / self._seen(lives[k]) for k in (a, b)}
            second = [k for k in (a, b) if shares[k] >= MOSTLY and k not in found]
            if second and not {a, b} & found.keys():
                less = min(second, key=lambda k: (self._area(lives[k]), k))
                found[less] = a + b - less, shares[less]
        for life in sorted(lives.keys() - found.keys(), reverse=True):
            merged = sum(self._merged.get(k, 0) for k in lives[life])
            share = merged / self._seen(lives[life])
            by = self._others(lives[life], of, found) if share >= MOSTLY else {}
            if math.fsum(by.values()) >= COVERED * merged > 0:
                found[life] = max(by, key=lambda k: (by[k], -k)), share
        return found

    def _others(
        self,
        ids: Sequence[int],
        of: Mapping[int, int],
        found: Mapping[int, tuple[int, float]],
    ) -> dict[int, float]:
        """How much of a life's place each of those had who were there before it, and are somebody;
        summed over its frames.
        """
        by: dict[int, float] = {}
        for (later, before), covered in sorted(self._covered.items()):
            body = of.get(before)
            if (
                later in ids
                and body is not None
                and body != of[later]
                and body not in found
            ):
                by[body] = by.get(body, 0.0) + covered
        return by

    def _seen(self, ids: Sequence[int]) -> int:
        """Frames in which a life was present."""
        return max(1, sum(self._frames.get(identity, 0) for identity in ids))

    def _area(self, ids: Sequence[int]) -> float:
        """Mean area of a life's boxes, square pixels."""
        return sum(self._areas.get(identity, 0.0) for identity in ids) / self._seen(ids)


def _around(one: Box, two: Box) -> tuple[float, float]:
    """Width and height of the box around two."""
    return (
        max(one[0] + one[2], two[0] + two[2]) - min(one[0], two[0]),
        max(one[1] + one[3], two[1] + two[3]) - min(one[1], two[1]),
    )


def _in_place(new: Box, old: Box, size: tuple[float, float]) -> bool:
    """Whether a new one is where an old one of that usual size is: both fit into the old one's
    place.
    """
    wide, high = _around(new, old)
    return wide <= WIDER * size[0] and high <= HIGHER * size[1]
