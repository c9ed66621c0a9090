"""The five cases of SHELLS 2.3, row by row, and the rules that fill its silent places."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from reasoning.relations import (
    Objects,
    RelationBook,
    RelationName,
    RelationParameters,
    resolve,
    same_blob,
)

MS = 1_000_000


@pytest.mark.parametrize(
    ("before", "meets", "one_blob", "after", "case"),
    [
        ("INDEPENDENT", False, False, "INDEPENDENT", "I"),
        ("INDEPENDENT", False, True, "INDEPENDENT", "I"),
        ("INDEPENDENT", True, False, "INTERACTION", "II"),
        ("INDEPENDENT", True, True, "INTERACTION", "II"),
        ("INTERACTION", True, True, "JOINT", "III"),
        ("INTERACTION", True, False, "INTERACTION", "kept"),
        ("JOINT", True, False, "INTERACTION", "IV"),
        ("JOINT", True, True, "JOINT", "kept"),
        ("INTERACTION", False, False, "INDEPENDENT", "V"),
        ("INTERACTION", False, True, "INDEPENDENT", "V"),
        ("JOINT", False, False, "INTERACTION", "torn"),
        ("JOINT", False, True, "INTERACTION", "torn"),
    ],
)
def test_every_row_of_the_table(
    before: RelationName, meets: bool, one_blob: bool, after: str, case: str
) -> None:
    step = resolve(before, meets, one_blob)
    assert (step.after, step.case) == (after, case)
    assert {before, after} != {"INDEPENDENT", "JOINT"}
    assert step.rule.startswith("SHELLS 2.3")


@pytest.mark.parametrize(
    ("i", "j", "expected"),
    [
        ((3, True), (3, True), True),
        ((3, True), (4, True), False),
        ((3, True), (-1, True), False),
        ((-1, True), (-1, True), False),
        ((3, True), (-1, False), None),
        ((-1, False), (3, True), None),
        ((-1, False), (-1, False), False),
        ((3, False), (3, True), True),
        ((4, False), (3, True), None),
        ((3, False), (3, False), False),
    ],
)
def test_same_blob(i: tuple[int, bool], j: tuple[int, bool], expected: bool | None) -> None:
    assert same_blob(*i, *j) is expected


class Line:
    """Objects on a line with shells of radius 10, fed frame by frame at 10 frames/s."""

    def __init__(self, **parameters: Any) -> None:
        self.book = RelationBook(RelationParameters(**parameters))
        self.frame = -1

    def step(
        self,
        places: Mapping[int, float],
        blobs: dict[int, int] | None = None,
        seen: dict[int, bool] | None = None,
        starts: dict[int, bool] | None = None,
        leaving: tuple[int, ...] = (),
    ) -> list[tuple[int, int, str, str]]:
        self.frame += 1
        ids = sorted(places)
        blobs, seen, starts = blobs or {}, seen or {}, starts or {}
        objects = Objects(
            ids,
            np.array([[places[i], 0.0] for i in ids]).reshape(-1, 2),
            np.full(len(ids), 10.0),
            [blobs.get(i, i) for i in ids],
            [seen.get(i, True) for i in ids],
            [starts.get(i, True) for i in ids],
            leaving,
        )
        return [
            (c.a, c.b, c.after, c.case)
            for c in self.book.step(self.frame, self.frame * 100 * MS, objects)
        ]


def test_meeting_merging_splitting_and_parting() -> None:
    line = Line()
    assert line.step({1: 0, 2: 30}) == []
    assert line.step({1: 0, 2: 20}) == [(1, 2, "INTERACTION", "II")]
    assert line.step({1: 0, 2: 10}) == []
    assert line.step({1: 0, 2: 5}, {1: 7, 2: 7}) == [(1, 2, "JOINT", "III")]
    assert line.step({1: 0, 2: 5}, {1: 7, 2: 7}) == []
    assert line.step({1: 0, 2: 15}) == [(1, 2, "INTERACTION", "IV")]
    assert line.step({1: 0, 2: 21}) == [(1, 2, "INDEPENDENT", "V")]
    assert line.book.edges == []


def test_shells_that_touch_in_one_point_meet() -> None:
    line = Line()
    assert line.step({1: 0, 2: np.nextafter(20.0, 21.0)}) == []
    assert line.step({1: 0, 2: 20.0}) == [(1, 2, "INTERACTION", "II")]


def test_same_blob_while_independent_goes_through_interaction() -> None:
    line = Line()
    assert line.step({1: 0, 2: 5}, {1: 7, 2: 7}) == [(1, 2, "INTERACTION", "II")]
    assert line.step({1: 0, 2: 5}, {1: 7, 2: 7}) == [(1, 2, "JOINT", "III")]


def test_joint_with_disjoint_shells_is_an_anomaly_and_takes_two_frames_to_end() -> None:
    line = Line()
    line.step({1: 0, 2: 5}, {1: 7, 2: 7})
    line.step({1: 0, 2: 5}, {1: 7, 2: 7})
    assert line.step({1: 0, 2: 300}, {1: 7, 2: 8}) == [(1, 2, "INTERACTION", "torn")]
    assert line.step({1: 0, 2: 300}, {1: 7, 2: 8}) == [(1, 2, "INDEPENDENT", "V")]


def test_lists_are_symmetric_and_hold_several_relations() -> None:
    line = Line()
    line.step({1: 0, 2: 5, 3: 18, 4: 200}, {1: 7, 2: 7})
    line.step({1: 0, 2: 5, 3: 18, 4: 200}, {1: 7, 2: 7})
    book = line.book
    assert book.of(1) == [(2, "JOINT"), (3, "INTERACTION")]
    assert book.of(2) == [(1, "JOINT"), (3, "INTERACTION")]
    assert book.of(3) == [(1, "INTERACTION"), (2, "INTERACTION")]
    assert book.of(4) == []
    assert book.state_of(2, 1) == book.state_of(1, 2) == "JOINT"
    assert book.state_of(1, 4) == "INDEPENDENT"


def test_one_who_disappears_ends_every_relation_and_is_named() -> None:
    line = Line()
    line.step({1: 0, 2: 5, 3: 18})
    line.frame += 1
    objects = Objects(
        [1, 3],
        np.array([[0.0, 0], [18, 0]]),
        np.array([10.0, 10]),
        [1, 3],
        [True] * 2,
        [True] * 2,
    )
    changes = line.book.step(line.frame, line.frame * 100 * MS, objects)
    assert [(c.a, c.b, c.after, c.case, c.gone) for c in changes] == [
        (1, 2, "INDEPENDENT", "gone", (2,)),
        (2, 3, "INDEPENDENT", "gone", (2,)),
    ]
    assert "disappears" in changes[0].rule
    assert line.book.of(1) == [(3, "INTERACTION")]


def test_hidden_by_the_other_stays_joint_while_the_shells_meet() -> None:
    line = Line()
    line.step({1: 0, 2: 5}, {1: 7, 2: 7})
    line.step({1: 0, 2: 5}, {1: 7, 2: 7})
    assert line.step({1: 0, 2: 5}, {1: 7, 2: -1}, seen={2: False}) == []
    assert line.step({1: 0, 2: 5}, {1: -1, 2: -1}, seen={1: False, 2: False}) == [
        (1, 2, "INTERACTION", "unseen")
    ]


def test_hidden_does_not_make_joint() -> None:
    line = Line()
    line.step({1: 0, 2: 5})
    assert line.step({1: 0, 2: 5}, {1: 7, 2: -1}, seen={2: False}) == []


def test_a_leaving_object_cannot_stay_joint() -> None:
    line = Line(blob_duration_s=5.0)
    line.step({1: 0, 2: 5}, {1: 7, 2: 7})
    for _ in range(60):
        line.step({1: 0, 2: 5}, {1: 7, 2: 7})
    assert line.book.state_of(1, 2) == "JOINT"
    assert line.step({1: 0, 2: 5}, {1: 7, 2: -1}, seen={2: False}, leaving=(2,)) == [
        (1, 2, "INTERACTION", "unseen")
    ]


def test_one_who_is_not_in_the_picture_starts_nothing_and_keeps_what_it_has() -> None:
    line = Line()
    assert line.step({1: 0, 2: 5}, starts={2: False}) == []
    assert line.step({1: 0, 2: 5}) == [(1, 2, "INTERACTION", "II")]
    assert line.step({1: 0, 2: 5}, starts={2: False}) == []
    assert line.book.state_of(1, 2) == "INTERACTION"


def test_two_thresholds_damp_flicker() -> None:
    line = Line(enter_margin=0.2, leave_margin=0.2)
    assert line.step({1: 0, 2: 19}) == []
    assert line.step({1: 0, 2: 18}) == [(1, 2, "INTERACTION", "II")]
    assert line.step({1: 0, 2: 22}) == []
    assert line.step({1: 0, 2: 22.5}) == [(1, 2, "INDEPENDENT", "V")]


def test_durations_damp_flicker() -> None:
    line = Line(enter_duration_s=0.2, leave_duration_s=0.2, blob_duration_s=0.1)
    assert line.step({1: 0, 2: 9}) == []
    assert line.step({1: 0, 2: 9}) == []
    assert line.step({1: 0, 2: 9}) == [(1, 2, "INTERACTION", "II")]
    one = {1: 7, 2: 7}
    assert line.step({1: 0, 2: 9}, one) == []
    assert line.step({1: 0, 2: 9}) == []  # one blob for one frame alone does not join
    assert line.step({1: 0, 2: 9}, one) == []
    assert line.step({1: 0, 2: 9}, one) == [(1, 2, "JOINT", "III")]
    assert line.step({1: 0, 2: 9}) == []
    assert line.step({1: 0, 2: 9}) == [(1, 2, "INTERACTION", "IV")]
    assert line.step({1: 0, 2: 90}) == []
    assert line.step({1: 0, 2: 90}) == []
    assert line.step({1: 0, 2: 90}) == [(1, 2, "INDEPENDENT", "V")]


def test_an_interrupted_meeting_starts_over() -> None:
    line = Line(enter_duration_s=0.2)
    line.step({1: 0, 2: 9})
    line.step({1: 0, 2: 99})
    assert [line.step({1: 0, 2: 9}) for _ in range(3)] == [
        [],
        [],
        [(1, 2, "INTERACTION", "II")],
    ]


def test_edges_know_since_when_and_by_which_rule() -> None:
    line = Line()
    for place in (30, 15, 15):
        line.step({1: 0, 2: place})
    edge = line.book.get(2, 1)
    assert edge is not None
    assert (edge.since_frame, edge.since_ns, edge.rule, edge.gap) == (
        1,
        100 * MS,
        "SHELLS 2.3 case II",
        -5.0,
    )


def test_state_is_plain_and_continues() -> None:
    line, twin = (
        Line(enter_duration_s=0.1, blob_duration_s=0.1),
        Line(enter_duration_s=0.1, blob_duration_s=0.1),
    )
    frames = [{1: 0, 2: 9, 3: 19}, {1: 0, 2: 9, 3: 60}, {1: 0, 2: 9, 3: 15}]
    for places in frames:
        line.step(places, {1: 7, 2: 7})
    twin.book.restore(json.loads(json.dumps(line.book.state())))
    twin.frame = line.frame
    for places in frames:
        assert line.step(places, {1: 7, 2: 7}) == twin.step(places, {1: 7, 2: 7})
        assert line.book.state() == twin.book.state()
