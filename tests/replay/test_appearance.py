"""Colour models: what they tell apart, and that mean shift finds what back projection shows."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from recorders.vision import cv2
from replay.trackers import appearance
from replay.trackers.appearance import BINS, FEATURES, HALVES, Colours

RED, BLUE, GREY = (30, 30, 200), (200, 30, 30), (120, 120, 120)


def _patch(
    upper: tuple[int, int, int], lower: tuple[int, int, int], seed: int = 0
) -> np.ndarray:
    image = np.empty((40, 20, 3), np.int16)
    image[:20], image[20:] = upper, lower
    noise = np.random.Generator(np.random.PCG64(seed)).integers(-6, 7, image.shape)
    return np.clip(image + noise, 0, 255).astype(np.uint8)


def _seen(image: np.ndarray) -> np.ndarray:
    return appearance.histograms(
        appearance.bins_of(image), appearance.kernel(*image.shape[:2])
    )


def _model(image: np.ndarray) -> Colours:
    colours = Colours()
    colours.learn(_seen(image))
    return colours


def test_kernel_is_one_at_the_centre_and_nothing_outside_the_ellipse() -> None:
    k = appearance.kernel(41, 21)
    assert k[20, 10] == pytest.approx(1.0, abs=1e-3)
    assert k[0, 0] == k[40, 20] == 0.0
    assert (k >= 0).all()


def test_histograms_hold_the_kernels_whole_weight_in_every_feature() -> None:
    image = _patch(RED, BLUE)
    seen = _seen(image)
    assert seen.shape == (len(FEATURES), HALVES, BINS)
    assert seen.sum(axis=(1, 2)) == pytest.approx(
        np.full(len(FEATURES), appearance.kernel(40, 20).sum())
    )


def test_the_same_colours_are_near_and_others_far_and_halves_count() -> None:
    one, again = _model(_patch(RED, BLUE)), _model(_patch(RED, BLUE, seed=5))
    other, turned = _model(_patch(GREY, BLUE)), _model(_patch(BLUE, RED))
    near = appearance.distance(one.table, again.table)
    assert near < 0.15
    assert appearance.distance(one.table, one.table) == pytest.approx(0.0, abs=1e-6)
    assert appearance.distance(one.table, other.table) > near + 0.2
    assert appearance.distance(one.table, turned.table) > near + 0.2


def test_features_that_do_not_tell_are_not_chosen() -> None:
    mine, others = np.zeros((len(FEATURES), BINS)), np.zeros((len(FEATURES), BINS))
    mine[:, 3] = others[:, 3] = 1.0
    others[4, 3], others[4, 20] = 0.0, 1.0
    assert appearance.choose(mine, others)[0] == 4


def test_back_projection_and_mean_shift_find_the_target() -> None:
    scene = np.full((120, 160, 3), GREY, np.uint8)
    scene[50:90, 100:120] = _patch(RED, RED)
    mine, background = (
        _model(_patch(RED, RED, seed=2)).body,
        _model(_patch(GREY, GREY)).body,
    )
    bins = appearance.bins_of(scene)
    likeness = appearance.back_project(
        bins, mine, background, appearance.choose(mine, background)
    )
    assert likeness[70, 110] > 0.5 > -0.5 > likeness[10, 10]
    (x, y, w, h), score = appearance.mean_shift(
        likeness[30:110, 80:140], (10.0, 12.0, 20.0, 40.0), steps=30
    )
    assert (x + 80, y + 30) == pytest.approx((100.0, 50.0), abs=1.5)
    assert (w, h) == (20.0, 40.0)
    assert score > 0.5


def test_mean_shift_outside_of_the_picture_stays_and_likes_nothing() -> None:
    box, score = appearance.mean_shift(
        np.zeros((20, 20), np.float32), (50.0, 50.0, 5.0, 5.0)
    )
    assert box == (50.0, 50.0, 5.0, 5.0)
    assert score == -1.0


def test_colours_go_through_plain_data_exactly() -> None:
    colours = _model(_patch(RED, BLUE))
    colours.learn(_seen(_patch(RED, GREY)))
    plain = {
        k: v.tolist() if isinstance(v, np.ndarray) else v
        for k, v in colours.state().items()
    }
    again = Colours.from_state(msgspec.json.decode(msgspec.json.encode(plain)))
    assert np.array_equal(again.table, colours.table)
    assert again.updates == 2
    assert again.signature() == colours.signature()
    assert sum(colours.signature()) == pytest.approx(3000, abs=60)


def test_nothing_seen_teaches_nothing() -> None:
    colours = Colours()
    colours.learn(np.zeros((len(FEATURES), HALVES, BINS)))
    assert colours.updates == 0


def _infrared(image: np.ndarray) -> np.ndarray:
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)


def test_who_is_seen_without_colours_is_known_by_his_brightness() -> None:
    one, other = _patch((200, 60, 30), (90, 160, 90)), _patch((30, 200, 220), BLUE)
    grey = _model(_infrared(_patch((200, 60, 30), (90, 160, 90), seed=5)))
    own = appearance.distance(_model(one).table, grey.table)
    assert own < 0.3
    assert appearance.distance(_model(other).table, grey.table) > own + 0.3


def test_colours_are_learnt_anew_once_the_camera_shows_none() -> None:
    colours = _model(_patch(RED, BLUE))
    grey = _seen(_infrared(_patch(RED, BLUE)))
    colours.learn(grey)
    assert colours.updates == 1
    assert colours.table == pytest.approx(grey / grey[0].sum())
    assert not any(colours.signature()[appearance.BRIGHTNESS :])


def test_grey_clothes_before_a_camera_with_colours_have_colours() -> None:
    assert not appearance.colourless(_seen(_patch(GREY, GREY)))
