"""Group trackers (EVENTS 3.1): low-level tracks over blobs that hold several targets.

A region of pixels (a blob, or a detection where there are no masks) that two or more confirmed targets share is
observed by a group tracker. It is known by its members: nobody joins one, so other members are another tracker.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from recorders.messages import Box, GroupTrack


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

    def step(self, time_ns: int, shared: Sequence[tuple[Sequence[int], Box]]) -> list[GroupTrack]:
        """Take the regions of a frame that hold several targets.

        Args:
            time_ns: the frame's time.
            shared: members (ids ascending) and box of each region, in the order of the regions.

        Returns:
            All group trackers by id. One without an observation is kept for a short while, unless one of its members
            is under another one now.
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
        return {"held": [{**asdict(h), "box": list(h.box)} for h in self._held], "next": self._next}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._held = [_Held(h["id"], list(h["members"]), tuple(h["box"]), h["seen_ns"]) for h in state["held"]]
        self._next = state["next"]
