"""Groups and their life (EVENTS 3.1): labels, members, beginnings, ends, and where each came from.

A group is known by its members. Nobody joins or leaves one: when the members under its region
change, it ends and another begins under a new label, which names the labels it was formed from.
Rules of ours where the paper is silent:

- Groups are disjoint: a new group ends every group that has no observation in this frame and
  shares a member.
- A group without observation lives on while two of its members are splitting; the same members
  under one region again are the same group.
- Who is not splitting from any other member has left such a group. Those who stay keep its label;
  under one region again they are another group, as it had other members.
- A target that is born of a split, together with those it collides with, was a group all along:
  one that entered the scene as one and is understood now. It begins without an observation.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Literal

from reasoning.interactions import Cluster


@dataclasses.dataclass(slots=True)
class HeldGroup:
    """A living group; ``members`` ascending; ``source`` names the region it was last observed in;
    ``left``: who was a member and is not any more.
    """

    label: int
    members: tuple[int, ...]
    observed: bool
    since_frame: int
    since_ns: int
    formed_from: tuple[int, ...] = ()
    former_members: tuple[tuple[int, ...], ...] = ()
    entered_as_one: bool = False
    source: str = ""
    source_id: int = -1
    left: tuple[int, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class GroupChange:
    """What happened to a group: ``before`` are the groups that ended for it, with the members
    they had; of one that members have left, itself as it was.
    """

    kind: Literal["group_formed", "group_changed", "group_ended", "group_entered_scene"]
    group: HeldGroup
    before: tuple[HeldGroup, ...] = ()
    lasted_ns: int = 0
    gone: tuple[int, ...] = ()


class GroupBook:
    """All living groups; labels count from 1 and are never used again."""

    def __init__(self) -> None:
        self._groups: dict[int, HeldGroup] = {}
        self._next = 1
        self._of: dict[int, int] = {}

    @property
    def groups(self) -> list[HeldGroup]:
        """Living groups by label."""
        return [self._groups[label] for label in sorted(self._groups)]

    def of(self, target: int) -> int | None:
        """The label of the target's group, if any."""
        return self._of.get(target)

    def step(
        self,
        frame: int,
        time_ns: int,
        clusters: Sequence[Cluster],
        entered: Sequence[tuple[int, ...]],
        splitting: Collection[tuple[int, int]],
        ids: Collection[int],
    ) -> list[GroupChange]:
        """Take a frame's observed clusters; answer with every change in the order: ended, left by
        some, begun (by label).

        Args:
            frame: its index.
            time_ns: its time.
            clusters: members under one observed region, disjoint.
            entered: members of each group that is understood to have entered as one.
            splitting: pairs (a < b) that are splitting in this frame.
            ids: the targets of this frame.
        """
        if not (clusters or entered or self._groups):
            return []
        by_members = {
            group.members: group for group in self._groups.values() if not group.left
        }
        for g in self._groups.values():
            g.observed = False
        fresh = [cluster for cluster in clusters if cluster.members not in by_members]
        for cluster in clusters:
            if cluster.members in by_members:
                g = by_members[cluster.members]
                g.observed, g.source, g.source_id = True, cluster.source, cluster.source_id
        begun = [self._begin(frame, time_ns, c.members, c) for c in fresh]
        taken = {
            member
            for group in self._groups.values()
            if group.observed
            for member in group.members
        }
        for members in entered:
            free = tuple(member for member in members if member not in taken)
            if len(free) >= 2:
                begun.append(self._begin(frame, time_ns, free, None))
                taken.update(free)
        replaced = self._end_replaced([c.group.label for c in begun])
        begun = [self._name(c, replaced) for c in begun]
        ended = self._end_idle(time_ns, splitting, ids)
        left = self._drop_left(splitting)
        self._of = {
            member: group.label for group in self.groups for member in group.members
        }
        return ended + left + begun

    def _begin(
        self, frame: int, ns: int, members: tuple[int, ...], cluster: Cluster | None
    ) -> GroupChange:
        source, number = (
            ("", -1) if cluster is None else (cluster.source, cluster.source_id)
        )
        group = HeldGroup(
            self._next,
            members,
            cluster is not None,
            frame,
            ns,
            source=source,
            source_id=number,
            entered_as_one=cluster is None,
        )
        self._groups[group.label] = group
        self._next += 1
        return GroupChange(
            "group_formed" if cluster is not None else "group_entered_scene", group
        )

    def _drop_left(self, splitting: Collection[tuple[int, int]]) -> list[GroupChange]:
        """Groups without observation: who is not splitting from another member is none any more."""
        changes: list[GroupChange] = []
        for group in self.groups:
            if group.observed:
                continue
            members = set(group.members)
            inner = {i for p in splitting if members.issuperset(p) for i in p}
            if inner and inner != members:
                before = dataclasses.replace(group)
                group.left += tuple(
                    member for member in group.members if member not in inner
                )
                group.members = tuple(member for member in group.members if member in inner)
                changes.append(GroupChange("group_changed", group, (before,)))
        return changes

    def _end_replaced(self, new: Sequence[int]) -> list[HeldGroup]:
        """End the old groups without observation that share a member with a new one."""
        fresh = {member for label in new for member in self._groups[label].members}
        old = [
            group
            for group in self.groups
            if group.label not in new
            and not group.observed
            and fresh.intersection(group.members)
        ]
        for g in old:
            del self._groups[g.label]
        return old

    def _name(self, change: GroupChange, replaced: Sequence[HeldGroup]) -> GroupChange:
        """Name the groups that a new one was formed from."""
        group = change.group
        before = tuple(g for g in replaced if set(g.members).intersection(group.members))
        if not before:
            return change
        group.formed_from = tuple(g.label for g in before)
        group.former_members = tuple(g.members for g in before)
        kind: Literal["group_changed", "group_entered_scene"] = (
            "group_entered_scene"
            if change.kind == "group_entered_scene"
            else "group_changed"
        )
        return GroupChange(kind, group, before)

    def _end_idle(
        self, ns: int, splitting: Collection[tuple[int, int]], ids: Collection[int]
    ) -> list[GroupChange]:
        """End the groups that have neither an observation nor two members that are splitting."""
        ended: list[GroupChange] = []
        for group in self.groups:
            members = set(group.members)
            if group.observed or any(a in members and b in members for a, b in splitting):
                continue
            del self._groups[group.label]
            gone = tuple(member for member in group.members if member not in ids)
            ended.append(
                GroupChange("group_ended", group, lasted_ns=ns - group.since_ns, gone=gone)
            )
        return ended

    def state(self) -> dict[str, Any]:
        """The whole book as plain data."""
        groups = [dataclasses.asdict(group) for group in self.groups]
        for group in groups:
            for name in ("members", "formed_from", "left"):
                group[name] = list(group[name])
            group["former_members"] = [list(member) for member in group["former_members"]]
        return {"groups": groups, "next": self._next}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._groups = {}
        for g in state["groups"]:
            former = tuple(tuple(member) for member in g["former_members"])
            plain = dict(
                g,
                members=tuple(g["members"]),
                formed_from=tuple(g["formed_from"]),
                left=tuple(g["left"]),
                former_members=former,
            )
            self._groups[plain["label"]] = HeldGroup(**plain)
        self._next = state["next"]
        self._of = {
            member: group.label for group in self.groups for member in group.members
        }
