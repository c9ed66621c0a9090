"""Where the two papers' views of a pair contradict one another, told once an episode."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from typing import Any

from reasoning import events as tell
from reasoning.answers import Books
from reasoning.interactions import Bond
from reasoning.target_columns import TargetColumns
from reasoning.transitions import GROUPING, SPLITTING


class Disputes:
    """Remembers what is in dispute; the same frames give the same events, also after `restore`."""

    def __init__(self, books: Books, leave_margin: float) -> None:
        self._books = books
        self._leave_margin = leave_margin
        self._held: dict[tuple[int, int], str] = {}

    def step(self, log: tell.EventLog, rows: TargetColumns) -> None:
        """One event per episode in which a pair's two views contradict one another in one way."""
        books = self._books
        disputes: dict[tuple[int, int], str] = {}
        for a, b, bond in [*books.bonds(), *_unbound(books, rows)]:
            state = books.relations.state_of(a, b)
            if state == ("INTERACTION" if bond.bit in (GROUPING, SPLITTING) else "JOINT"):
                continue
            disputes[a, b] = f"{bond.bit} {state}"
            if disputes[a, b] != self._held.get((a, b)):
                edge = books.relations.get(a, b)
                measured: dict[str, Any] = {
                    **tell.safety(bond.distance, self._leave_margin),
                    "blobs": [rows.blobs[rows.row[a]], rows.blobs[rows.row[b]]],
                    "interaction_since_frame": bond.since_frame,
                }
                if edge is not None:
                    measured |= {
                        "shell_gap_px": edge.gap,
                        "relation_since_frame": edge.since_frame,
                    }
                tell.disagreement(log, a, b, bond.bit, state, measured)
        self._held = disputes

    def state(self) -> list[list[Any]]:
        """Plain data."""
        return [[a, b, kind] for (a, b), kind in self._held.items()]

    def restore(self, state: Sequence[Sequence[Any]]) -> None:
        """Continue from what `state` gave."""
        self._held = {(a, b): kind for a, b, kind in state}


def _unbound(books: Books, rows: TargetColumns) -> list[tuple[int, int, Bond]]:
    """Members of one observed group that are no partners, as their safety areas do not meet:
    others connect them.
    """
    found: list[tuple[int, int, Bond]] = []
    for group in books.groups.groups:
        for a, b in combinations(group.members, 2) if group.observed else ():
            if not books.interactions.bit_of(a, b) and a in rows.row and b in rows.row:
                distance = books.interactions.safety_distance(
                    rows.boxes[rows.row[a]], rows.boxes[rows.row[b]]
                )
                found.append((a, b, Bond(0, group.since_frame, group.since_ns, distance)))
    return found
