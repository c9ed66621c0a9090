"""Where there are no colours: how dark bodies are tells what a shadow or a reflection is."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.pictures import Image
from recorders.segmentation import SEGMENTERS, SegmentationParameters
from recorders.segmentation.blobs import components
from recorders.segmentation.darkness import FEWEST, Darkness
from recorders.vision import cv2

HEIGHT, WIDTH, FRAMES = 120, 160, 60


def kept(shares: list[float]) -> float:
    """What a shadow keeps where each body leaves one of these shares of the light."""
    seen = Darkness()
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    mask[20:40, 30:70] = 255
    _, labels, blobs = components(mask, 1)
    for share in shares:
        seen.observe(
            np.full((HEIGHT, WIDTH), round(200 * share), np.uint8),
            np.full((HEIGHT, WIDTH), 200, np.uint8),
            labels,
            blobs,
        )
    return seen.shadow_keeps()


def test_a_shadow_takes_less_than_half_of_what_bodies_take() -> None:
    assert kept([0.25] * FEWEST) == pytest.approx(0.5)
    assert kept([0.81] * FEWEST) == pytest.approx(0.9)


def test_bodies_in_lighter_clothes_are_no_shadows() -> None:
    assert kept([0.25] * 30 + [0.64] * 10) == pytest.approx(0.8)
    assert kept([0.25] * 38 + [0.64] * 2) == pytest.approx(0.5)


def test_few_bodies_or_brighter_ones_say_nothing() -> None:
    assert kept([0.25] * (FEWEST - 1)) == 1.0
    assert kept([1.2] * FEWEST) == 1.0


def grey_film(body: int) -> list[Image]:
    """A grey body before a light ground that passes a wall, in which it is seen: .62 of the light is
    left there.
    """
    rng = np.random.default_rng(3)
    ground = cv2.GaussianBlur(rng.integers(190, 230, (HEIGHT, WIDTH), np.uint8), (5, 5), 0)
    images = []
    for k in range(FRAMES):
        image = np.asarray(ground).copy()
        x = 5 + 2 * k
        image[50:70, x : x + 30] = body
        if 26 <= k < 34:
            image[8:20, x : x + 30] = np.rint(image[8:20, x : x + 30] * 0.62)
        images.append(np.asarray(np.repeat(image[..., None], 3, axis=2), np.uint8))
    return images


@pytest.mark.parametrize(("body", "reflected"), [(50, False), (120, True)])
def test_a_reflection_of_dark_bodies_is_none(body: int, reflected: bool) -> None:
    images = grey_film(body)
    segmenter = SEGMENTERS["motion"](SegmentationParameters(), WIDTH, HEIGHT, 10.0)
    segmenter.prepare(iter(images))
    mask = segmenter.segment(30, images[30]).mask
    assert mask[52:68, 68:92].all()
    assert bool(mask[10:18, 68:92].any()) == reflected


def test_where_shadows_are_wanted_they_stay() -> None:
    images = grey_film(50)
    wanted = SegmentationParameters(shadow_darkest_grey=1.0)
    segmenter = SEGMENTERS["motion"](wanted, WIDTH, HEIGHT, 10.0)
    segmenter.prepare(iter(images))
    assert segmenter.segment(30, images[30]).mask[10:18, 68:92].all()
