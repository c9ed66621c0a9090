"""The size of bodies, learnt from blobs with merged, broken and resting ones among them."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.segmentation.sizes import SizeModel, learn, regrouped


def people(
    n: int = 200,
    slope: float = 0.25,
    intercept: float = 10.0,
    aspect: float = 0.4,
    seed: int = 0,
) -> np.ndarray:
    rng = np.random.default_rng(seed)
    foot = rng.uniform(80, 340, n)
    h = (slope * foot + intercept) * rng.normal(1, 0.05, n)
    w = aspect * h * rng.normal(1, 0.15, n)
    return np.stack([rng.uniform(20, 400, n), foot - h, w, h], axis=1)


def test_the_line_is_found_among_merged_and_broken_blobs() -> None:
    boxes = people()
    boxes[:40, 3] *= 1.7
    boxes[:40, 1] -= 0.7 / 1.7 * boxes[:40, 3]
    boxes[40:70, 3] *= 0.4
    model = learn(boxes, 480, 360)
    assert model is not None
    for foot in (100.0, 200.0, 320.0):
        assert model.heights(np.array([foot]))[0] == pytest.approx(
            0.25 * foot + 10, rel=0.05
        )
    assert model.aspect == pytest.approx(0.88 * 0.4, rel=0.1)


def test_boxes_stand_on_their_feet() -> None:
    model = SizeModel(0.25, 10.0, 0.4, 30.0, 95.0)
    (box,) = model.boxes(np.array([100.0]), np.array([200.0]))
    assert box.tolist() == pytest.approx([100 - 12, 140, 24, 60])


def test_few_blobs_teach_nothing() -> None:
    assert learn(people(8), 480, 360) is None
    assert learn(np.zeros((0, 4)), 480, 360) is None


def test_one_resting_body_is_one_blob_however_often_it_is_seen() -> None:
    assert learn(np.repeat(people(3), 100, axis=0), 480, 360) is None


def test_bodies_that_turn_every_way_have_no_model() -> None:
    boxes = people()
    boxes[::2, 2], boxes[::2, 3] = boxes[::2, 3], boxes[::2, 2].copy()
    assert learn(boxes, 480, 360) is None


def test_blobs_of_any_size_have_no_model() -> None:
    rng = np.random.default_rng(3)
    boxes = people(400)
    boxes[:, 3] = np.exp(rng.uniform(np.log(6), np.log(300), 400))
    boxes[:, 1] = rng.uniform(310, 355, 400) - boxes[:, 3]
    boxes[:, 2] = 0.4 * boxes[:, 3]
    assert learn(boxes, 480, 360) is None


def test_the_model_survives_being_written_down() -> None:
    model = SizeModel(0.25, 10.0, 0.4, 30.0, 95.0)
    assert SizeModel.from_list(model.as_list()) == model
    assert SizeModel.from_list([]) is None


def test_heights_stay_within_what_was_seen() -> None:
    model = SizeModel(0.5, -20.0, 0.4, 30.0, 90.0)
    assert model.heights(np.array([0.0, 5000.0])).tolist() == [15.0, 135.0]
    assert model.first_foot() == pytest.approx(70.0)


def test_halves_of_a_body_are_taken_together_and_neighbours_are_not() -> None:
    upper, lower, beside = (
        (100.0, 50.0, 30.0, 40.0),
        (98.0, 94.0, 34.0, 50.0),
        (140.0, 60.0, 30.0, 90.0),
    )
    above = (100.0, 2.0, 30.0, 20.0)
    found = regrouped(np.array([lower, beside, above, upper]))
    assert sorted(map(tuple, found.tolist())) == [(98.0, 50.0, 34.0, 94.0), above, beside]
    assert regrouped(np.zeros((0, 4))).shape == (0, 4)


def test_a_body_in_three_parts_is_one_whatever_their_order() -> None:
    parts = np.array(
        [(10.0, 10.0, 20.0, 20.0), (12.0, 32.0, 18.0, 20.0), (9.0, 54.0, 22.0, 40.0)]
    )
    for order in ((0, 1, 2), (2, 0, 1), (1, 2, 0)):
        assert regrouped(parts[list(order)]).tolist() == [[9.0, 10.0, 22.0, 84.0]]


def test_bodies_broken_at_the_waist_teach_their_size_all_the_same() -> None:
    whole = people()
    upper, lower = whole.copy(), whole.copy()
    upper[:, 3] *= 0.45
    lower[:, 1] += 0.5 * whole[:, 3]
    lower[:, 3] *= 0.5
    halves = [regrouped(np.stack([u, low])) for u, low in zip(upper, lower, strict=True)]
    model = learn(np.concatenate(halves), 480, 360)
    assert model is not None
    assert model.heights(np.array([200.0]))[0] == pytest.approx(60, rel=0.05)
