"""The layered association's rules: threshold, ratio and the head's image, who gives way."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from replay.trackers.parts.candidates import Candidates
from replay.trackers.parts.features import Measured, Pixels, measure
from replay.trackers.parts.layers import Association, Match, Refine, Scored
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import parts_of
from replay.trackers.parts.scoring import FULL, PartFeatures, Scorer

Floats = NDArray[np.float64]
LEFT, RIGHT = (100.0, 100.0, 20.0, 60.0), (112.0, 100.0, 20.0, 60.0)
FAR = (200.0, 100.0, 20.0, 60.0)
Pair = tuple[int, int, tuple[float, float, float, float], float]
"""Target, anchor, place, score."""


def associate(
    pairs: list[Pair], refine: Refine | None = None, **changes: Any
) -> list[Match]:
    n = len(pairs)
    boxes = np.array([box for _, _, box, _ in pairs])
    half = np.full(n, 0.5)
    rectangles = parts_of(boxes, half, half)
    mask = np.full((240, 320), 255, np.uint8)
    measured: Measured = measure(
        Pixels(np.zeros((240, 320, 3), np.uint8), mask, (320, 240)),
        rectangles,
        rectangles,
        rectangles,
        np.full(n, 30.0),
    )
    no = np.zeros(n, bool)
    candidates = Candidates(
        np.array([t for t, *_ in pairs]), boxes, np.array([a for _, a, *_ in pairs]), np.ones(n, np.int64), no,
        np.full(n, -1), no, no, np.zeros(n, np.intp), 1 + max(a for _, a, *_ in pairs),
    )  # fmt: skip
    scores = np.repeat(np.array([[round(s * FULL)] for *_, s in pairs]), 5, axis=1)
    filled = rectangles[..., 2] * rectangles[..., 3]
    scored = Scored(
        candidates, measured, np.repeat(scores[..., None], 6, axis=2), scores, rectangles,
        filled, np.zeros((n, 5), bool), np.ones(n, bool),
    )  # fmt: skip
    targets = sorted({t for t, *_ in pairs})
    last = np.array(
        [next(box for t, _, box, _ in pairs if t == target) for target in targets]
    )
    rules = Association(scored, Scorer(PartFeatures()), PartsParameters(**changes), refine)
    return rules.solve(np.array(targets, np.intp), last, np.zeros((0, 4)))


def head_at(place: tuple[float, float, float, float]) -> Refine:
    return lambda target, box, reach: np.array(place)


def test_the_best_candidate_over_the_threshold_wins() -> None:
    (match,) = associate([(0, 0, LEFT, 0.7), (0, 1, FAR, 0.8)])
    assert tuple(match.box) == FAR
    assert associate([(0, 0, LEFT, 0.5)]) == []


def test_of_near_equal_candidates_the_head_decides() -> None:
    pairs: list[Pair] = [(0, 0, LEFT, 0.70), (0, 1, RIGHT, 0.71)]
    assert tuple(associate(pairs)[0].box) == RIGHT
    (match,) = associate(pairs, head_at(LEFT))
    assert tuple(match.box) == LEFT
    assert match.score == round(0.70 * FULL), "the score is the measured one"


def test_the_head_is_not_asked_where_the_ratio_tells_or_the_runner_up_is_elsewhere() -> (
    None
):
    (match,) = associate([(0, 0, LEFT, 0.6), (0, 1, RIGHT, 0.8)], head_at(LEFT))
    assert tuple(match.box) == RIGHT
    (match,) = associate([(0, 0, LEFT, 0.79), (0, 1, FAR, 0.8)], head_at(LEFT))
    assert tuple(match.box) == FAR
    (match,) = associate([(0, 0, LEFT, 0.6), (0, 1, RIGHT, 0.8)], head_at(LEFT), ratio=1.5)
    assert tuple(match.box) == LEFT


def test_candidates_that_are_all_weak_are_told_apart_by_the_head() -> None:
    weak: list[Pair] = [(0, 0, LEFT, 0.50), (0, 1, RIGHT, 0.51)]
    assert associate(weak) == []
    (match,) = associate(weak, head_at(LEFT))
    assert tuple(match.box) == LEFT
    assert match.score == round(0.50 * FULL)
    assert associate(weak, lambda *_: None) == []
    assert associate([(0, 0, LEFT, 0.30), (0, 1, RIGHT, 0.31)], head_at(LEFT)) == []


def test_two_that_want_one_place_are_assigned_jointly_and_the_loser_is_named() -> None:
    pairs: list[Pair] = [(0, 0, LEFT, 0.9), (1, 0, LEFT, 0.8), (1, 1, FAR, 0.6)]
    first, second = associate(pairs)
    assert (first.row, tuple(first.box), first.rival) == (0, LEFT, 1)
    assert (second.row, tuple(second.box), second.rival) == (1, FAR, -1)


def test_the_sum_of_the_scores_decides_not_who_comes_first() -> None:
    pairs: list[Pair] = [(0, 0, LEFT, 0.9), (0, 1, FAR, 0.85), (1, 0, LEFT, 0.8)]
    assert [(m.row, tuple(m.box)) for m in associate(pairs)] == [(0, FAR), (1, LEFT)]


@pytest.mark.parametrize(("scores", "winner"), [((0.9, 0.7), 0), ((0.7, 0.9), 1)])
def test_of_two_boxes_that_all_but_coincide_the_lower_score_gives_way(
    scores: tuple[float, float], winner: int
) -> None:
    beside = (101.0, 100.0, 20.0, 60.0)
    (match,) = associate([(0, 0, LEFT, scores[0]), (1, 1, beside, scores[1])])
    assert match.row == winner
