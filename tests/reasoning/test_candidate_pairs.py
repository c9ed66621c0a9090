"""Pairs found along one axis: all that meet, in the order of all pairs."""

from __future__ import annotations

from hypothesis import given, settings
from hypothesis import strategies as st

from reasoning.candidate_pairs import near_pairs
from reasoning.geometry import Area
from tests.examples import examples

places = st.lists(
    st.tuples(st.floats(-1e6, 1e6) | st.integers(0, 9).map(float), st.floats(0, 50)),
    max_size=12,
)


@settings(deadline=None, max_examples=examples(300), database=None)
@given(places)
def test_no_pair_that_meets_is_left_out(rows: list[tuple[float, float]]) -> None:
    middles, reaches = [m for m, _ in rows], [r for _, r in rows]
    found = near_pairs(middles, reaches)
    meeting = [
        (i, j)
        for i in range(len(rows))
        for j in range(i + 1, len(rows))
        if abs(middles[i] - middles[j]) <= reaches[i] + reaches[j]
    ]
    assert set(meeting) <= set(found)
    assert found == sorted(set(found))
    assert all(i < j for i, j in found)


def test_few_pairs_of_many_that_are_far_apart() -> None:
    assert near_pairs([100.0 * k for k in range(200)], [10.0] * 200) == []


def test_who_is_nowhere_is_near_nobody_and_does_not_hide_the_others() -> None:
    nan = float("nan")
    assert near_pairs([0.0, nan, 1.0, 2.0], [1.0, 1.0, nan, 1.0]) == [(0, 3)]
    assert near_pairs([0.0, 500.0], [float("inf"), 1.0]) == [(0, 1)]


@settings(deadline=None, max_examples=examples(200), database=None)
@given(
    st.lists(
        st.tuples(
            *[st.integers(-4, 24).map(float)] * 2, *[st.integers(0, 20).map(float)] * 2
        ),
        max_size=8,
    )
)
def test_boxes_one_by_one_lie_as_boxes_together(
    boxes: list[tuple[float, float, float, float]],
) -> None:
    for polygons in ([[(2, 3), (18, 3), (18, 17), (2, 17)]], [[(0, 0), (20, 2), (10, 20)]]):
        area = Area(polygons)
        assert area.covers(boxes) == area.cover(boxes).tolist()
