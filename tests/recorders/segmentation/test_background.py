"""The background: sampling in bounded memory, the sorting network, the most common value, the
light.
"""

from __future__ import annotations

import numpy as np
import pytest

from recorders.segmentation.background import Background, Samples, most_common, sort_stack
from recorders.segmentation.change.light import light_of


def picture(value: int, shape: tuple[int, int, int] = (4, 5, 3)) -> np.ndarray:
    return np.full(shape, value % 256, np.uint8)


@pytest.mark.parametrize("length", [1, 7, 60, 61, 500, 3001])
def test_samples_are_few_and_spread_evenly(length: int) -> None:
    samples = Samples(most=60)
    kept_at = []
    for k in range(length):
        wanted = samples.wants_next()
        if samples.add(np.array([k], np.int64)):
            assert wanted
            kept_at.append(k)
    kept = [int(s[0]) for s in samples.kept]
    assert len(kept) <= 60
    assert kept[0] == 0
    assert len(set(np.diff(kept))) <= 1
    assert len(kept) >= min(length, 30)
    assert kept[-1] >= length - 2 * (kept[1] - kept[0] if len(kept) > 1 else 1)


def test_skipping_unwanted_pictures_is_the_same_as_adding_them() -> None:
    a, b = Samples(most=8), Samples(most=8)
    for k in range(200):
        a.add(picture(k))
        if b.wants_next():
            b.add(picture(k))
        else:
            b.skip()
    assert [s[0, 0, 0] for s in a.kept] == [s[0, 0, 0] for s in b.kept]


def test_large_pictures_are_sampled_less_but_enough_for_a_background() -> None:
    samples = Samples(most=60, most_bytes=10 * 60)
    for k in range(1000):
        samples.add(picture(k))
    assert 5 <= len(samples.kept) <= 10


def test_a_window_slides_when_the_stride_has_reached_its_bound() -> None:
    samples = Samples(most=10, max_stride=4)
    for k in range(1001):
        samples.add(np.array([k]))
    kept = [int(s[0]) for s in samples.kept]
    assert kept == list(range(kept[0], 1001, 4))
    assert len(kept) == 10


@pytest.mark.parametrize("n", [1, 2, 3, 6, 17, 32, 60])
def test_the_network_sorts(n: int) -> None:
    stack = np.random.default_rng(n).integers(0, 256, (n, 3, 4, 3), dtype=np.uint8)
    assert np.array_equal(np.array(sort_stack(list(stack))), np.sort(stack, axis=0))


def test_the_most_common_value_withstands_what_passes() -> None:
    rng = np.random.default_rng(0)
    stack = [
        np.clip(rng.normal(90, 2, (20, 20, 3)), 0, 255).astype(np.uint8) for _ in range(41)
    ]
    for k in range(0, 41, 5):
        stack[k][:] = 250
    for k in range(12):
        stack[k][:5] = 10 * k
    centre, spread = most_common(stack)
    assert np.abs(centre.astype(int) - 90).max() <= 3
    assert spread.max() <= 8


def test_one_picture_is_its_own_background() -> None:
    only = picture(77)
    centre, spread = most_common([only])
    assert np.array_equal(centre, only)
    assert not spread.any()


def test_the_level_is_higher_where_the_background_changes() -> None:
    stack = [picture(100 + (40 if k % 2 else 0)) for k in range(20)]
    for s in stack:
        s[:2] = 100
    background = Background.learn(stack, 30.0, 2.0)
    assert background.level[0, 0] < background.level[3, 0]


def test_the_background_follows_a_change_of_light_of_the_whole_picture() -> None:
    background = Background.learn([picture(100, (60, 80, 3))] * 5, 30.0, 2.0)
    brighter = picture(100, (60, 80, 3))
    brighter[..., 0] = 118
    brighter[:20, :20, 0] = 250
    assert (
        light_of(brighter, background.colour).over(background.colour)[..., 0] == 118
    ).all()
    assert (background.colour[..., 0] == 100).all()


def test_something_large_is_not_taken_for_light() -> None:
    background = Background.learn([picture(100, (60, 80, 3))] * 5, 30.0, 2.0)
    rng = np.random.default_rng(1)
    covered = rng.integers(0, 256, (60, 80, 3), dtype=np.uint8)
    assert light_of(covered, background.colour).over(background.colour) is background.colour


def test_the_background_moves_by_one_level_where_it_may() -> None:
    background = Background.learn([picture(100)] * 5, 30.0, 2.0)
    still = np.zeros((4, 5), np.uint8)
    still[:2] = 255
    background.follow(picture(104), still)
    assert (background.colour[:2] == 101).all()
    assert (background.colour[2:] == 100).all()


@pytest.mark.parametrize(("sigma", "noisy"), [(1.0, False), (9.0, True)])
def test_noise_is_told_by_its_share_of_the_levels(sigma: float, noisy: bool) -> None:
    rng = np.random.default_rng(2)
    stack = [
        np.clip(rng.normal(128, sigma, (20, 30, 3)), 0, 255).astype(np.uint8)
        for _ in range(20)
    ]
    assert Background.learn(stack, 30.0, 2.0).noisy is noisy


def test_a_monochrome_camera_is_told_by_its_chroma() -> None:
    grey = np.full((20, 30, 3), 128, np.uint8)
    grey[..., 0] = np.arange(30)
    coloured = grey.copy()
    coloured[:4, :, 1] = 140
    assert not Background.learn([grey] * 6, 30.0, 2.0).coloured
    assert Background.learn([coloured] * 6, 30.0, 2.0).coloured


def test_less_is_asked_only_where_the_background_keeps_still() -> None:
    """Where it changes by itself, what follows from that stays."""
    stack = [picture(100, (60, 80, 3)) for _ in range(6)]
    for k, one in enumerate(stack):
        one[:30, :, 0] += 12 * (k % 3)
    background = Background.learn(stack, 30.0, 2.0)
    before = background.level.copy()
    background.asks_less()
    assert (background.level[30:] == before[30:] // 2).all()
    assert background.restless is not None
    assert (background.level[:30] == background.restless[:30]).all()
    assert (background.level[:30] > before[:30] // 2).all()
