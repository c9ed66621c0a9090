"""What the reasoning's books say after a frame, as the messages of the log."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from msgspec import UNSET

from reasoning.classes import ClassBook
from reasoning.geometry import circles_overlap_share
from reasoning.groups import GroupBook, HeldGroup
from reasoning.interactions import Bond, InteractionBook
from reasoning.regions import SceneBook
from reasoning.relations import RelationBook
from reasoning.target_columns import TargetColumns
from reasoning.transitions import GROUPED, GROUPING, SPLITTING
from recorders.messages import Group, Relation, Track


@dataclass(frozen=True)
class Books:
    """The books that one frame's answers are read from.

    Attributes:
        relations: SHELLS 2.3.
        interactions, groups: EVENTS 3.1.
        scene: EVENTS 3.2.
        classes: what the detections say that targets are.
    """

    relations: RelationBook
    interactions: InteractionBook
    groups: GroupBook
    scene: SceneBook
    classes: ClassBook

    def bonds(self) -> list[tuple[int, int, Bond]]:
        """Pairs of partners, sorted, with what binds them."""
        held = self.interactions.bonds
        return [(a, b, held[a, b]) for a, b in sorted(held)]


def tracks_of(
    books: Books, rows: TargetColumns, radii: Sequence[float], labels: Mapping[int, str]
) -> list[Track]:
    """A frame's tracks.

    Args:
        books: after the frame.
        rows: its targets.
        radii: of their shells, in the same order, pixels.
        labels: by target, what a person says that it is; over what the detections say.
    """
    states, partners = books.interactions.states, books.interactions.partners
    presences = books.scene.targets
    answer: list[Track] = []
    for target, radius in zip(rows.targets, radii, strict=True):
        i = target.id
        state, presence = states[i], presences[i]
        bits: tuple[bool, bool, bool] = (False, False, False)
        lists: tuple[list[int], list[int], list[int]] = ([], [], [])
        group = None
        if state:
            bits = (
                bool(state & GROUPING),
                bool(state & GROUPED),
                bool(state & SPLITTING),
            )
            lists = partners(i, GROUPING), partners(i, GROUPED), partners(i, SPLITTING)
            group = books.groups.of(i) if state & (GROUPED | SPLITTING) else None
        zones = sorted(presence.zones) if presence.zones else []
        # By position, in the order of the definition: twenty keywords a track cost as much as
        # all the rest of it.
        answer.append(
            Track(
                i,
                target.box,
                target.ellipse,
                target.velocity,
                radius,
                target.mode,
                target.confidence,
                target.present,
                target.observed,
                target.blob,
                *bits,
                *lists,
                group,
                presence.status,
                zones,
                target.hidden_parts,
                target.gate,
                target.centroid,
                labels.get(i) or books.classes.of(i) or UNSET,
                target.identity,
            )
        )
    return answer


def relations_of(books: Books) -> list[Relation]:
    """The relations that hold after a frame, with what the other paper says of the pair."""
    answer: list[Relation] = []
    for edge in books.relations.edges:
        bond = books.interactions.bonds.get((edge.a, edge.b))
        bit = 0 if bond is None else bond.bit
        answer.append(
            Relation(
                a=edge.a,
                b=edge.b,
                state="JOINT" if edge.state == "JOINT" else "INTERACTION",
                since_frame=edge.since_frame,
                since_ns=edge.since_ns,
                grouping=bit == GROUPING,
                grouped=bit == GROUPED,
                splitting=bit == SPLITTING,
                shell_overlap=circles_overlap_share(
                    edge.distance, edge.radius_a, edge.radius_b
                ),
                rule=edge.rule,
                met_frame=edge.met_frame,
                met_ns=edge.met_ns,
                partners_since_frame=None if bond is None else bond.since_frame,
                partners_since_ns=None if bond is None else bond.since_ns,
            )
        )
    return answer


def group_of(held_group: HeldGroup) -> Group:
    """A group as a message."""
    former = [list(member) for member in held_group.former_members]
    return Group(
        held_group.label,
        members=list(held_group.members),
        observed=held_group.observed,
        since_frame=held_group.since_frame,
        since_ns=held_group.since_ns,
        formed_from=list(held_group.formed_from),
        former_members=former,
        entered_as_one=held_group.entered_as_one,
    )
