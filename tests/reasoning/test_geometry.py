"""Boxes, circles, ellipses and polygons."""

from __future__ import annotations

import math

import numpy as np
import pytest

from reasoning.geometry import (
    OUTSIDE,
    PARTLY,
    WHOLLY,
    Area,
    centres,
    circle_around_ellipse,
    circles_overlap_area,
    circles_overlap_share,
    half_diagonals,
    share_inside,
)
from recorders.messages import Ellipse

SQUARE = [(10.0, 10.0), (50.0, 10.0), (50.0, 50.0), (10.0, 50.0)]
DIAMOND = [(50.0, 0.0), (100.0, 50.0), (50.0, 100.0), (0.0, 50.0)]
HOOK = [
    (0.0, 0.0),
    (90.0, 0.0),
    (90.0, 30.0),
    (30.0, 30.0),
    (30.0, 60.0),
    (90.0, 60.0),
    (90.0, 90.0),
    (0.0, 90.0),
]


def test_boxes_have_centres_and_enclosing_circles() -> None:
    boxes = [(0, 0, 6, 8), (10, 20, 0, 0)]
    assert centres(boxes).tolist() == [[3, 4], [10, 20]]
    assert half_diagonals(boxes).tolist() == [5, 0]


def test_circle_around_an_ellipse_reaches_from_the_given_centre() -> None:
    e = Ellipse(3, 4, 20, 6, 0.3)
    assert circle_around_ellipse(e, (3, 4)) == 10
    assert circle_around_ellipse(e, (0, 0)) == 15


def test_share_of_a_box_in_another() -> None:
    assert share_inside((0, 0, 10, 10), (5, 0, 10, 10)) == 0.5
    assert share_inside((0, 0, 10, 10), (10, 0, 10, 10)) == 0
    assert share_inside((2, 2, 1, 1), (0, 0, 10, 10)) == 1
    assert share_inside((2, 2, 0, 5), (0, 0, 10, 10)) == 0


def test_circles_overlap_area_known_cases() -> None:
    assert circles_overlap_area(4, 2, 2) == 0
    assert circles_overlap_area(0, 2, 5) == pytest.approx(4 * math.pi)
    lens = 2 * math.pi / 3 - math.sqrt(3) / 2
    assert circles_overlap_area(1, 1, 1) == pytest.approx(lens)
    assert circles_overlap_share(1, 1, 1) == pytest.approx(lens / math.pi, abs=1e-9)


@pytest.mark.parametrize(
    ("distance", "r1", "r2", "share"),
    [(1, 0, 2, 1), (3, 0, 2, 0), (9, 2, 2, 0), (1, 1, 5, 1)],
)
def test_circles_overlap_share_limits(distance: int, r1: int, r2: int, share: int) -> None:
    assert circles_overlap_share(distance, r1, r2) == share


def test_circle_overlap_matches_counting_points() -> None:
    y, x = np.mgrid[-4:8:0.01, -4:8:0.01]
    both = (x**2 + y**2 <= 9) & ((x - 2.5) ** 2 + y**2 <= 4)
    assert circles_overlap_area(2.5, 3, 2) == pytest.approx(both.sum() * 1e-4, rel=1e-3)


@pytest.mark.parametrize("polygon", [SQUARE, SQUARE[::-1]])
def test_points_in_an_upright_rectangle_include_its_border(
    polygon: list[tuple[float, float]],
) -> None:
    points = [(10, 10), (30, 10), (50, 50), (30, 30), (9.999, 30), (30, 50.001)]
    assert Area([polygon]).contains(points).tolist() == [
        True,
        True,
        True,
        True,
        False,
        False,
    ]


def test_points_in_a_slanted_polygon_include_its_border() -> None:
    points = [(50, 50), (25, 25), (50, 0), (0, 0), (24, 24), (100, 50), (100.1, 50)]
    assert Area([DIAMOND]).contains(points).tolist() == [
        True,
        True,
        True,
        False,
        False,
        True,
        False,
    ]


def test_points_in_a_concave_polygon() -> None:
    assert Area([HOOK]).contains([(10, 45), (60, 45), (60, 15), (60, 30)]).tolist() == [
        True,
        False,
        True,
        True,
    ]


