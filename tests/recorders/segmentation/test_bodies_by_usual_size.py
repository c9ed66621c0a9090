"""Bodies by their usual size: what teaches it, which pieces are one body, what recurs."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.segmentation.pieces import bodies_of, together, without_thin
from recorders.segmentation.recurring import FEWEST, recurring
from recorders.segmentation.torn import going_together
from recorders.segmentation.usual import Sightings, UsualSize
from recorders.vision import cv2

WIDTH, HEIGHT = 320, 240


def usual(width: float = 20.0, height: float = 60.0) -> UsualSize:
    return UsualSize(
        np.array([0.0, HEIGHT]),
        np.array([[width, height, width * height]] * 2),
        np.ones(2),
    )


def rows(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    return np.array([(x, y, w, h, w * h) for x, y, w, h in boxes], np.float64)


def mask_of(*boxes: tuple[int, int, int, int]) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), np.uint8)
    for x, y, w, h in boxes:
        mask[y : y + h, x : x + w] = 255
    return mask


def test_what_stands_alone_and_moves_teaches_the_usual_size() -> None:
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(8):
        specks = [(10 + 30 * i, 20, 3, 3) for i in range(8)]
        seen.observe(
            rows((10 + 30 * k, 100, 20, 60), *specks),
            rows((14 + 30 * k, 100, 20, 60), *specks),
        )
    learnt = seen.learn()
    assert learnt is not None
    for size, expected in zip(
        learnt.at(np.array([160.0, 60.0])), (20, 60, 1200), strict=True
    ):
        assert size.tolist() == [expected, expected]


@pytest.mark.parametrize("moves", [0, 4])
def test_what_never_moves_teaches_nothing(moves: int) -> None:
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(8):
        seen.observe(
            rows((10 + 30 * k, 100, 20, 60)), rows((10 + 30 * k + moves, 100, 20, 60))
        )
    assert (seen.learn() is None) == (moves == 0)


def test_a_stain_of_light_whose_one_edge_comes_and_goes_teaches_nothing() -> None:
    def learnt(shift: int, growth: int) -> UsualSize | None:
        seen = Sightings(WIDTH, HEIGHT)
        for k in range(8):
            x = 10 + 30 * k
            seen.observe(rows((x, 50, 12, 10)), rows((x + shift, 50, 12 + growth, 10)))
        return seen.learn()

    assert learnt(shift=1, growth=0) is not None
    assert learnt(shift=0, growth=1) is None
    assert learnt(shift=-1, growth=1) is None


def torn(*, together: bool) -> Sightings:
    """A head and legs, far apart, that move by the same way or by ways of their own."""
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(8):
        head, legs = (12 + 30 * k, 90, 10, 12), (10 + 30 * k, 140, 14, 30)
        other = 4 if together else -4
        later = (head[0] + 4, *head[1:]), (legs[0] + other, *legs[1:])
        seen.observe(rows(head, legs), rows(*later))
    return seen


def test_pieces_that_go_together_teach_the_size_of_the_body_that_they_are_of() -> None:
    learnt = torn(together=True).learn()
    assert learnt is not None
    assert [float(v) for v in learnt.at(np.array(170.0))] == [14.0, 80.0, 540.0]
    pieces = rows((50, 90, 10, 12), (48, 140, 14, 30))
    assert len(together(pieces, learnt)) == 1
    assert len(together(pieces, usual(14.0, 80.0))) == 2


def test_what_passes_above_one_another_is_no_body() -> None:
    seen = torn(together=False)
    learnt = seen.learn()
    assert not seen.torn
    assert learnt is not None
    assert float(learnt.at(np.array(170.0))[1]) == 30.0


@pytest.mark.parametrize(("width", "torn_too"), [(14, True), (40, False)])
def test_cars_that_follow_one_another_are_no_torn_body(width: int, torn_too: bool) -> None:
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(5):
        x = 10 + 50 * k
        here = (x, 90, width, 30), (x, 140, width, 30)
        seen.observe(rows(*here), rows(*((a + 4, y, w, h) for a, y, w, h in here)))
    assert seen.torn == torn_too


@pytest.mark.parametrize(
    ("regions", "way", "first"),
    [
        ([(0, 0, 9, 9), (0, 20, 9, 9), (0, 40, 9, 9)], [3, 4, 3], [0, 0, 0]),
        ([(0, 0, 9, 9), (0, 20, 9, 9), (0, 40, 9, 9)], [3, 9, 3], [0, 1, 0]),
        ([(0, 0, 9, 9), (6, 20, 9, 9)], [3, 3], [0, 1]),
        ([(0, 0, 9, 9), (0, 5, 9, 9)], [3, 3], [0, 1]),
        ([(0, 0, 9, 9), (0, 20, 2, 2)], [3, 3], [0, 1]),
        ([(0, 0, 9, 9), (0, 20, 9, 9)], [1, 1], [0, 1]),
        ([], [], []),
    ],
    ids=["a chain", "another way", "beside", "over it", "a speck", "at rest", "nothing"],
)
def test_which_regions_go_together(
    regions: list[tuple[int, int, int, int]], way: list[float], first: list[int]
) -> None:
    found = going_together(rows(*regions).reshape(-1, 5), np.array(way, np.float64))
    assert found.tolist() == first


def test_near_and_far_bodies_have_sizes_of_their_own() -> None:
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(8):
        far, near = (10 + 30 * k, 20, 5, 15), (10 + 25 * k, 90, 50, 140)
        later = [(x + 1, y, w, h) for x, y, w, h in (far, near)]
        seen.observe(rows(far, near), rows(*later))
    learnt = seen.learn()
    assert learnt is not None
    assert learnt.at(np.array([35.0, 230.0]))[1].tolist() == [15, 140]


def from_above(*, odd: bool) -> UsualSize:
    """What bodies that turn teach, lying here and standing there; or with one of a far reflection."""
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(4):
        lying, standing = (10 + 70 * k, 100, 60, 20), (30 + 70 * k, 150, 20, 60)
        there = [lying, standing, *([(200, 5, 20, 20)] if odd and not k else [])]
        seen.observe(rows(*there), rows(*((x + 4, y, w, h) for x, y, w, h in there)))
    learnt = seen.learn()
    assert learnt is not None
    return learnt


@pytest.mark.parametrize("odd", [False, True])
def test_bodies_seen_from_above_have_one_size_everywhere_however_they_turn(
    odd: bool,
) -> None:
    learnt = from_above(odd=odd)
    assert learnt.turning
    for size, expected in zip(
        learnt.at(np.array([25.0, 120.0, 230.0])), (60, 60, 1200), strict=True
    ):
        assert size.tolist() == [expected] * 3


def test_bodies_that_are_larger_where_they_are_nearer_are_not_seen_from_above() -> None:
    seen = Sightings(WIDTH, HEIGHT)
    for k in range(4):
        near, far = (10 + 70 * k, 150, 60, 40), (20 + 70 * k, 50, 48, 30)
        seen.observe(
            rows(near, far), rows(*((x + 4, y, w, h) for x, y, w, h in (near, far)))
        )
    learnt = seen.learn()
    assert learnt is not None
    assert not learnt.turning
    assert learnt.at(np.array([80.0, 190.0]))[0].tolist() == [48, 60]


def test_pieces_of_a_body_that_turns_are_one_and_never_more_than_a_body() -> None:
    usual = from_above(odd=False)
    halves = rows((100, 100, 28, 20), (132, 100, 28, 20))
    assert len(together(halves, usual)) == 1
    two = rows((100, 100, 20, 55), (125, 100, 20, 55))
    assert len(together(two, usual)) == 2


def test_a_tail_of_a_body_that_turns_is_taken_off() -> None:
    mask = mask_of((100, 100, 60, 20), (160, 108, 50, 4))
    blobs = bodies_of(mask, from_above(odd=False), None, upright=False)[2]
    assert [blob.box[2] for blob in blobs] == [pytest.approx(60, abs=3)]


def test_pieces_of_one_body_are_one_and_two_bodies_are_two() -> None:
    head, trunk, legs = (103, 50, 12, 12), (100, 66, 20, 20), (100, 92, 20, 18)
    other = (126, 50, 20, 60)
    groups = together(rows(head, trunk, legs, other), usual())
    assert sorted(sorted(g.pieces) for g in groups) == [[0, 1, 2], [3]]
    assert groups[0].box == (100, 50, 120, 110)


def test_a_piece_above_a_wide_one_is_its_other_half_up_to_a_body_s_height() -> None:
    upper, legs = (100, 60, 50, 38), (115, 100, 20, 38)
    assert len(together(rows(upper, legs), usual())) == 1
    higher = (100, 50, 50, 48)
    assert len(together(rows(higher, legs), usual())) == 2
    beside = (145, 100, 20, 38)
    assert len(together(rows(upper, beside), usual())) == 2


def test_a_body_is_one_component_of_the_mask_and_specks_are_none() -> None:
    pieces = [(103, 50, 12, 12), (100, 66, 20, 20), (100, 92, 20, 18)]
    mask, labels, blobs = bodies_of(mask_of(*pieces, (200, 50, 3, 3)), usual(), None)
    assert [blob.box for blob in blobs] == [(100, 50, 20, 60)]
    assert cv2.connectedComponents(mask, connectivity=8)[0] == 2
    assert labels.max() == 1


def test_a_thin_tail_does_not_count_for_a_size() -> None:
    mask = mask_of((100, 50, 20, 60), (120, 100, 60, 1))
    thick = without_thin(mask, usual())
    assert not thick[:, 122:].any()
    assert np.count_nonzero(thick) >= 0.95 * 20 * 60


def test_the_background_behind_visitors_is_what_recurs() -> None:
    ground = np.full((40, 40, 3), (120, 128, 128), np.uint8)
    stack = []
    for k in range(2 * FEWEST):
        picture = ground.copy()
        if k % 8 >= 3:  # a visitor for five of eight samples, each in other clothes
            picture[10:30, 10:30] = (20 + 25 * (k // 8), 128, 128 + 8 * (k // 8))
        stack.append(picture)
    visitor = ground.copy()
    visitor[10:30, 10:30] = (20, 128, 128)
    found, changed = recurring(stack, visitor)
    assert np.abs(found.astype(int) - ground).max() <= 1
    assert np.array_equal(changed > 0, (visitor != ground).any(axis=2))


def test_of_few_samples_nothing_recurs() -> None:
    picture = np.zeros((8, 8, 3), np.uint8)
    found, changed = recurring([picture] * (FEWEST - 1), picture)
    assert found is picture
    assert not changed.any()


def test_small_ones_that_move_by_more_than_themselves_teach_their_size() -> None:
    sightings = Sightings(1920, 1080)
    for k in range(12):
        now = np.array([(100 + 40 * k, 300, 9, 28, 160), (1500 - 30 * k, 420, 10, 27, 171)])
        sightings.observe(now.astype(np.float64), now + np.array([14, 0, 1, -1, 5.0]))
    usual = sightings.learn()
    assert usual is not None
    width, height, _ = usual.at(np.array(328.0))
    assert (9, 27) <= (float(width), float(height)) <= (10, 28)


def test_specks_of_noise_teach_no_size() -> None:
    rng, sightings = np.random.default_rng(3), Sightings(640, 480)
    for _ in range(60):
        now, later = (
            np.column_stack(
                [
                    rng.uniform(5, 600, 40),
                    rng.uniform(5, 450, 40),
                    *rng.integers(2, 6, (2, 40)),
                    rng.integers(4, 20, 40),
                ]
            )
            for _ in range(2)
        )
        sightings.observe(now, later)
    assert sightings.learn() is None


def test_small_fast_ones_teach_their_size_beside_large_ones_that_are_seen_more_often() -> (
    None
):
    sightings = Sightings(640, 480)
    for k in range(20):
        small = [(600 - 28 * k, 60, 9, 37, 250)] if k % 3 == 0 else []
        large = [(20 + 25 * k, 130, 90, 336, 16000)]
        now = np.array(small + large, np.float64)
        step = [[8, 0, 1, 0, 0]] * len(small) + [[12, 0, 0, 0, 0]]
        sightings.observe(now, now + np.array(step, np.float64))
    usual = sightings.learn()
    assert usual is not None
    assert usual.at(np.array([97.0, 466.0]))[1].tolist() == [37, 336]
