"""Which variables of a pattern can be renamed into one another without changing what it says.

``joint(a,b)`` says the same of (a, b) as of (b, a), ``present(a) & present(b)`` too, and
``joint(a,b) & joint(c,d)`` of (a, b, c, d) as of (c, d, a, b). A match of such a pattern is told
once.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from itertools import combinations, permutations

from reasoning.questions.macros import INVERSE
from reasoning.questions.patterns.atoms import ATOMS
from reasoning.questions.patterns.grammar import Item, Pattern, Term, variables_of

_ALL_UP_TO = 6


def symmetries(pattern: Pattern) -> list[dict[str, str]]:
    """Renamings, but for the one that changes nothing, after which the pattern says the same.

    Of patterns with more than six variables only those that swap two.
    """
    plain = _canonical(pattern, {})
    return [
        renamed
        for renamed in _renamings(pattern.variables())
        if _canonical(pattern, renamed) == plain
    ]


def _renamings(names: list[str]) -> Iterator[dict[str, str]]:
    if len(names) > _ALL_UP_TO:
        for u, v in combinations(names, 2):
            yield {**{name: name for name in names}, u: v, v: u}
        return
    for order in permutations(names):
        if list(order) != names:
            yield dict(zip(names, order, strict=True))


def _canonical(pattern: Pattern, renamed: Mapping[str, str]) -> object:
    """The same object for two patterns that differ in the order of what has none."""
    free = {
        v: renamed.get(v, v)
        for v in variables_of([i for step in pattern.steps for i in step])
    }
    return tuple(
        _canonical_step([_canonical_item(i, free) for i in step]) for step in pattern.steps
    )


def _canonical_step(items: list[Item]) -> tuple[object, ...]:
    if all(item.link == ("&",) for item in items):
        return tuple(sorted(map(repr, items)))
    if len(items) == 2:
        there = tuple(sorted(items[1].link))
        back = tuple(sorted(INVERSE[r] for r in items[1].link))
        plain = tuple(repr(replace(item, link=())) for item in items)
        return min((plain[0], there, plain[1]), (plain[1], back, plain[0]))
    return tuple(map(repr, items))


def _canonical_item(item: Item, renamed: Mapping[str, str]) -> Item:
    terms = [
        replace(
            term,
            variable=None if term.variable is None else renamed[term.variable],
            position=0,
        )
        for term in item.terms
    ]
    if ATOMS[item.name].symmetric and not ATOMS[item.name].zone:
        terms.sort(key=_order)
    bounds = tuple(sorted((replace(bound, position=0) for bound in item.bounds), key=repr))
    return replace(item, terms=tuple(terms), bounds=bounds, position=0)


def _order(term: Term) -> tuple[str, int]:
    return term.variable or "", -1 if term.number is None else term.number
