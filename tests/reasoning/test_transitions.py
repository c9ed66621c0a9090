"""The published 8 x 8 table: the code, the page and the rules for pairs say the same."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from reasoning.interactions import InteractionBook, TargetRows, pair_bit
from reasoning.transitions import (
    GROUPED,
    GROUPING,
    SPLITTING,
    TABLE,
    TransitionCounter,
    code,
    markdown,
    name,
)

PAGE = Path(__file__).resolve().parents[2] / "docs" / "transitions.md"


def test_the_page_is_current() -> None:
    assert PAGE.read_text(encoding="utf-8") == markdown(), (
        "run: python -m reasoning.transitions > docs/transitions.md"
    )


def feasible(birth: bool) -> set[tuple[int, int]]:
    """Which transitions of a target two or three partners can add up to, by brute force over the
    pairs' table.
    """
    bits = (0, GROUPING, GROUPED, SPLITTING)
    truth = (False, True)
    moves = {
        (before, pair_bit(before, collides, over, newborn, newborn and birth))
        for before, collides, over, newborn in itertools.product(bits, truth, truth, truth)
        if not (newborn and before) and not (newborn and over)
    }
    found = set()
    for partners in itertools.product(sorted(moves), repeat=4):
        before = after = 0
        for b, a in partners:
            before, after = before | b, after | a
        found.add((before, after))
    return found


def test_the_table_is_what_pairs_can_add_up_to() -> None:
    without, with_birth = feasible(birth=False), feasible(birth=True)
    for (a, b), rule in TABLE.items():
        expected = (
            "allowed"
            if (a, b) in without
            else "by birth"
            if (a, b) in with_birth
            else "forbidden"
        )
        assert rule.verdict == ("stay" if a == b and expected == "allowed" else expected), (
            code(a),
            code(b),
        )
        assert rule.why


def test_the_papers_examples() -> None:
    assert (
        TABLE[GROUPED, 0].verdict == "forbidden"
    )  # "grouped targets cannot become single"
    assert (
        TABLE[GROUPED, GROUPING | SPLITTING].verdict == "allowed"
    )  # the example of complex interaction
    assert TABLE[0, GROUPING].verdict == "allowed"
    assert TABLE[GROUPING, GROUPED].verdict == "allowed"
    assert TABLE[GROUPED, SPLITTING].verdict == "allowed"
    assert TABLE[SPLITTING, 0].verdict == "allowed"


def test_a_new_partner_is_no_transition() -> None:
    """EVENTS 3.1: attributes may change without a state transition."""
    book = InteractionBook()
    for third in (90, 35):
        boxes = np.array([[x, 0, 20, 20] for x in (0, 20, third)], np.float64)
        rows = TargetRows(
            [1, 2, 3],
            boxes,
            blobs=[1, 2, 3],
            seen=[True] * 3,
            present=[True] * 3,
            newborn=[False] * 3,
            of_split=[False] * 3,
        )
        book.step(0, 0, rows, None)
        assert book.states[2] == GROUPING
        assert book.partners(2, GROUPING) == ([1] if third == 90 else [1, 3])
    assert TABLE[GROUPING, GROUPING].verdict == "stay"


def test_codes_and_names() -> None:
    assert [code(s) for s in (0, GROUPING, GROUPED, SPLITTING, 7)] == [
        "000",
        "100",
        "010",
        "001",
        "111",
    ]
    assert name(0) == "single"
    assert name(7) == "grouping + grouped + splitting"


@pytest.mark.parametrize(
    ("before", "after", "by_birth", "legal"),
    [
        (0, 4, False, True),
        (2, 0, False, False),
        (2, 0, True, False),
        (0, 1, False, False),
        (0, 1, True, True),
    ],
)
def test_the_counter_checks(before: int, after: int, by_birth: bool, legal: bool) -> None:
    counter = TransitionCounter()
    counter.begin(before)
    assert counter.move(before, after, by_birth) is legal
    assert counter.forbidden == (not legal)
    assert counter.summary()["exercised"] == {f"{code(before)}>{code(after)}": 1}
    twin = TransitionCounter()
    twin.restore(counter.state())
    assert twin.summary() == counter.summary()
