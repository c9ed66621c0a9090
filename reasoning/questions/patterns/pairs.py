"""Which items of a pattern are matched as pairs before it matters which of the two is which.

``interaction(a,b) ; joint(a,b)[gap<10s]`` asks two things of the same two targets, soon after one
another. Rows of a pair stand in the tables once, the lower id first. Matched as they stand, and
turned both ways afterwards, such items need half the rows of a match of everything both ways
round.
"""

from __future__ import annotations

from reasoning.questions.patterns.atoms import ATOMS
from reasoning.questions.patterns.grammar import Item, Pattern

_APART = ("before", "after")


def one_way_groups(pattern: Pattern) -> list[list[Item]]:
    """Items of the same two variables that each touch the time of one before them, or follow it
    within a limit.

    Without such a limit a group would be a list of all times of a pair against all of its others:
    those stay alone.
    """
    groups: list[list[Item]] = []
    for one, other in _ties(pattern):
        if _pair(one) is None or _pair(one) != _pair(other):
            continue
        held = [group for group in groups if any(i is one or i is other for i in group)]
        whole = {id(i): i for g in held for i in g} | {id(i): i for i in (one, other)}
        groups = [group for group in groups if all(group is not h for h in held)] + [
            list(whole.values())
        ]
    return groups


def _pair(item: Item) -> frozenset[str] | None:
    """The two variables of an item of a pair."""
    names = frozenset(term.variable for term in item.terms if term.variable is not None)
    return names if ATOMS[item.name].one_way is not None and len(names) == 2 else None


def _ties(pattern: Pattern) -> list[tuple[Item, Item]]:
    """Pairs of wanted items whose times are bounded against one another, the earlier one first."""
    ties: list[tuple[Item, Item]] = []
    previous: list[Item] = []
    for step in pattern.steps:
        items = [i for i in step if not i.negated]
        if not items:
            continue
        for index, item in enumerate(items[1:], 1):
            if item.link == ("&",):
                ties += [(other, item) for other in items[:index]]
            elif not set(item.link) & set(_APART):
                ties.append((items[index - 1], item))
        soon = any(
            bound.what == "gap" and bound.compare in ("<", "<=")
            for bound in items[0].bounds
        )
        if len(items) == len(previous) == 1 and soon and not items[0].repeated:
            ties.append((previous[0], items[0]))
        previous = items
    return ties
