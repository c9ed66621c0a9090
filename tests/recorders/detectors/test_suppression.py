"""Of boxes over one another, the best stays."""

from __future__ import annotations

import numpy as np

from recorders.detectors.suppression import suppress


def kept(
    boxes: np.ndarray | list[list[int]],
    scores: list[float],
    classes: list[int],
    overlap: float = 0.5,
) -> list[int]:
    return suppress(
        np.array(boxes, np.float64), np.array(scores), np.array(classes), overlap
    ).tolist()


BOX, NEAR, FAR = [0, 0, 10, 10], [1, 0, 11, 10], [20, 0, 30, 10]


def test_best_first_and_its_doubles_go() -> None:
    assert kept([NEAR, FAR, BOX], [0.6, 0.7, 0.9], [0, 0, 0]) == [2, 1]


def test_other_classes_stay() -> None:
    assert kept([BOX, NEAR], [0.9, 0.6], [0, 1]) == [0, 1]


def test_who_was_suppressed_suppresses_nobody() -> None:
    chain = [[0, 0, 10, 10], [3, 0, 13, 10], [6, 0, 16, 10]]
    assert kept(chain, [0.9, 0.8, 0.7], [0, 0, 0]) == [0, 2]


def test_equal_scores_keep_the_lower_row() -> None:
    assert kept([NEAR, BOX], [0.5, 0.5], [0, 0]) == [0]


def test_nothing() -> None:
    assert kept(np.zeros((0, 4)), [], []) == []
