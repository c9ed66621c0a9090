"""Group trackers (EVENTS 3.1): low-level tracks over blobs that hold several targets.

A low-level track that is born over a collision zone is one: its detection covers targets whose
safety areas superpose and that have none of their own (`members_of`, `hold_members`).

A region of pixels (a blob, or a detection where there are no masks) that two or more confirmed
targets share is observed by a group tracker. It is known by its members: nobody joins one, so
other members are another tracker.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reasoning.interactions import InteractionParameters, collision_map
from recorders.messages import NO_BLOB, Box, GroupTrack
from replay.trackers.association import intersection
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracks import EventsTracks
from replay.trackers.life import TENTATIVE

Floats = NDArray[np.float64]


def members_of(
    tracks: EventsTracks, box: Floats, parameters: EventsParameters
) -> list[int]:
    """Whom a new track at a box (4,) is a group tracker of: two or more targets without an
    observation that collide, and of whose boxes it covers enough; [] if it is none.
    """
    rows = [
        index
        for index, item in enumerate(tracks.items)
        if item.told and not item.lost and not item.observed
    ]
    if len(rows) < 2:
        return []
    boxes = tracks.boxes[rows]
    share = intersection(boxes, box[None])[:, 0] / np.maximum(
        boxes[:, 2] * boxes[:, 3], 1.0
    )
    under = np.flatnonzero(share >= parameters.min_shared)
    zone = collision_map(boxes[under], InteractionParameters().safety_margin)
    return sorted(
        tracks.items[rows[under[row]]].id for row in np.flatnonzero(zone.any(axis=1))
    )


def hold_members(tracks: EventsTracks) -> None:
    """The members of every observed group tracker lie in its region, and go where it goes."""
    rows = {item.id: index for index, item in enumerate(tracks.items) if item.told}
    for k, group in enumerate(tracks.items):
        if not group.members or not group.observed:
            continue
        here = [rows[i] for i in group.members if i in rows]
        here = [
            r for r in here if not tracks.items[r].observed and not tracks.items[r].lost
        ]
        if len(here) < 2:
            continue
        for row in here:
            member = tracks.items[row]
            member.hidden = member.grouped = True
            member.blob = group.column + 1 if group.blob == NO_BLOB else group.blob
            tracks.bank.rate[row, :2] = tracks.bank.rate[k, :2]


class SharedBlob:
    """Who lately shared a region of pixels with whom.

    Args:
        hold_s: who shared a region is in it for this long still: blobs that come apart often
            touch again in the next frame. 0: never, as in the paper.
    """

    def __init__(self, hold_s: float) -> None:
        self._hold_ns = round(hold_s * 1e9)
        self._shared: dict[tuple[int, int], int] = {}

    def step(self, tracks: EventsTracks, time_ns: int) -> None:
        """Put those that have come apart just now into one region: the one of who has the lowest
        id.
        """
        if not self._hold_ns:
            return
        here = {
            item.id: item for item in tracks.items if item.id != TENTATIVE and not item.lost
        }
        ids = sorted(here)
        regions: dict[int, list[int]] = {}
        for identity in ids:
            if here[identity].blob != NO_BLOB:
                regions.setdefault(here[identity].blob, []).append(identity)
        for members in regions.values():
            self._shared.update((pair, time_ns) for pair in combinations(members, 2))
        self._shared = {
            pair: ns
            for pair, ns in sorted(self._shared.items())
            if time_ns - ns <= self._hold_ns and pair[0] in here and pair[1] in here
        }
        for a, b in self._shared:
            mine, theirs = here[a].blob, here[b].blob
            here[a].held |= mine != theirs
            here[b].held |= mine != theirs
            if mine != theirs and NO_BLOB not in (mine, theirs):
                for identity in ids:
                    here[identity].blob = (
                        mine if here[identity].blob == theirs else here[identity].blob
                    )
            elif mine != theirs:
                here[a].blob = here[b].blob = max(mine, theirs)

    def state(self) -> list[list[int]]:
        """Plain data for a checkpoint."""
        return [[a, b, ns] for (a, b), ns in sorted(self._shared.items())]

    def restore(self, state: Sequence[Sequence[int]]) -> None:
        """Continue from what `state` gave."""
        self._shared = {(a, b): ns for a, b, ns in state}


@dataclass(slots=True)
class _Held:
    id: int
    members: list[int]
    box: Box
    seen_ns: int


class GroupTracks:
    """All living group trackers; numbers count from 1 and are never used again."""

    def __init__(self, keep_s: float) -> None:
        self._keep_ns = round(keep_s * 1e9)
        self._held: list[_Held] = []
        self._next = 1

    def step(
        self, time_ns: int, shared: Sequence[tuple[Sequence[int], Box]]
    ) -> list[GroupTrack]:
        """Take the regions of a frame that hold several targets.

        Args:
            time_ns: the frame's time.
            shared: members (ids ascending) and box of each region, in the order of the regions.

        Returns:
            All group trackers by id. One without an observation is kept for a short while, unless
            one of its members is under another one now.
        """
        taken = {member for members, _ in shared for member in members}
        by_members = {tuple(h.members): h for h in self._held}
        out: list[GroupTrack] = []
        kept: list[_Held] = []
        for h in self._held:
            if time_ns - h.seen_ns <= self._keep_ns and not taken.intersection(h.members):
                kept.append(h)
                out.append(GroupTrack(h.id, h.box, False, False, list(h.members)))
        for members, box in shared:
            held = by_members.get(tuple(members))
            newborn = held is None
            if held is None:
                held = _Held(self._next, list(members), box, time_ns)
                self._next += 1
            held.box, held.seen_ns = box, time_ns
            kept.append(held)
            out.append(GroupTrack(held.id, box, True, newborn, list(members)))
        self._held = sorted(kept, key=lambda h: h.id)
        return sorted(out, key=lambda group: group.id)

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {
            "held": [{**asdict(shared), "box": list(shared.box)} for shared in self._held],
            "next": self._next,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._held = [
            _Held(
                shared["id"],
                list(shared["members"]),
                tuple(shared["box"]),
                shared["seen_ns"],
            )
            for shared in state["held"]
        ]
        self._next = state["next"]
