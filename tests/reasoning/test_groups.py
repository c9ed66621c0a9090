"""Groups: nobody joins one; labels, ends, beginnings, and where each came from."""

from __future__ import annotations

import json

from reasoning.groups import GroupBook
from reasoning.interactions import Cluster


class Life:
    def __init__(self) -> None:
        self.book = GroupBook()
        self.frame = -1

    def step(
        self,
        *clusters: tuple[int, ...],
        entered: tuple[()] | list[tuple[int, ...]] = (),
        splitting: tuple[()] | list[tuple[int, int]] = (),
        ids: range = range(1, 10),
    ) -> list[tuple[str, int, tuple[int, ...], tuple[int, ...]]]:
        self.frame += 1
        seen = [Cluster(tuple(c), "blob", k + 1) for k, c in enumerate(clusters)]
        changes = self.book.step(
            self.frame, self.frame * 1000, seen, entered, splitting, list(ids)
        )
        return [
            (c.kind, c.group.label, c.group.members, c.group.formed_from) for c in changes
        ]


def test_a_group_lives_while_observed_or_splitting() -> None:
    life = Life()
    assert life.step((1, 2)) == [("group_formed", 1, (1, 2), ())]
    assert life.step((1, 2)) == []
    assert life.step(splitting=[(1, 2)]) == []
    assert not life.book.groups[0].observed
    assert life.book.of(1) == 1
    assert life.step() == [("group_ended", 1, (1, 2), ())]
    assert life.book.of(1) is None


def test_the_same_members_in_one_region_again_are_the_same_group() -> None:
    life = Life()
    life.step((1, 2))
    life.step(splitting=[(1, 2)])
    assert life.step((1, 2)) == []
    assert [(g.label, g.observed, g.since_frame) for g in life.book.groups] == [
        (1, True, 0)
    ]


def test_nobody_joins_a_group() -> None:
    life = Life()
    life.step((1, 2))
    assert life.step((1, 2, 3)) == [("group_changed", 2, (1, 2, 3), (1,))]
    assert [g.label for g in life.book.groups] == [2]


def test_one_leaves_and_the_others_are_another_group() -> None:
    life = Life()
    life.step((1, 2, 3))
    assert life.step((1, 2), splitting=[(1, 3)]) == [("group_changed", 2, (1, 2), (1,))]


def test_one_leaves_as_another_joins() -> None:
    life = Life()
    life.step((1, 2, 3))
    assert life.step((2, 3, 4), splitting=[(1, 2)]) == [
        ("group_changed", 2, (2, 3, 4), (1,))
    ]


def test_who_splits_from_no_member_any_more_has_left_the_group() -> None:
    life = Life()
    life.step((1, 2, 3))
    assert life.step(splitting=[(1, 2), (2, 3)]) == []
    assert life.step(splitting=[(1, 2)]) == [("group_changed", 1, (1, 2), ())]
    assert (life.book.of(1), life.book.of(2), life.book.of(3)) == (1, 1, None)
    assert life.step((3, 4), splitting=[(1, 2)]) == [("group_formed", 2, (3, 4), ())]
    assert life.book.of(1) == 1
    assert life.step((1, 2), (3, 4)) == [("group_changed", 3, (1, 2), (1,))]


def test_two_groups_merge_and_come_apart() -> None:
    life = Life()
    assert [c[1] for c in life.step((1, 2), (3, 4))] == [1, 2]
    assert life.step((1, 2, 3, 4)) == [("group_changed", 3, (1, 2, 3, 4), (1, 2))]
    assert life.step((1, 2), (3, 4), splitting=[(2, 3)]) == [
        ("group_changed", 4, (1, 2), (3,)),
        ("group_changed", 5, (3, 4), (3,)),
    ]


def test_labels_are_never_used_again() -> None:
    life = Life()
    life.step((1, 2))
    life.step()
    assert life.step((1, 2)) == [("group_formed", 2, (1, 2), ())]


def test_a_group_that_entered_as_one() -> None:
    life = Life()
    assert life.step(entered=[(1, 2)], splitting=[(1, 2)]) == [
        ("group_entered_scene", 1, (1, 2), ())
    ]
    assert not life.book.groups[0].observed
    assert life.step((1, 2)) == []


def test_one_born_out_of_a_known_group_names_it() -> None:
    life = Life()
    life.step((1, 2))
    assert life.step(entered=[(1, 2, 3)], splitting=[(1, 2), (1, 3)]) == [
        ("group_entered_scene", 2, (1, 2, 3), (1,))
    ]


def test_one_born_out_of_a_group_that_is_still_seen_leaves_it_alone() -> None:
    life = Life()
    life.step((1, 2))
    assert life.step((1, 2), entered=[(1, 2, 3)], splitting=[(1, 3)]) == []


def test_the_end_names_who_is_gone() -> None:
    life = Life()
    life.step((1, 2))
    changes = life.book.step(1, 2000, [], [], [], [1])
    assert (changes[0].kind, changes[0].gone, changes[0].lasted_ns) == (
        "group_ended",
        (2,),
        2000,
    )


def test_state_is_plain_and_continues() -> None:
    life, twin = Life(), Life()
    life.step((1, 2), (4, 5))
    life.step((1, 2, 3), splitting=[(4, 5)])
    twin.book.restore(json.loads(json.dumps(life.book.state())))
    twin.frame = life.frame
    assert life.step((1, 2), (4, 5)) == twin.step((1, 2), (4, 5))
    assert life.book.state() == twin.book.state()
