"""Foreground explained by boxes: alone, side by side, one behind the other, cut by the border,
proposed.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from recorders.segmentation.explain import (
    MIN_SCORE,
    MOST_BOXES,
    Explainer,
    box_scores,
    integral_of,
)
from recorders.segmentation.sizes import SizeModel

MODEL = SizeModel(0.2, 20.0, 0.4, 40.0, 90.0)
WIDTH, HEIGHT = 400, 300


def draw(*feet: tuple[float, float]) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for x, y in feet:
        (bx, by, w, h) = MODEL.boxes(np.array([float(x)]), np.array([float(y)]))[0]
        yy, xx = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
        mask[
            ((xx - bx - w / 2) / (w / 2)) ** 2 + ((yy - by - h / 2) / (h / 2)) ** 2 <= 1
        ] = 255
    return mask


def feet(boxes: np.ndarray) -> list[tuple[float, float]]:
    return sorted((x + w / 2, y + h) for x, y, w, h in boxes.tolist())


@pytest.fixture(scope="module")
def explainer() -> Explainer:
    return Explainer(MODEL, WIDTH, HEIGHT)


@pytest.mark.parametrize(
    "bodies",
    [
        [(100, 200)],
        [(100, 200), (300, 120)],
        [(100, 200), (122, 200)],
        [(100, 200), (124, 203), (147, 199)],
        [(100, 200), (106, 238)],
        [(60, 150), (70, 190), (250, 260), (275, 262)],
    ],
    ids=["one", "two", "side by side", "three abreast", "one behind", "two pairs"],
)
def test_each_body_gets_its_box(
    explainer: Explainer, bodies: list[tuple[int, int]]
) -> None:
    found = explainer.explain(draw(*bodies))
    assert len(found.boxes) == len(bodies)
    for got, wanted in zip(feet(found.boxes), sorted(bodies), strict=True):
        assert got == pytest.approx(wanted, abs=8)
    assert ((found.scores > 0.3) & (found.scores <= 1)).all()


def test_a_body_alone_is_more_certain_than_one_half_hidden(explainer: Explainer) -> None:
    alone = explainer.explain(draw((100, 200))).scores[0]
    pair = explainer.explain(draw((100, 200), (108, 215))).scores
    assert alone > 0.9
    assert pair.min() < alone


def test_a_body_cut_by_the_border_is_found(explainer: Explainer) -> None:
    found = explainer.explain(draw((3, 200)))
    assert len(found.boxes) == 1
    assert found.boxes[0, 0] < 0
    assert found.boxes[0, 1] + found.boxes[0, 3] == pytest.approx(200, abs=8)


def test_nothing_needs_no_explanation(explainer: Explainer) -> None:
    found = explainer.explain(np.zeros((HEIGHT, WIDTH), np.uint8))
    assert found.boxes.shape == (0, 4)
    assert found.scores.shape == found.sources.shape == (0,)


def test_noise_is_not_explained_and_stays(explainer: Explainer) -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[100:104, 100:104] = 255
    found = explainer.explain(mask)
    assert len(found.boxes) == 0
    assert np.array_equal(found.rest, mask)


def test_the_rest_is_what_no_box_covers(explainer: Explainer) -> None:
    mask = draw((100, 200))
    mask[20:24, 300:310] = 255
    found = explainer.explain(mask)
    x, y, w, h = np.rint(found.boxes[0]).astype(int)
    assert not found.rest[y : y + h, x : x + w].any()
    assert found.rest[21, 305] == 255


def test_the_mask_is_left_as_it_was(explainer: Explainer) -> None:
    mask = draw((100, 200), (110, 210))
    before = mask.copy()
    explainer.explain(mask)
    assert np.array_equal(mask, before)


def test_a_proposal_of_another_size_is_taken_with_its_row(explainer: Explainer) -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[150:175, 40:50] = 255
    small = np.array([[300.0, 100.0, 20.0, 50.0], [40.0, 151.0, 10.0, 24.0]])
    found = explainer.explain(mask, small)
    assert found.sources.tolist() == [1]
    assert found.boxes[0] == pytest.approx([40, 150, 10, 25], abs=2.5)


def test_each_proposal_is_used_once(explainer: Explainer) -> None:
    mask = draw((100, 200), (122, 200))
    proposals = MODEL.boxes(np.array([101.0, 121.0]), np.array([200.0, 200.0]))
    found = explainer.explain(mask, proposals)
    assert sorted(found.sources.tolist()) == [0, 1]


def test_scores_are_those_of_the_formula_for_a_lone_full_box() -> None:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[100:150, 100:120] = 255
    scores = box_scores(
        integral_of(mask),
        np.array([[100.0, 100, 20, 50], [100, 100, 20, 25], [300, 100, 20, 50]]),
    )
    assert scores[0] == 1.0
    assert scores[1] < scores[0]
    assert scores[2] == -1.0 < MIN_SCORE


@pytest.mark.parametrize(
    "model",
    [SizeModel(0.0, 1.0, 1e-9, 1e-9, 1e-9), SizeModel(0.0, 3.0, 0.5, 3.0, 3.0)],
    ids=["no size at all", "three pixels"],
)
def test_tiny_bodies_in_a_large_picture_make_no_more_boxes_than_allowed(model: Any) -> None:
    explainer = Explainer(model, 4000, 3000)
    assert len(explainer._grid.boxes) <= MOST_BOXES
