"""EVENTS 3.1: safety areas, the collision map, every row of the pair table, partner lists, group
trackers.
"""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from reasoning.interactions import (
    InteractionBook,
    InteractionParameters,
    TargetRows,
    collision_map,
    pair_bit,
)
from reasoning.transitions import GROUPED, GROUPING, SPLITTING
from recorders.messages import GroupTrack

NONE = 0


@pytest.mark.parametrize("before", [NONE, GROUPING, SPLITTING])
@pytest.mark.parametrize("over", [False, True])
def test_without_collision_there_is_nothing(before: int, over: bool) -> None:
    assert (
        pair_bit(before, collides=False, over_group=over, newborn=False, of_split=False)
        == NONE
    )


@pytest.mark.parametrize("over", [False, True])
def test_grouped_that_stop_colliding_split_for_a_frame(over: bool) -> None:
    assert (
        pair_bit(GROUPED, collides=False, over_group=over, newborn=False, of_split=False)
        == SPLITTING
    )


@pytest.mark.parametrize(
    ("before", "over", "after"),
    [
        (NONE, False, GROUPING),
        (GROUPING, False, GROUPING),
        (GROUPED, False, SPLITTING),
        (SPLITTING, False, SPLITTING),
        (NONE, True, GROUPED),
        (GROUPING, True, GROUPED),
        (GROUPED, True, GROUPED),
        (SPLITTING, True, GROUPED),
    ],
)
def test_every_row_with_collision(before: int, over: bool, after: int) -> None:
    assert (
        pair_bit(before, collides=True, over_group=over, newborn=False, of_split=False)
        == after
    )


def test_a_newborn_groups_with_nobody_and_one_of_a_split_is_splitting() -> None:
    assert (
        pair_bit(NONE, collides=True, over_group=False, newborn=True, of_split=False)
        == NONE
    )
    assert (
        pair_bit(NONE, collides=True, over_group=False, newborn=True, of_split=True)
        == SPLITTING
    )


@pytest.mark.parametrize("over", [False, True])
def test_one_who_is_not_in_the_picture_begins_nothing(over: bool) -> None:
    assert (
        pair_bit(
            NONE,
            collides=True,
            over_group=over,
            newborn=False,
            of_split=False,
            starts=False,
        )
        == NONE
    )
    assert (
        pair_bit(GROUPING, True, False, newborn=False, of_split=False, starts=False)
        == GROUPING
    )


def test_safety_areas_are_proportional_to_size() -> None:
    small = np.array([(0, 0, 10, 20), (16.0, 0, 10, 20)], np.float64)
    assert collision_map(small, 0.25).tolist() == [[False, True], [True, False]]
    assert collision_map(small * 37.5, 0.25)[0, 1]
    apart = small + np.array([[0, 0, 0, 0], [2, 0, 0, 0]])
    assert not collision_map(apart, 0.25)[0, 1]
    assert not collision_map(apart * 37.5, 0.25)[0, 1]
    assert collision_map(apart, 0.5)[0, 1]


@pytest.mark.parametrize("aspect", [0.2, 0.5, 1.0, 2.5, 6.0])
def test_overlapping_boxes_of_one_shape_collide(aspect: float) -> None:
    w, h = 10.0, 10.0 * aspect
    boxes = np.array([(0, 0, w, h), (w * 0.999, h * 0.999, w, h)])
    assert collision_map(boxes, 0.208)[0, 1]


class Crowd:
    """People of 20 x 20 on a line; at the default margin they collide up to 30 px apart."""

    def __init__(self, **parameters: Any) -> None:
        self.book = InteractionBook(InteractionParameters(**parameters))
        self.frame, self.before = -1, set[int]()

    def step(
        self,
        places: dict[int, int],
        blobs: dict[int, int] | None = None,
        tracks: list[GroupTrack] | None = None,
        of_split: tuple[int, ...] = (),
        unseen: tuple[int, ...] = (),
        absent: tuple[int, ...] = (),
        leaving: tuple[int, ...] = (),
    ) -> dict[tuple[int, int], int]:
        self.frame += 1
        ids, blobs = sorted(places), blobs or {}
        members = TargetRows(
            ids,
            np.array([[places[i], 0, 20, 20] for i in ids], np.float64).reshape(-1, 4),
            [blobs.get(i, i + 100) for i in ids],
            [i not in unseen for i in ids],
            [i not in absent for i in ids],
            [i not in self.before for i in ids],
            [i in of_split for i in ids],
            leaving,
        )
        self.before = set(ids)
        changes, self.clusters = self.book.step(
            self.frame, self.frame * 40_000_000, members, tracks
        )
        return {(c.a, c.b): c.after for c in changes}


