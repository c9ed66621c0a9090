"""Overlaps and the one assignment solver with its tie rule."""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from replay.trackers.association import QUANTUM, assign, intersection, iou, overlaps


def test_overlap_of_boxes() -> None:
    a = np.array([[0.0, 0.0, 10.0, 10.0]])
    b = np.array(
        [
            [0.0, 0.0, 10.0, 10.0],
            [5.0, 0.0, 10.0, 10.0],
            [10.0, 0.0, 5.0, 5.0],
            [2.0, 2.0, 5.0, 5.0],
        ]
    )
    assert intersection(a, b).tolist() == [[100.0, 50.0, 0.0, 25.0]]
    assert iou(a, b)[0] == pytest.approx([1.0, 1 / 3, 0.0, 0.25])


def test_empty_boxes_and_empty_sides() -> None:
    none, one = np.zeros((0, 4)), np.zeros((1, 4))
    assert iou(none, one).shape == (0, 1)
    assert iou(one, one).tolist() == [[0.0]]
    assert assign(np.zeros((0, 3)), np.zeros((0, 3), bool)) == []
    assert assign(np.zeros((2, 2)), np.zeros((2, 2), bool)) == []


def test_ties_go_to_the_first_row_and_column() -> None:
    every = np.ones((2, 3), bool)
    assert assign(np.zeros((2, 3)), every) == [(0, 0), (1, 1)]
    nearly = np.array([[0.5, 0.5 - QUANTUM / 8, 0.5], [0.5, 0.5, 0.5]])
    assert assign(nearly, every) == assign(np.full((2, 3), 0.5), every)


def _best(cost: np.ndarray, allowed: np.ndarray) -> tuple[int, float]:
    rows, columns = cost.shape
    best = (0, 0.0)
    for order in permutations(range(max(rows, columns)), rows):
        pairs = [(i, j) for i, j in enumerate(order) if j < columns and allowed[i, j]]
        found = (len(pairs), -sum(cost[i, j] for i, j in pairs))
        best = max(best, found)
    return best


@given(
    arrays(np.float64, (3, 4), elements=st.integers(0, 64).map(lambda v: v / 16)),
    arrays(np.bool_, (3, 4)),
)
def test_most_pairs_then_least_cost(cost: np.ndarray, allowed: np.ndarray) -> None:
    pairs = assign(cost, allowed)
    assert all(allowed[i, j] for i, j in pairs)
    assert len({j for _, j in pairs}) == len(pairs) == len({i for i, _ in pairs})
    count, value = _best(cost, allowed)
    assert len(pairs) == count
    assert -sum(cost[i, j] for i, j in pairs) == pytest.approx(value)


@given(
    arrays(
        np.float64,
        st.tuples(st.integers(0, 8), st.just(4)),
        elements=st.integers(0, 12).map(float),
    )
)
def test_pairs_that_overlap_are_those_of_the_table(boxes: NDArray[np.float64]) -> None:
    table = intersection(boxes, boxes)
    wanted = [(i, j, table[i, j]) for i, j in np.argwhere(np.triu(table, 1)).tolist()]
    assert overlaps([(x, y, w, h) for x, y, w, h in boxes.tolist()]) == wanted


def test_who_competes_with_nobody_is_matched_as_the_solver_would() -> None:
    cost = np.array([[0.5, 2.0, 9.0], [1.0, 0.1, 9.0]])
    allowed = np.array([[False, False, True], [True, False, False]])
    assert assign(cost, allowed) == [(0, 2), (1, 0)]
