"""Whole scenes from truth boxes: the exact sequence of events that each must give."""

from __future__ import annotations

from typing import Any

from reasoning.reasoner import Reasoner, SceneAnnotation
from recorders.messages import EVENT_KINDS, Regions, Target, Targets

WIDTH, HEIGHT, FRAME_NS = 640, 240, 100_000_000


def person(
    i: int, x: int, blob: int | None = None, y: float = 100.0, v: float = 0.0, **fields: Any
) -> Target:
    """A person of 20 x 50 whose left edge is at x; alone in a blob of its own unless told
    otherwise.
    """
    return Target(
        i,
        (float(x), y, 20.0, 50.0),
        (v, 0.0),
        blob=i + 100 if blob is None else blob,
        **fields,
    )


def story(
    frames: list[list[Target]],
    regions: Regions | None = None,
    scene_events: bool = False,
    life: bool = False,
) -> tuple[list[tuple[Any, ...]], Reasoner, SceneAnnotation]:
    """(frame, kind, subjects, group labels) of every event; the Reasoner as it is at the end, the
    last annotation.
    """
    reasoner = Reasoner({}, WIDTH, HEIGHT)
    told, last = list[tuple[Any, ...]](), None
    for k, targets in enumerate(frames):
        last = reasoner.step(k, k * FRAME_NS, Targets(k, targets), regions)
        for e in last.events:
            assert e.kind in EVENT_KINDS
            assert e.frame == k
            assert e.rule
            assert e.text.endswith(".")
            scene = e.rule.startswith(("EVENTS 3.2", "ours: named zones"))
            if (scene_events or not scene) and (life or e.rule != "EVENTS 2"):
                told.append(
                    (k, e.kind, e.subjects, e.groups)
                    if e.groups
                    else (k, e.kind, e.subjects)
                )
    assert reasoner.counter.forbidden == 0
    assert last is not None
    return told, reasoner, last


def test_pass_by_at_a_distance_gives_no_events() -> None:
    frames = [
        [person(1, 100 + 10 * f), person(2, 400 - 10 * f, y=20.0), person(3, 30)]
        for f in range(3)
    ]
    assert story(frames)[0] == []


def test_two_meet_merge_and_part() -> None:
    xs = [
        (100, 170),
        (110, 160),
        (116, 150),
        (122, 135),
        (126, 132),
        (120, 150),
        (100, 180),
    ]
    frames = [[person(1, a), person(2, b)] for a, b in xs]
    frames[3] = [person(1, 122, 7), person(2, 135, 7)]
    frames[4] = [person(1, 126, 7), person(2, 132, 7)]
    told, _, _ = story(frames)
    assert told == [
        (1, "interaction_started", [1, 2]),
        (2, "grouping", [1, 2]),
        (3, "joined", [1, 2]),
        (3, "grouped", [1, 2], [1]),
        (3, "group_formed", [1, 2], [1]),
        (5, "separated", [1, 2]),
        (5, "splitting", [1, 2], [1]),
        (6, "interaction_ended", [1, 2]),
        (6, "single", [1]),
        (6, "single", [2]),
        (6, "group_ended", [1, 2], [1]),
    ]


def test_three_way_one_leaves_as_another_joins() -> None:
    frames = [
        [person(1, 100), person(2, 118), person(3, 136), person(4, 300)],
        [person(1, 100, 7), person(2, 118, 7), person(3, 136, 7), person(4, 220)],
        [person(1, 100, 7), person(2, 118, 7), person(3, 136, 7), person(4, 170)],
        [person(1, 84), person(2, 118, 7), person(3, 136, 7), person(4, 154, 7)],
        [person(1, 20), person(2, 118, 7), person(3, 136, 7), person(4, 154, 7)],
    ]
    told, _, last = story(frames)
    assert told == [
        (0, "interaction_started", [1, 2]),
        (0, "interaction_started", [1, 3]),
        (0, "interaction_started", [2, 3]),
        (1, "joined", [1, 2]),
        (1, "joined", [1, 3]),
        (1, "joined", [2, 3]),
        (1, "grouped", [1, 2], [1]),
        (1, "grouped", [2, 3], [1]),
        (1, "group_formed", [1, 2, 3], [1]),
        (2, "interaction_started", [2, 4]),
        (2, "interaction_started", [3, 4]),
        (2, "grouping", [3, 4]),
        (3, "separated", [1, 2]),
        (3, "separated", [1, 3]),
        (3, "joined", [2, 4]),
        (3, "joined", [3, 4]),
        (3, "splitting", [1, 2], [1]),
        (3, "grouped", [3, 4], [2]),
        (3, "group_changed", [1, 2, 3, 4], [1, 2]),
        (4, "interaction_ended", [1, 2]),
        (4, "interaction_ended", [1, 3]),
        (4, "single", [1]),
    ]
    assert last.groups.groups[0].formed_from == [1]
    assert last.groups.groups[0].members == [2, 3, 4]