def test_two_meet_group_split_and_are_single() -> None:
    crowd = Crowd()
    assert crowd.step({1: 0, 2: 50}) == {}
    assert crowd.step({1: 0, 2: 25}) == {(1, 2): GROUPING}
    assert crowd.book.partners(1, GROUPING) == [2]
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: 9}) == {(1, 2): GROUPED}
    assert crowd.clusters[0].members == (1, 2)
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: 9}) == {}
    assert crowd.step({1: 0, 2: 25}) == {(1, 2): SPLITTING}
    assert crowd.step({1: 0, 2: 50}) == {(1, 2): NONE}
    assert crowd.book.states == {1: 0, 2: 0}


def test_the_papers_example_of_grouping_and_splitting_at_once() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 10, 3: 90})
    crowd.step({1: 0, 2: 10, 3: 90}, {1: 9, 2: 9})
    assert crowd.book.states == {1: GROUPED, 2: GROUPED, 3: 0}
    crowd.step({1: 0, 2: 25, 3: 50})
    assert crowd.book.states == {1: SPLITTING, 2: GROUPING | SPLITTING, 3: GROUPING}
    assert (crowd.book.partners(2, GROUPING), crowd.book.partners(2, SPLITTING)) == (
        [3],
        [1],
    )


def test_new_born_tracks_wait_a_frame() -> None:
    crowd = Crowd()
    assert crowd.step({1: 0}) == {}
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: 9}) == {}
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: 9}) == {(1, 2): GROUPED}


def test_born_of_a_split() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 3: 70})
    assert crowd.step({1: 0, 2: 22, 3: 70}, of_split=(2,)) == {(1, 2): SPLITTING}
    assert crowd.book.bit_of(2, 1) == SPLITTING


def test_those_in_one_blob_who_do_not_collide_are_partners_through_the_one_between() -> (
    None
):
    crowd = Crowd()
    crowd.step({1: 0, 2: 25, 3: 50})
    crowd.step({1: 0, 2: 25, 3: 50}, {1: 9, 2: 9, 3: 9})
    assert crowd.clusters[0].members == (1, 2, 3)
    assert crowd.book.partners(1, GROUPED) == [2]
    assert crowd.book.partners(2, GROUPED) == [1, 3]


def test_far_ends_of_one_blob_are_no_group() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 90})
    assert crowd.step({1: 0, 2: 90}, {1: 9, 2: 9}) == {}
    assert crowd.clusters == []


def test_a_hidden_member_counts_into_its_partners_blob() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 10})
    crowd.step({1: 0, 2: 10}, {1: 9, 2: 9})
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: -1}, unseen=(2,)) == {}
    assert crowd.book.states == {1: GROUPED, 2: GROUPED}
    assert crowd.step({1: 0, 2: 10}, {1: -1, 2: -1}, unseen=(1, 2)) == {(1, 2): SPLITTING}


def test_one_who_was_never_grouped_is_not_hidden_in_a_blob() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 10})
    crowd.step({1: 0, 2: 10})
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: -1}, unseen=(2,)) == {}
    assert crowd.book.states == {1: GROUPING, 2: GROUPING}


def test_what_is_only_predicted_begins_nothing() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 10})
    assert crowd.step({1: 0, 2: 10}, {1: 9, 2: -1}, unseen=(2,)) == {}
    assert crowd.book.bonds == {}


def test_who_is_grouped_with_nobody_is_no_member_of_the_group() -> None:
    crowd = Crowd()
    far = (500, 500, 10, 10)
    over = [
        GroupTrack(0, far, True, members=[1, 2, 3]),
        GroupTrack(1, (-5, -5, 90, 40), True),
    ]
    crowd.step({1: 0, 2: 10, 3: 80})
    crowd.step({1: 0, 2: 10, 3: 80}, tracks=over[:1])
    assert [c.members for c in crowd.clusters] == [(1, 2)]
    # He is only predicted to have come, and may begin nothing.
    assert crowd.step({1: 0, 2: 10, 3: 20}, tracks=over[1:], unseen=(3,)) == {}
    assert [c.members for c in crowd.clusters] == [(1, 2)]
    assert crowd.book.states[3] == NONE


