"""Boxes against unions of polygons, checked by sampling; circles; shells."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from reasoning.geometry import (
    OUTSIDE,
    PARTLY,
    WHOLLY,
    Area,
    circles_overlap_area,
    circles_overlap_share,
)
from reasoning.interactions import collision_map
from reasoning.relations import Objects, RelationBook
from tests.examples import examples

Polygon = list[tuple[float, float]]
IntBox = tuple[int, int, int, int]

whole = st.integers(0, 40)


@st.composite
def polygons(draw: st.DrawFn) -> Polygon:
    """Star-shaped polygons around a centre, so that they never cross themselves; whole and half
    coordinates.
    """
    cx, cy = draw(whole), draw(whole)
    spokes = draw(
        st.lists(
            st.tuples(st.integers(0, 23), st.integers(3, 25)),
            min_size=3,
            max_size=9,
            unique_by=lambda s: s[0],
        )
    )
    points = [
        (cx + r * math.cos(a * math.pi / 12), cy + r * math.sin(a * math.pi / 12))
        for a, r in sorted(spokes)
    ]
    return [(round(2 * x) / 2, round(2 * y) / 2) for x, y in points]


rectangles = st.tuples(whole, whole, st.integers(1, 30), st.integers(1, 30)).map(
    lambda r: [
        (r[0], r[1]),
        (r[0] + r[2], r[1]),
        (r[0] + r[2], r[1] + r[3]),
        (r[0], r[1] + r[3]),
    ]
)
boxes = st.tuples(
    st.integers(-5, 45), st.integers(-5, 45), st.integers(1, 25), st.integers(1, 25)
)


def samples(box: IntBox, n: int = 23) -> np.ndarray:
    """Points in the open interior of a box, off the grid that vertices lie on."""
    steps = (np.arange(n) + 0.481) / n
    x, y = np.meshgrid(box[0] + box[2] * steps, box[1] + box[3] * steps)
    return np.stack([x.ravel(), y.ravel()], axis=1)


def judge(area: Area, box: IntBox) -> tuple[int, np.ndarray]:
    """What sampling cannot deny: the answer allows every sampled point."""
    inside = area.contains(samples(box))
    answer = int(area.cover([box])[0])
    if answer == WHOLLY:
        assert inside.all()
    elif answer == OUTSIDE:
        assert not inside.any()
    return answer, inside


@settings(deadline=None, max_examples=examples(150), database=None)
@given(st.lists(rectangles, min_size=1, max_size=5), boxes)
def test_unions_of_rectangles_exactly(parts: list[Polygon], box: IntBox) -> None:
    """On whole coordinates a unit grid decides exactly."""
    area = Area(parts)
    cells = [
        (x + 0.5, y + 0.5)
        for x in range(box[0], box[0] + box[2])
        for y in range(box[1], box[1] + box[3])
    ]
    inside = area.contains(cells)
    expected = WHOLLY if inside.all() else PARTLY if inside.any() else OUTSIDE
    assert area.cover([box]).tolist() == [expected]


@settings(deadline=None, max_examples=examples(150), database=None)
@given(st.lists(polygons(), min_size=1, max_size=3), boxes)
def test_unions_of_slanted_polygons_are_never_denied_by_a_point(
    parts: list[Polygon], box: IntBox
) -> None:
    answer, inside = judge(Area(parts), box)
    if inside.any() and not inside.all():
        assert answer == PARTLY


@settings(deadline=None, max_examples=examples(100), database=None)
@given(polygons(), st.lists(boxes, min_size=1, max_size=6))
def test_many_boxes_at_once_are_what_each_alone_is(
    polygon: Polygon, several: list[IntBox]
) -> None:
    area = Area([polygon])
    assert area.cover(several).tolist() == [int(area.cover([b])[0]) for b in several]
    assert Area([polygon[::-1]]).cover(several).tolist() == area.cover(several).tolist()


radii = st.floats(0.1, 50)


@settings(deadline=None, max_examples=examples(200), database=None)
@given(st.floats(0, 120), radii, radii)
def test_circle_overlap_is_symmetric_and_bounded(
    distance: float, r1: float, r2: float
) -> None:
    area = circles_overlap_area(distance, r1, r2)
    assert math.isclose(
        area, circles_overlap_area(distance, r2, r1), rel_tol=1e-9, abs_tol=1e-6
    )
    assert 0 <= area <= math.pi * min(r1, r2) ** 2 * (1 + 1e-9)
    assert 0 <= circles_overlap_share(distance, r1, r2) <= 1
    assert (area == 0) or distance < r1 + r2


placed = st.tuples(
    st.integers(0, 60), st.integers(0, 60), st.integers(1, 20), st.integers(1, 20)
)


@settings(deadline=None, max_examples=examples(100), database=None)
@given(st.lists(placed, min_size=2, max_size=8), st.floats(0.5, 20))
def test_collisions_are_symmetric_and_do_not_depend_on_the_scale_of_the_picture(
    several: list[IntBox], factor: float
) -> None:
    small = np.array(several, np.float64)
    colliding = collision_map(small, 0.25)
    assert (colliding == colliding.T).all()
    assert not colliding.diagonal().any()
    grown = collision_map(small * 2.0 ** round(math.log2(factor)), 0.25)
    assert (grown == colliding).all()


@settings(deadline=None, max_examples=examples(100), database=None)
@given(
    st.lists(
        st.tuples(st.integers(0, 99), st.integers(0, 99), st.integers(1, 30)),
        min_size=1,
        max_size=9,
    )
)
def test_vectorised_meeting_is_what_each_pair_says(
    circles: list[tuple[int, int, int]],
) -> None:
    ids = list(range(len(circles)))
    c = np.array(circles, np.float64)
    book = RelationBook()
    book.step(
        0, 0, Objects(ids, c[:, :2], c[:, 2], ids, [True] * len(ids), [True] * len(ids))
    )
    expected = [
        (i, j)
        for i in ids
        for j in ids[i + 1 :]
        if math.sqrt((c[i, 0] - c[j, 0]) ** 2 + (c[i, 1] - c[j, 1]) ** 2)
        <= c[i, 2] + c[j, 2]
    ]
    assert [(e.a, e.b) for e in book.edges] == expected
