"""Looks are compared by brightness alone while the camera shows no colours."""

from __future__ import annotations

from functools import partial

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Detections
from recorders.vision import cv2
from replay.trackers.light import Light
from replay.trackers.parts.features import HSV, XYZ, differences
from replay.trackers.shells.colours import bins_of, distance, histogram, without_colours
from replay.trackers.shells.objects import Body
from replay.trackers.tracker import Frame
from tests.replay.trackers.parts.test_part_features import BOX, body, learnt, measured

Picture = NDArray[np.uint8]
GROUND: Picture = np.asarray(
    cv2.resize(
        np.random.default_rng(1).integers(60, 160, (12, 16, 3), np.uint8), (320, 240)
    ),
    np.uint8,
)
NOBODY = np.zeros((240, 320), np.uint8)


def without_colour(image: Picture) -> Picture:
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


def seen(
    light: Light, image: Picture, turns: list[bool], mask: Picture = NOBODY
) -> Picture:
    """A picture as trackers see it; what was called when colours went or came."""
    detections = Detections(0, 320, 240)
    frame = Frame(
        0, 0, detections, None, partial(np.asarray, image), partial(np.asarray, mask)
    )
    lit = light.lit(frame, lambda: turns.append(light.grey)).image
    assert lit is not None
    return lit


def test_colours_that_go_and_come_back_are_said_once_each() -> None:
    light, turns = Light(), []  # type: tuple[Light, list[bool]]
    for image in (GROUND, without_colour(GROUND), without_colour(GROUND), GROUND, GROUND):
        seen(light, image, turns)
    assert turns == [True, False]


def test_it_goes_on_from_its_state() -> None:
    light, again, turns = Light(), Light(), []  # type: tuple[Light, Light, list[bool]]
    seen(light, GROUND, [])
    seen(light, without_colour(GROUND), [])
    again.restore(light.state())
    seen(again, without_colour(GROUND), turns)
    assert again.grey
    seen(again, GROUND, turns)
    assert turns == [False]


def test_shells_compare_brightness_while_there_are_no_colours_and_know_them_again() -> None:
    own = np.ones((240, 320), bool)
    known, grey = (
        histogram(bins_of(image), own) for image in (GROUND, without_colour(GROUND))
    )
    somebody = Body(1, 0, 0, 0)
    somebody.learn_colours(known)
    assert distance(known, grey) > 0.8
    somebody.turn(grey=True)
    assert somebody.colours is not None
    assert distance(somebody.colours, grey) < 0.1
    assert distance(without_colours(known), grey) < 0.1
    somebody.learn_colours(grey)
    somebody.turn(grey=False)
    assert somebody.colours is not None
    assert np.array_equal(somebody.colours, known)


def test_parts_compare_brightness_while_there_are_no_colours_and_keep_what_they_knew() -> (
    None
):
    image, mask = body()
    steps = np.random.default_rng(1).integers(0, 60, image.shape[:2])[..., None]
    image = (image // 8 + 90 + steps).astype(np.uint8)
    model, row = learnt(measured(image, mask, BOX)), np.zeros(1, np.intp)
    coloured = model.colours.copy()
    in_colours = measured(image, mask, BOX)
    in_grey = measured(without_colour(image), mask, BOX, grey=True)
    plain = measured(without_colour(image), mask, BOX)
    unlike = differences(model, row, plain)[..., HSV : XYZ + 1].mean()
    assert differences(model, row, in_grey)[..., HSV : XYZ + 1].mean() < unlike / 2
    model.learn(row, in_grey, row, np.full((1, 5, 6), 500, np.int64))
    assert not differences(model, row, in_colours)[..., HSV].any()
    assert np.array_equal(model.colours[:, :, :3], coloured[:, :, :3])
    # Who was first seen in grey is known by his brightness in colours, too.
    other = learnt(in_grey)
    assert differences(other, row, in_colours)[..., HSV : XYZ + 1].mean() < unlike / 2
