"""The nine criteria and the errors of PARTS, on cases counted by hand."""

from __future__ import annotations

import pytest

from replay.evaluate import MotTable, Trajectories, evaluate

Rows = list[tuple[int, int, float, float, float, float, float]]


def line(
    identity: int, frames: range, y: float = 0.0, dx: float = 0.0, w: float = 20.0
) -> Rows:
    return [(f, identity, 100.0 + dx, y, w, 40.0, 1.0) for f in frames]


def judged(truth: list[Rows], result: list[Rows]) -> Trajectories:
    true, found = (
        MotTable.from_rows([r for part in rows for r in part]) for rows in (truth, result)
    )
    return evaluate(true, found).trajectories


def test_mostly_tracked_lost_and_missed() -> None:
    truth = [line(i, range(10), y=100.0 * i) for i in range(1, 6)]
    result = [
        line(1, range(10), y=100.0),  # all
        line(2, range(8), y=200.0),  # 80 %, which is not more than 80 %
        line(3, range(4), y=300.0),  # 40 %, which is not less than 40 %
        line(4, range(3), y=400.0),  # 30 %
    ]
    t = judged(truth, result)
    assert (t.count, t.mostly_tracked, t.mostly_tracked_single_id) == (5, 1, 1)
    assert (t.mostly_lost, t.missed) == (1, 1)
    assert [x.share for x in t.each] == [100.0, 80.0, 40.0, 30.0, 0.0]
    assert (t.ids_per_trajectory, t.ids_per_frame) == (1.0, 1.0)


def test_two_ids_on_one_trajectory_is_over_segmented_and_no_swap() -> None:
    t = judged([line(1, range(10))], [line(5, range(5)), line(6, range(5, 10))])
    assert (t.over_segmented, t.mostly_tracked, t.mostly_tracked_single_id) == (1, 1, 0)
    assert (t.each[0].switches, t.each[0].swaps, t.swaps_per_trajectory) == (1, 0, 0.0)
    assert t.each[0].ids == (5, 6)


def test_a_newcomer_under_an_old_id_is_under_segmented() -> None:
    t = judged(
        [line(1, range(5)), line(2, range(5, 10), y=200.0)],
        [line(7, range(5)), line(7, range(5, 10), y=200.0)],
    )
    assert (t.under_segmented, t.over_segmented) == (1, 0)
    assert [x.under_segmented for x in t.each] == [False, True]


def test_a_second_response_counts_per_frame_unless_it_is_another_ones() -> None:
    double = judged([line(1, range(10))], [line(5, range(10)), line(6, range(5), dx=2.0)])
    assert double.ids_per_frame == pytest.approx(1.5)
    # Two people who cover one another, each with their own track: one response each.
    crossing = [line(1, range(10)), line(2, range(10), dx=5.0)]
    assert (
        judged(crossing, [line(5, range(10)), line(6, range(10), dx=5.0)]).ids_per_frame
        == 1.0
    )


def test_averages_run_over_the_trajectories_found() -> None:
    """Table 1 of the paper: 3.11 swaps with one of ten missed is 28 ninths."""
    truth = [line(1, range(10)), line(2, range(10), y=200.0), line(3, range(10), y=400.0)]
    result = [line(5, range(5)), line(6, range(5, 10)), line(7, range(10), y=200.0)]
    assert judged(truth, result).ids_per_trajectory == pytest.approx(3 / 2)


def test_errors_in_all_normalisations() -> None:
    """2 px to the right and 22 wide instead of 20: the centre is 3 px off, at 110, 20 of the
    truth.
    """
    t = judged([line(1, range(8))], [line(5, range(4), dx=2.0, w=22.0)])
    e = t.matched
    assert e.frames == 4
    assert e.share == 50.0
    assert e.pixels == pytest.approx((3.0, 0.0, 2.0, 0.0))
    assert e.coordinate == pytest.approx((100 * 3 / 110, 0.0, 10.0, 0.0))
    assert e.size == pytest.approx((15.0, 0.0, 10.0, 0.0))
    assert e.headline == pytest.approx((100 * 3 / 110, 0.0, 10.0, 0.0))


def test_followed_counts_frames_in_which_the_track_went_astray() -> None:
    straying = [
        (f, 5, 100.0 + (30.0 if f >= 6 else 0.0), 0.0, 20.0, 40.0, 1.0) for f in range(8)
    ]
    t = judged([line(1, range(8))], [straying])
    assert (t.matched.frames, t.matched.pixels[0]) == (6, 0.0)
    assert (t.followed.frames, t.followed.share) == (8, 100.0)
    assert t.followed.pixels[0] == pytest.approx(30.0 * 2 / 8)
