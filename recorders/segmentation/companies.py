"""How many bodies a blob holds: as many as came into it, as long as it is large enough for them.

A large blob is several bodies where several met in it, and one large body where it came as one
and never parted. Blobs are followed from frame to frame by their boxes, and what they had for an
area while they were alone tells how many of them are seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob, Ellipse
from recorders.segmentation.blobs import Labels
from recorders.segmentation.touching import (
    TouchingBody,
    bodies_in,
    body_of,
    parted,
    pixels_of,
    shared_out,
)

Floats = NDArray[np.float64]
Corners = tuple[float, float, float, float]

OLD_S = 0.4
"""Whoever was by himself for less than this was a piece of a body."""
SHARED = 0.3
"""A blob goes on in another one if their boxes share this much of the smaller one."""
SIDE_BY_SIDE = 0.8
"""Bodies lie side by side where they fill this share of the area that they had alone. Where one
hides the other there is nothing to divide.
"""
BODY = 0.4
"""Who meets a body is one if he has this share of its area, and not a piece of it."""
FOLLOWS = 0.1
"""The area of who is alone follows what is seen by this share in a frame."""


@dataclass
class Member:
    """A body: its area as it was alone, px, and the ellipse of what was last seen of it."""

    area: float
    ellipse: Ellipse


@dataclass(eq=False)
class FollowedBlob:
    """A blob as it is followed.

    Attributes:
        box: x1, y1, x2, y2, px.
        members: the bodies in it.
        age: frames since it came to be by itself.
        off: of whom it is a piece, or came off: as long as it is not old.
    """

    box: Corners
    members: list[Member]
    age: int = 0
    off: FollowedBlob | None = None

    def seen(self, area: float) -> int:
        """How many of its members lie side by side in an area."""
        total, count = 0.0, 1
        for k, one in enumerate(sorted((m.area for m in self.members), reverse=True), 1):
            total += one
            if area >= SIDE_BY_SIDE * total:
                count = k
        return count


class Companies:
    """Follows the blobs of a recording, frame after frame."""

    def __init__(self, fps: float) -> None:
        self._old = max(2, round(OLD_S * fps))
        self._alive: list[FollowedBlob] | None = None

    def bodies(
        self, blobs: Sequence[Blob], labels: Labels, areas: Sequence[float]
    ) -> list[TouchingBody]:
        """The bodies in the blobs of the next frame, blob by blob.

        Args:
            blobs: the frame's; blob k - 1 is label k.
            labels: (H, W) int32, components from 1.
            areas: of a body where each is, px; 0 where bodies are not alike: pieces of one cannot
                be told from others, and a blob is one body. In the first frame, where nobody knows
                who came into a blob, it tells how many there are.
        """
        boxes: list[Corners] = [
            (x, y, x + w, y + h) for x, y, w, h in (b.box for b in blobs)
        ]
        if self._alive is None:
            self._alive = [
                FollowedBlob(box, _first(blob, labels, bodies_in(blob, area)), self._old)
                for box, blob, area in zip(boxes, blobs, areas, strict=True)
            ]
        else:
            self._go_on(boxes, blobs)
        found: list[TouchingBody] = []
        for company, blob, area in zip(self._alive, blobs, areas, strict=True):
            found += _bodies_in(company, blob, labels, area > 0)
        return found

    def _go_on(self, boxes: Sequence[Corners], blobs: Sequence[Blob]) -> None:
        """Take the next frame's blobs."""
        into, part_of = self._came(boxes)
        now = []
        for k, (box, blob) in enumerate(zip(boxes, blobs, strict=True)):
            if into[k]:
                company = self._met(into[k])
            else:
                company = FollowedBlob(box, [Member(float(blob.area), blob.ellipse)])
                company.off = max(part_of[k], key=lambda c: len(c.members), default=None)
            company.box = box
            self._grow(company, float(blob.area))
            now.append(company)
        self._alive = now

    def _came(
        self, boxes: Sequence[Corners]
    ) -> tuple[list[list[FollowedBlob]], list[list[FollowedBlob]]]:
        """For each box the companies that go on in it, and those that it came off."""
        into: list[list[FollowedBlob]] = [[] for _ in boxes]
        part_of: list[list[FollowedBlob]] = [[] for _ in boxes]
        others = np.array(boxes, np.float64).reshape(-1, 4)
        for company in (self._alive or ()) if boxes else ():
            shared, share = _shared(company.box, others)
            best = int(shared.argmax())
            for k in np.flatnonzero(share >= SHARED).tolist():
                (into if k == best else part_of)[k].append(company)
        return into, part_of

    def _met(self, companies: list[FollowedBlob]) -> FollowedBlob:
        """What several become that meet: the oldest one (the first of equals), with the others'
        members where they are old.
        """
        one = max(companies, key=lambda c: c.age)
        for other in companies:
            if other is not one and other.age >= self._old:
                least = BODY * max(m.area for m in one.members)
                one.members += [m for m in other.members if m.area >= least]
        return one

    def _grow(self, company: FollowedBlob, area: float) -> None:
        """A frame older; who has come off for long is not in the other one any more."""
        company.age += 1
        if len(company.members) == 1:
            one = company.members[0]
            one.area += FOLLOWS * (area - one.area)
        left = company.off
        if left is not None and company.age >= self._old:
            company.off = None
            if len(left.members) > 1:
                here = company.members[0].ellipse
                left.members.remove(min(left.members, key=lambda m: _away(m.ellipse, here)))


def _away(a: Ellipse, b: Ellipse) -> float:
    """Squared distance of two ellipses' centres, px^2."""
    return (a.x - b.x) ** 2 + (a.y - b.y) ** 2


def _first(blob: Blob, labels: Labels, count: int) -> list[Member]:
    """The members of a blob that is there at the beginning."""
    masks = shared_out(pixels_of(blob, labels), count)
    bodies = [body_of(mask, blob, len(masks)) for mask in masks]
    return [Member(blob.area / len(masks), body.ellipse) for body in bodies]


def _bodies_in(
    company: FollowedBlob, blob: Blob, labels: Labels, alike: bool
) -> list[TouchingBody]:
    """The bodies in a blob, whose members take their new places."""
    if not alike or company.seen(float(blob.area)) < 2:
        if len(company.members) == 1:
            company.members[0].ellipse = blob.ellipse
        return [TouchingBody(blob.box, blob.ellipse, blob.id, 1)]
    left, top = int(blob.box[0]), int(blob.box[1])
    known = [m.ellipse for m in company.members]
    masks = parted(pixels_of(blob, labels), left, top, known)
    found = []
    for member, mask in zip(company.members, masks, strict=True):
        if mask.any():
            body = body_of(mask, blob, len(masks))
            member.ellipse = body.ellipse
            found.append(body)
    return found


def _shared(box: Corners, boxes: Floats) -> tuple[Floats, Floats]:
    """What a box shares with each of others, (N, 4) x1, y1, x2, y2: px^2, and of the smaller one's
    area.
    """
    low = np.maximum(np.array(box[:2]), boxes[:, :2])
    high = np.minimum(np.array(box[2:]), boxes[:, 2:])
    shared = np.maximum(high - low, 0.0).prod(axis=1)
    own = (box[2] - box[0]) * (box[3] - box[1])
    areas = (boxes[:, 2:] - boxes[:, :2]).prod(axis=1)
    return shared, shared / np.maximum(np.minimum(own, areas), 1e-9)