def test_a_jump_out_of_a_group_is_told_and_splits_for_one_frame() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 10})
    crowd.step({1: 0, 2: 10}, {1: 9, 2: 9})
    assert crowd.step({1: 0, 2: 200}) == {(1, 2): SPLITTING}
    assert crowd.step({1: 0, 2: 200}) == {(1, 2): NONE}


def test_group_tracks_of_the_tracker_decide_when_given() -> None:
    crowd = Crowd()
    box = (-5, -5, 60, 40)
    crowd.step({1: 0, 2: 15, 3: 70})
    assert crowd.step({1: 0, 2: 15, 3: 70}, {1: 9, 2: 9}, tracks=[]) == {(1, 2): GROUPING}
    assert crowd.step({1: 0, 2: 15, 3: 70}, tracks=[GroupTrack(5, box, True)]) == {
        (1, 2): GROUPED
    }
    assert (crowd.clusters[0].source, crowd.clusters[0].source_id) == ("group track", 5)
    assert crowd.step({1: 0, 2: 15, 3: 70}, tracks=[GroupTrack(5, box, False)]) == {
        (1, 2): SPLITTING
    }


def test_group_tracks_may_name_their_members() -> None:
    crowd = Crowd()
    far = (500, 500, 10, 10)
    crowd.step({1: 0, 2: 15, 3: 31})
    crowd.step({1: 0, 2: 15, 3: 31}, tracks=[GroupTrack(0, far, True, members=[1, 2])])
    assert crowd.clusters[0].members == (1, 2)
    assert crowd.book.states == {1: GROUPED, 2: GROUPED | GROUPING, 3: GROUPING}


def test_a_target_lies_over_one_group_tracker_the_one_that_holds_more_of_it() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 15, 3: 30, 4: 45})
    left, right = GroupTrack(8, (0, 0, 36, 20), True), GroupTrack(9, (25, 0, 50, 20), True)
    crowd.step({1: 0, 2: 15, 3: 30, 4: 45}, tracks=[left, right])
    assert [c.members for c in crowd.clusters] == [(1, 2), (3, 4)]


def test_one_in_its_last_frame_is_in_no_region() -> None:
    crowd = Crowd()
    crowd.step({1: 0, 2: 10})
    crowd.step({1: 0, 2: 10}, {1: 9, 2: 9})
    assert crowd.step(
        {1: 0, 2: 10}, {1: 9, 2: -1}, unseen=(2,), absent=(2,), leaving=(2,)
    ) == {(1, 2): SPLITTING}
    assert crowd.step({1: 0}) == {(1, 2): NONE}


def test_a_second_threshold_damps_flicker() -> None:
    crowd, steady = Crowd(), Crowd(leave_margin=0.2)
    places = [{1: 0, 2: 29 + 3 * (f % 2)} for f in range(1, 9)]
    assert [bool(crowd.step(p)) for p in places] == [
        False,
        True,
        True,
        True,
        True,
        True,
        True,
        True,
    ]
    assert [bool(steady.step(p)) for p in places] == [
        False,
        True,
        False,
        False,
        False,
        False,
        False,
        False,
    ]
    assert steady.step({1: 0, 2: 37}) == {(1, 2): NONE}


def test_state_is_plain_and_continues() -> None:
    crowd, twin = Crowd(), Crowd()
    crowd.step({1: 0, 2: 10, 3: 60})
    crowd.step({1: 0, 2: 10, 3: 35}, {1: 9, 2: 9})
    twin.book.restore(json.loads(json.dumps(crowd.book.state())))
    twin.frame, twin.before = crowd.frame, crowd.before
    assert twin.book.states == crowd.book.states
    for places in ({1: 0, 2: 25, 3: 50}, {1: 0, 2: 60, 3: 90}):
        assert crowd.step(places) == twin.step(places)
        assert crowd.book.state() == twin.book.state()
