"""The size of bodies, learnt from blobs with merged, broken and resting ones among them."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.segmentation.sizes import SizeModel, learn


def people(n=200, slope=0.25, intercept=10.0, aspect=0.4, seed=0):
    rng = np.random.default_rng(seed)
    foot = rng.uniform(80, 340, n)
    h = (slope * foot + intercept) * rng.normal(1, 0.05, n)
    w = aspect * h * rng.normal(1, 0.15, n)
    return np.stack([rng.uniform(20, 400, n), foot - h, w, h], axis=1)


def test_the_line_is_found_among_merged_and_broken_blobs():
    boxes = people()
    boxes[:40, 3] *= 1.7
    boxes[:40, 1] -= 0.7 / 1.7 * boxes[:40, 3]
    boxes[40:70, 3] *= 0.4
    model = learn(boxes, 480, 360)
    assert model is not None
    for foot in (100.0, 200.0, 320.0):
        assert model.heights(np.array([foot]))[0] == pytest.approx(0.25 * foot + 10, rel=0.05)
    assert model.aspect == pytest.approx(0.88 * 0.4, rel=0.1)


def test_boxes_stand_on_their_feet():
    model = SizeModel(0.25, 10.0, 0.4, 30.0, 95.0)
    (box,) = model.boxes(np.array([100.0]), np.array([200.0]))
    assert box.tolist() == pytest.approx([100 - 12, 140, 24, 60])


def test_few_blobs_teach_nothing():
    assert learn(people(8), 480, 360) is None
    assert learn(np.zeros((0, 4)), 480, 360) is None


def test_one_resting_body_is_one_blob_however_often_it_is_seen():
    assert learn(np.repeat(people(3), 100, axis=0), 480, 360) is None


def test_bodies_that_turn_every_way_have_no_model():
    boxes = people()
    boxes[::2, 2], boxes[::2, 3] = boxes[::2, 3], boxes[::2, 2].copy()
    assert learn(boxes, 480, 360) is None


def test_blobs_of_any_size_have_no_model():
    rng = np.random.default_rng(3)
    boxes = people(400)
    boxes[:, 3] = np.exp(rng.uniform(np.log(6), np.log(300), 400))
    boxes[:, 1] = rng.uniform(310, 355, 400) - boxes[:, 3]
    boxes[:, 2] = 0.4 * boxes[:, 3]
    assert learn(boxes, 480, 360) is None


def test_the_model_survives_being_written_down():
    model = SizeModel(0.25, 10.0, 0.4, 30.0, 95.0)
    assert SizeModel.from_list(model.as_list()) == model
    assert SizeModel.from_list([]) is None


def test_heights_stay_within_what_was_seen():
    model = SizeModel(0.5, -20.0, 0.4, 30.0, 90.0)
    assert model.heights(np.array([0.0, 5000.0])).tolist() == [15.0, 135.0]
    assert model.first_foot() == pytest.approx(70.0)
