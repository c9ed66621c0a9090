"""Identities that a tracker found to be exchanged are exchanged from when it happened, not from
when it was found.

A tracker says so in a ``track_recovered`` notice with two subjects and its ``since_frame``:
from that frame on until the notice each had the other's id.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

from msgspec.structs import replace

from recorders.messages import Targets


@dataclass(frozen=True, slots=True)
class Exchange:
    """Targets a and b have one another's ids in the frames first <= frame < end."""

    a: int
    b: int
    first: int
    end: int


def exchanges_of(answer: Targets) -> list[Exchange]:
    """The exchanges that a frame's answer tells of."""
    found: list[Exchange] = []
    for notice in answer.notices:
        since = notice.since_frame
        if (
            notice.kind == "track_recovered"
            and len(notice.subjects) == 2
            and since is not None
        ):
            found.append(
                Exchange(notice.subjects[0], notice.subjects[1], since, answer.frame)
            )
    return found


def undone(stream: Iterable[Targets], exchanges: list[Exchange]) -> Iterator[Targets]:
    """The answers with every exchange undone in the frames where it held, in the order in which
    they were found.
    """
    ordered = sorted(exchanges, key=lambda exchange: exchange.end)
    for answer in stream:
        name: dict[int, int] = {}
        for e in ordered:
            if e.first <= answer.frame < e.end:
                swap = {e.a: e.b, e.b: e.a}
                every = {e.a, e.b, *name}
                name = {k: swap.get(name.get(k, k), name.get(k, k)) for k in sorted(every)}
        yield _renamed(answer, name) if name else answer


def _renamed(answer: Targets, name: dict[int, int]) -> Targets:
    targets = [
        replace(target, id=name.get(target.id, target.id)) for target in answer.targets
    ]
    groups = answer.group_tracks
    if groups is not None:
        groups = [
            replace(
                group, members=sorted(name.get(member, member) for member in group.members)
            )
            for group in groups
        ]
    return replace(
        answer, targets=sorted(targets, key=lambda target: target.id), group_tracks=groups
    )
