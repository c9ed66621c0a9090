"""Group trackers (EVENTS 3.1): low-level tracks over blobs that hold several targets.

A region of pixels (a blob, or a detection where there are no masks) that two or more confirmed
targets share is observed by a group tracker. It is known by its members: nobody joins one, so
other members are another tracker.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import combinations
from typing import Any

from recorders.messages import NO_BLOB, Box, GroupTrack
from replay.trackers.events.tracks import Tracks
from replay.trackers.life import TENTATIVE

HOLD_NS = 120_000_000
"""Who shared a region is in it for this long still: blobs that come apart often touch again in
the next frame.
"""


class Together:
    """Who lately shared a region of pixels with whom, so that a blob's flicker is neither a split
    nor a meeting.
    """

    def __init__(self) -> None:
        self._shared: dict[tuple[int, int], int] = {}

    def step(self, tracks: Tracks, time_ns: int) -> None:
        """Put those that have come apart just now into one region: the one of who has the lowest
        id.
        """
        here = {t.id: t for t in tracks.items if t.id != TENTATIVE and not t.lost}
        ids = sorted(here)
        regions: dict[int, list[int]] = {}
        for i in ids:
            if here[i].blob != NO_BLOB:
                regions.setdefault(here[i].blob, []).append(i)
        for members in regions.values():
            self._shared.update((pair, time_ns) for pair in combinations(members, 2))
        self._shared = {
            pair: ns
            for pair, ns in sorted(self._shared.items())
            if time_ns - ns <= HOLD_NS and pair[0] in here and pair[1] in here
        }
        for a, b in self._shared:
            mine, theirs = here[a].blob, here[b].blob
            here[a].held |= mine != theirs
            here[b].held |= mine != theirs
            if mine != theirs and NO_BLOB not in (mine, theirs):
                for i in ids:
                    here[i].blob = mine if here[i].blob == theirs else here[i].blob
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
        taken = {i for members, _ in shared for i in members}
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
        return sorted(out, key=lambda g: g.id)

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {
            "held": [{**asdict(h), "box": list(h.box)} for h in self._held],
            "next": self._next,
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._held = [
            _Held(h["id"], list(h["members"]), tuple(h["box"]), h["seen_ns"])
            for h in state["held"]
        ]
        self._next = state["next"]
