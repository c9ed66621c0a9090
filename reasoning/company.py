"""Who was in one region with whom, and what follows for the groups of those who split from somebody
who is not known to have come by himself.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from reasoning.groups import GroupBook, GroupChange
from reasoning.interactions import Cluster, InteractionBook, PairChange
from reasoning.target_columns import TargetColumns, merge_overlapping
from reasoning.transitions import SPLITTING


class Company:
    """Steps the groups; the same frames give the same groups, also after `restore`."""

    def __init__(self, interactions: InteractionBook, groups: GroupBook) -> None:
        self._interactions = interactions
        self._groups = groups
        self._known: dict[int, list[int]] = {}

    def step(
        self, frame: int, ns: int, rows: TargetColumns, clusters: Sequence[Cluster]
    ) -> list[GroupChange]:
        """The groups' next frame, after the bonds'."""
        splitting = [
            pair for pair, bond in self._interactions.bonds.items() if bond.bit == SPLITTING
        ]
        entered: list[list[int]] = []
        if any(rows.of_split):
            born = [
                identity
                for identity, split in zip(rows.ids, rows.of_split, strict=True)
                if split
            ]
            entered = [[i, *self._interactions.partners(i, SPLITTING)] for i in born]
            entered = [
                name
                for name in entered
                if not self._may_be_known(name, rows) and not self._came_apart(name, born)
            ]
        self._keep(clusters, rows)
        return self._groups.step(
            frame, ns, clusters, merge_overlapping(entered), splitting, rows.row
        )

    def _keep(self, clusters: Sequence[Cluster], rows: TargetColumns) -> None:
        """Remember who was in one region with whom, as long as he is there."""
        for c in clusters:
            for i in c.members:
                known = self._known.setdefault(i, [])
                known += [
                    member for member in c.members if member != i and member not in known
                ]
        self._known = {i: cluster for i, cluster in self._known.items() if i in rows.row}

    def _may_be_known(self, born: Sequence[int], rows: TargetColumns) -> bool:
        """Whether one who is born of a split may be somebody who came by himself: one with whom
        they shared a region is not seen now.
        """
        there = {target.id for target in rows.targets if target.present and target.observed}
        return any(j not in there for i in born for j in self._known.get(i, ()))

    def _came_apart(self, name: Sequence[int], born: Sequence[int]) -> bool:
        """Whether one who is born of a split has split from several, so that nobody knows with
        whom of them he came, unless they had come as one themselves.
        """
        before = [i for i in name if i not in born]
        as_one = [set(g.members) for g in self._groups.groups if g.entered_as_one]
        return len(before) > 1 and not any(members.issuperset(before) for members in as_one)

    def state(self) -> list[list[Any]]:
        """Plain data."""
        return [[i, list(cluster)] for i, cluster in self._known.items()]

    def restore(self, state: Sequence[Sequence[Any]]) -> None:
        """Continue from what `state` gave."""
        self._known = {i: list(cluster) for i, cluster in state}


def group_of_pair(
    groups: GroupBook, pair_change: PairChange, changes: Sequence[GroupChange]
) -> int | None:
    """The group that both are in; where they split and it ended for others, the one that had
    them both.
    """
    label = groups.of(pair_change.a)
    if label is not None and label == groups.of(pair_change.b):
        return label
    ended = (
        [group for change in changes for group in change.before]
        if pair_change.after == SPLITTING
        else []
    )
    return next(
        (
            group.label
            for group in ended
            if pair_change.a in group.members and pair_change.b in group.members
        ),
        None,
    )
