"""A frame's targets as columns, and the small transformations of them that the reasoner needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec

from recorders.messages import NO_BLOB, Box, Target


class TargetColumns:
    """A frame's targets as columns, ids ascending."""

    def __init__(self, targets: Sequence[Target], before: Mapping[int, Target]) -> None:
        self.targets = targets
        self.ids = [target.id for target in targets]
        self.row = {identity: index for index, identity in enumerate(self.ids)}
        self.boxes: list[Box] = [target.box for target in targets]
        self.blobs = [target.blob for target in targets]
        self.seen = [target.observed for target in targets]
        self.present = [target.present for target in targets]
        self.newborn = [target.newborn or target.id not in before for target in targets]
        self.of_split = [
            target.born_of_split and new
            for target, new in zip(targets, self.newborn, strict=True)
        ]
        self.inferred: list[int] = []


def ghost(target: Target) -> Target:
    """A target in the frame after its last: at its place, neither present nor observed; as
    sure to be somebody as it was.
    """
    return msgspec.structs.replace(
        target,
        present=False,
        observed=False,
        mode="predicted",
        blob=NO_BLOB,
        newborn=False,
    )


def merge_overlapping(sets: Sequence[Sequence[int]]) -> list[tuple[int, ...]]:
    """Sets that share a member become one; ascending, by the first member."""
    whole: list[list[int]] = []
    for s in sets:
        apart = [w for w in whole if not set(w).intersection(s)]
        together = [i for w in whole if set(w).intersection(s) for i in w]
        whole = [*apart, sorted({*together, *s})]
    return sorted(tuple(w) for w in whole)
