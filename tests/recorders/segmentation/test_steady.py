"""A camera that rests before leaves: one view, however much of the picture moves."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.pictures import Image
from recorders.segmentation.change.landmarks import Landmarks
from recorders.segmentation.change.steady import steady_view
from recorders.segmentation.change.views import divide
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

WIDTH, HEIGHT, COUNT = 320, 240, 12


def texture(seed: int) -> Image:
    """(HEIGHT, WIDTH) uint8: tiles of 4 px, another picture for each seed."""
    small = np.random.default_rng(seed).integers(40, 216, (HEIGHT // 4, WIDTH // 4))
    return np.repeat(np.repeat(small, 4, axis=0), 4, axis=1).astype(np.uint8)


def pictures(still_from: int, still_to: int, order: list[int]) -> list[Image]:
    """Pictures in Y, Cr, Cb that all show the same in some rows, and elsewhere what each has."""
    shown = []
    for seed in order:
        luma = texture(seed + 1)
        luma[still_from:still_to] = texture(0)[still_from:still_to]
        neutral = np.full_like(luma, 128)
        shown.append(np.dstack([luma, neutral, neutral]))
    return shown


def test_leaves_over_most_of_the_picture_make_no_new_views() -> None:
    shown = pictures(HEIGHT * 3 // 4, HEIGHT, list(range(COUNT)))
    division = divide(shown)
    assert [seen.place for seen in division.seen] == [0] * COUNT
    assert [seen.shift for seen in division.seen] == [(0, 0)] * COUNT
    (place,) = division.places
    assert place.steady is not None
    assert (place.steady[:, 0] >= HEIGHT * 3 // 4 - 16).all()


def test_a_picture_of_elsewhere_among_them_stays_a_view_of_its_own() -> None:
    shown = pictures(HEIGHT * 3 // 4, HEIGHT, list(range(COUNT)))
    away = texture(99)
    shown[5] = np.dstack([away, np.full_like(away, 128), np.full_like(away, 128)])
    division = divide(shown)
    assert [seen.place for seen in division.seen] == [0] * 5 + [1] + [0] * 6
    assert [place.number for place in division.places] == [0, 1]


@pytest.mark.parametrize(
    ("still", "order"),
    [
        ((0, 16), list(range(COUNT))),
        ((0, 0), [0, 1, 2] * 4),
    ],
    ids=["a burnt-in clock", "three views in turn"],
)
def test_other_views_stay_other_views(still: tuple[int, int], order: list[int]) -> None:
    shown = pictures(*still, order)
    assert steady_view(shown) is None
    division = divide(shown)
    assert len(division.places) == len(set(order))


def test_an_even_picture_has_nothing_steady_to_be_known_by() -> None:
    view = steady_view([np.full((HEIGHT, WIDTH, 3), 128, np.uint8)] * 3)
    assert view is not None
    assert len(view[1]) == 0


def test_a_crowd_before_a_wall_makes_no_views() -> None:
    """What has texture is another in each picture; the camera rests."""
    shown = []
    for k in range(COUNT):
        picture = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
        picture[64:192, 8 * k : 8 * k + 128, 0] = texture(k)[64:192, :128]
        shown.append(picture)
    assert len(Landmarks.of(np.ascontiguousarray(shown[0][..., 0]))) >= 6
    division = divide(shown)
    assert [seen.place for seen in division.seen] == [0] * COUNT
    assert [seen.shift for seen in division.seen] == [(0, 0)] * COUNT


def test_landmarks_are_chosen_among_the_patches_that_are_asked() -> None:
    luma = texture(0)
    every = Landmarks.of(luma, all_of_them=True)
    assert len(every) == (WIDTH // 16) * (HEIGHT // 16)
    some = Landmarks.of(luma, among=every.corners[:20])
    assert 0 < len(some) <= 8
    assert (some.corners[:, 0] == 0).all()


def moved_apart(luma: Image, marks: Landmarks, seed: int) -> Image:
    """Each landmark displaced by itself, by up to a pixel."""
    ways = np.random.default_rng(seed).uniform(-1, 1, (len(marks), 2))
    shown = luma.copy()
    for (row, column), (right, down) in zip(marks.corners, ways, strict=True):
        way = np.array([[1, 0, right], [0, 1, down]], np.float32)
        there = cv2.warpAffine(luma, way, (WIDTH, HEIGHT))
        shown[row : row + 16, column : column + 16] = there[
            row : row + 16, column : column + 16
        ]
    return shown


def smooth(seed: int) -> Image:
    return as_image(cv2.GaussianBlur(texture(seed), (0, 0), 1.5))


def test_steady_landmarks_that_a_codec_moves_one_by_one_show_the_view() -> None:
    luma = smooth(0)
    marks = Landmarks.of(luma)
    steady = Landmarks.of(luma, among=marks.corners)
    shown = moved_apart(luma, steady, 1)
    assert not marks.sight(shown, (0, 0)).even
    assert steady.sight(shown, (0, 0)).even


def test_steady_landmarks_of_a_picture_that_is_turned_do_not() -> None:
    luma = smooth(0)
    steady = Landmarks.of(luma, among=Landmarks.of(luma).corners)
    turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), 0.7, 1.0)
    turned = as_image(cv2.warpAffine(luma, turn, (WIDTH, HEIGHT)))
    assert not steady.sight(turned, (0, 0)).even
    nearer = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), 0, 1.012)
    zoomed = as_image(cv2.warpAffine(luma, nearer, (WIDTH, HEIGHT)))
    assert not steady.sight(zoomed, (0, 0)).even


def test_noise_is_no_texture_to_know_a_view_by() -> None:
    plain = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    plain[: HEIGHT // 2, :, 0] = 90
    noise = np.random.default_rng(0)
    shown = []
    for _ in range(COUNT):
        noisy = plain[..., 0] + noise.normal(0, 9, (HEIGHT, WIDTH))
        picture = plain.copy()
        picture[..., 0] = np.clip(np.rint(noisy), 0, 255)
        shown.append(picture)
    assert len(Landmarks.of(np.ascontiguousarray(shown[0][..., 0]))) > 40
    division = divide(shown)
    assert [seen.place for seen in division.seen] == [0] * COUNT