def test_enter_as_a_group_and_split() -> None:
    frames = [
        [person(1, 100)],
        [person(1, 100)],
        [person(1, 96), person(2, 122, newborn=True, born_of_split=True)],
        [person(1, 92), person(2, 126)],
        [person(1, 60), person(2, 150)],
    ]
    told, _, _ = story(frames, scene_events=True, life=True)
    assert told == [
        (0, "track_confirmed", [1]),
        (0, "entering", [1]),
        (1, "entered", [1]),
        (2, "track_confirmed", [2]),
        (2, "interaction_started", [1, 2]),
        (2, "splitting", [1, 2], [1]),
        (2, "group_entered_scene", [1, 2], [1]),
        (4, "interaction_ended", [1, 2]),
        (4, "single", [1]),
        (4, "single", [2]),
        (4, "group_ended", [1, 2], [1]),
    ]


def test_two_born_of_one_split_are_one_group() -> None:
    frames = [
        [person(1, 100)],
        [
            person(1, 100),
            person(2, 125, newborn=True, born_of_split=True),
            person(3, 75, newborn=True, born_of_split=True),
        ],
    ]
    told, _, last = story(frames)
    assert (1, "group_entered_scene", [1, 2, 3], [1]) in told
    assert [g.members for g in last.groups.groups] == [[1, 2, 3]]


def square(x0: float, y0: float, x1: float, y1: float) -> list[tuple[float, float]]:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]


REGIONS = Regions(
    WIDTH, HEIGHT, [square(60.0, 20.0, 580.0, 220.0)], [square(30.0, 5.0, 610.0, 235.0)]
)


def test_standing_on_the_regions_edge() -> None:
    frames = [[person(1, 55 + 8 * (f % 2))] for f in range(20)]
    told, _, _ = story(frames, REGIONS, scene_events=True, life=True)
    assert told == [(0, "track_confirmed", [1]), (0, "entering", [1]), (1, "entered", [1])]


def test_leave_and_return() -> None:
    xs = [100, 80, 45, 25, 12, 25, 45, 70, 80, 45, 25, 5]
    frames = [[person(1, x)] for x in xs]
    frames[4] = [
        person(1, 20, mode="appearance", confidence=0.6, observed=False, present=False)
    ]
    told, _, _ = story([*frames, []], REGIONS, scene_events=True, life=True)
    assert told == [
        (0, "track_confirmed", [1]),
        (0, "entering", [1]),
        (1, "entered", [1]),
        (3, "exiting", [1]),
        (4, "track_lost", [1]),
        (4, "mode_changed", [1]),
        (5, "track_recovered", [1]),
        (5, "mode_changed", [1]),
        (7, "returned", [1]),
        (10, "exiting", [1]),
        (11, "exited", [1]),
        (12, "track_removed", [1]),
    ]


def test_full_occlusion_keeps_the_pair_joined_until_both_are_seen_apart() -> None:
    frames = [
        [person(1, 100), person(2, 125)],
        [person(1, 105, 7), person(2, 118, 7)],
        [person(1, 110, 7), person(2, 112, -1, observed=False, mode="appearance")],
        [person(1, 115, 7), person(2, 110, -1, observed=False, mode="appearance")],
        [person(1, 126), person(2, 100)],
        [person(1, 170), person(2, 80)],
    ]
    told, _, _ = story(frames)
    assert told == [
        (0, "interaction_started", [1, 2]),
        (1, "joined", [1, 2]),
        (1, "grouped", [1, 2], [1]),
        (1, "group_formed", [1, 2], [1]),
        (4, "separated", [1, 2]),
        (4, "splitting", [1, 2], [1]),
        (5, "interaction_ended", [1, 2]),
        (5, "single", [1]),
        (5, "single", [2]),
        (5, "group_ended", [1, 2], [1]),
    ]


def test_one_of_a_group_disappears() -> None:
    frames = [
        [person(1, 100), person(2, 115)],
        [person(1, 100, 7), person(2, 115, 7)],
        [person(1, 100)],
        [person(1, 100)],
    ]
    told, _, last = story(frames, life=True)
    assert told[2:] == [
        (0, "interaction_started", [1, 2]),
        (1, "joined", [1, 2]),
        (1, "grouped", [1, 2], [1]),
        (1, "group_formed", [1, 2], [1]),
        (2, "track_removed", [2]),
        (2, "separated", [1, 2]),
        (2, "splitting", [1, 2], [1]),
        (3, "interaction_ended", [1, 2]),
        (3, "single", [1]),
        (3, "group_ended", [1, 2], [1]),
    ]
    assert [t.id for t in last.tracks.tracks] == [1]


def test_two_couples_meet_and_part_as_they_came() -> None:
    def at(a: int, b: int, c: int, d: int, *blobs: int) -> list[Target]:
        return [
            person(i, x, blob)
            for i, x, blob in zip((1, 2, 3, 4), (a, b, c, d), blobs, strict=True)
        ]

    frames = [
        at(100, 112, 300, 312, 1, 2, 3, 4),
        at(100, 112, 300, 312, 5, 5, 6, 6),
        at(180, 192, 207, 219, 5, 5, 5, 5),
        at(160, 172, 207, 219, 5, 5, 6, 6),
        at(100, 112, 300, 312, 5, 5, 6, 6),
    ]
    told = [t for t in story(frames)[0] if t[1].startswith("group_")]
    assert told == [
        (1, "group_formed", [1, 2], [1]),
        (1, "group_formed", [3, 4], [2]),
        (2, "group_changed", [1, 2, 3, 4], [1, 2, 3]),
        (3, "group_changed", [1, 2, 3, 4], [3, 4]),
        (3, "group_changed", [1, 2, 3, 4], [3, 5]),
    ]
