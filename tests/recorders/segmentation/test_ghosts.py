"""Who stood in the background when it was learnt, and left, is no ground."""

from __future__ import annotations

import numpy as np
import pytest

from fixtures.disturbed import HEIGHT, WIDTH, place
from recorders.pictures import Image
from recorders.segmentation.background import Background
from recorders.segmentation.ghosts import without_who_left
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

PICTURES = 40
BODY = (slice(90, 140), slice(100, 120))


def scene(standing: range) -> tuple[list[Image], Image]:
    """Pictures in which somebody stands at one place in some, and the ground behind him."""
    ground = as_image(cv2.cvtColor(place()[:HEIGHT, :WIDTH], cv2.COLOR_BGR2YCrCb))
    rng = np.random.default_rng(2)
    pictures = []
    for k in range(PICTURES):
        picture = ground.astype(np.int16) + rng.integers(-2, 3, ground.shape)
        if k in standing:
            picture[BODY] = (60, 110, 150)
        pictures.append(np.clip(picture, 0, 255).astype(np.uint8))
    return pictures, ground


def learnt(pictures: list[Image]) -> Image:
    return Background.learn(pictures, 18.0, 2.0).colour


def apart(a: Image, b: Image) -> float:
    return float(np.abs(a[BODY].astype(np.int16) - b[BODY]).mean())


@pytest.mark.parametrize(
    "standing",
    [range(24), range(16, PICTURES), range(8, 34), range(12), range(28, PICTURES)],
    ids=["leaves", "comes", "comes and leaves", "leaves early", "comes late"],
)
def test_the_ground_is_known_however_long_somebody_stood_there(standing: range) -> None:
    pictures, ground = scene(standing)
    assert apart(learnt(pictures), ground) < 6


def test_who_stands_from_the_first_picture_to_the_last_is_ground() -> None:
    pictures, ground = scene(range(PICTURES))
    assert apart(learnt(pictures), ground) > 30


def test_what_comes_and_goes_all_the_time_is_left_as_it_is() -> None:
    pictures, _ = scene(range(0))
    for k in range(0, PICTURES, 3):
        pictures[k][BODY] = (60, 110, 150)
    colour = pictures[1]
    levels = np.full(colour.shape[:2], 18, np.uint8)
    made, changed = without_who_left(pictures, colour, levels)
    assert made is colour
    assert not changed.any()


def test_two_who_stand_apart_are_each_asked() -> None:
    pictures, ground = scene(range(26))
    other = (slice(90, 140), slice(30, 50))
    for picture in pictures[:10]:
        picture[other] = (200, 140, 110)
    made = learnt(pictures)
    assert apart(made, ground) < 6
    assert np.abs(made[other].astype(np.int16) - ground[other]).mean() < 6