@pytest.mark.parametrize(
    ("polygons", "box", "expected"),
    [
        ([SQUARE], (10, 10, 40, 40), WHOLLY),
        ([SQUARE], (20, 20, 5, 5), WHOLLY),
        ([SQUARE], (40, 40, 20, 5), PARTLY),
        ([SQUARE], (50, 10, 20, 20), OUTSIDE),
        ([SQUARE], (0, 0, 100, 100), PARTLY),
        ([DIAMOND], (30, 30, 40, 40), WHOLLY),
        ([DIAMOND], (25, 25, 50, 50), WHOLLY),
        ([DIAMOND], (24, 25, 50, 50), PARTLY),
        ([DIAMOND], (0, 0, 20, 20), OUTSIDE),
        ([HOOK], (5, 5, 20, 80), WHOLLY),
        ([HOOK], (5, 5, 80, 80), PARTLY),  # all four corners inside, the notch is not
        ([HOOK], (40, 31, 40, 28), OUTSIDE),
        ([], (0, 0, 5, 5), OUTSIDE),
        ([[(0.0, 0.0), (9.0, 9.0)]], (0, 0, 5, 5), OUTSIDE),
    ],
)
def test_how_a_box_lies_in_one_polygon(
    polygons: list[list[tuple[float, float]]], box: tuple[int, int, int, int], expected: int
) -> None:
    assert Area(polygons).cover([box]).tolist() == [expected]


LEFT = [(0.0, 0.0), (40.0, 0.0), (60.0, 100.0), (0.0, 100.0)]
RIGHT = [(40.0, 0.0), (100.0, 0.0), (100.0, 100.0), (60.0, 100.0)]
ISLAND = [(200.0, 0.0), (300.0, 0.0), (250.0, 90.0)]


@pytest.mark.parametrize(
    ("box", "expected"),
    [
        (
            (10, 10, 80, 80),
            WHOLLY,
        ),  # across the slanted seam of two polygons that share an edge
        ((0, 0, 100, 100), WHOLLY),
        ((50, 50, 60, 10), PARTLY),
        ((150, 20, 20, 20), OUTSIDE),
        ((240, 5, 20, 20), WHOLLY),
        ((190, 60, 120, 20), PARTLY),
    ],
)
def test_how_a_box_lies_in_a_union(box: tuple[int, int, int, int], expected: int) -> None:
    assert Area([LEFT, RIGHT, ISLAND]).cover([box]).tolist() == [expected]


def test_overlapping_polygons_cover_together() -> None:
    cross = [
        [(0.0, 40.0), (100.0, 40.0), (100.0, 60.0), (0.0, 60.0)],
        [(40.0, 0.0), (60.0, 0.0), (60.0, 100.0), (40.0, 100.0)],
    ]
    boxes = [
        (0, 40, 100, 20),
        (40, 0, 20, 100),
        (45, 35, 10, 30),
        (35, 35, 30, 30),
        (0, 0, 30, 30),
    ]
    assert Area(cross).cover(boxes).tolist() == [WHOLLY, WHOLLY, WHOLLY, PARTLY, OUTSIDE]


def test_how_deep_a_point_lies() -> None:
    square = [(0.0, 0.0), (10.0, 0.0), (10.0, 10.0), (0.0, 10.0)]
    slanted = [(0.0, 0.0), (4.0, -3.0), (7.0, 1.0), (3.0, 4.0)]
    points = [(5.0, 5.0), (1.0, 5.0), (10.0, 5.0), (13.0, 14.0), (5.0, 12.0)]
    assert Area([square]).depth(points).tolist() == [5.0, 1.0, 0.0, -5.0, -2.0]
    # The square is turned by the angle of a 3-4-5 triangle, its side is 5: (3.5, 0.5) is its
    # middle.
    assert Area([slanted]).depth([(3.5, 0.5), (8.0, -6.0)]).tolist() == pytest.approx(
        [2.5, -5.0]
    )
    assert Area([square, slanted]).depth([(-3.0, -4.0)]).tolist() == [-5.0]
    assert Area([]).depth([(1.0, 1.0)]).tolist() == [-math.inf]


def test_no_boxes_give_no_answers() -> None:
    assert Area([SQUARE]).cover(np.zeros((0, 4))).tolist() == []
    assert Area([LEFT, RIGHT]).contains(np.zeros((0, 2))).tolist() == []
