"""The ready questions on a small story whose answers are known, and what they say when asked
wrongly.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from reasoning.questions import Case
from reasoning.questions.explain import explain
from reasoning.questions.index import build_index
from reasoning.questions.literals import Moment, duration, identity, moment, only
from reasoning.questions.name_checks import check_moment
from reasoning.questions.patterns import plan
from reasoning.questions.ready_questions import QUESTIONS, Options, question
from recorders.errors import UsageError


@pytest.fixture(scope="module")
def case(meeting_log: Path) -> Iterator[Case]:
    with Case([meeting_log]) as c:
        yield c


def ask(case: Case, name: str, *words: str, **options: Any) -> list[dict]:
    answer = case.sql(question(name).sql(words, Options(**options)))
    return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]


def test_met(case: Case) -> None:
    (row,) = ask(case, "met", "1")
    assert (row["other"], row["start_frame"], row["end_frame"], row["joint_s"]) == (
        2,
        40,
        179,
        1.96,
    )
    assert row["explain"] == "relation:1-2@40"
    assert [r["other"] for r in ask(case, "met", "2")] == [1, 3]
    assert [r["start_frame"] for r in ask(case, "met", "3", "2")] == [170]
    assert ask(case, "met", "1", "4") == []
    assert ask(case, "met", "1", recordings=only("elsewhere")) == []


def test_together(case: Case) -> None:
    (row,) = ask(case, "together", "2", "1")
    assert (row["a"], row["b"], row["kind"]) == (1, 2, "meeting")
    assert row["confidence"] > 0


def test_together_with_anybody_names_the_company(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    """Three walk abreast, the fourth far off; and who leaves with whom."""
    places = {
        k: (0, 199 if k < 3 else 249, (x, 100.0, 30.0, 80.0), (0.5, 0.0))
        for k, x in ((1, 100.0), (2, 145.0), (3, 190.0), (4, 400.0))
    }
    exits: list[Any] = [("exited", [k], 199, [], {}) for k in (1, 2)]
    near = [(1, 2, "INTERACTION", 0, 199), (2, 3, "INTERACTION", 0, 199)]
    story = story_type(250, places, relations=near, events=exits)
    with Case([write_story(story, tmp_path / "three.mcap")]) as c:
        rows = {(r["a"], r["b"]): r["company"] for r in ask(c, "together", "2")}
        assert rows == {(1, 2): [3], (2, 3): [1]}
        assert all(2 in r["company"] for r in ask(c, "together", "1") if r["b"] == 3)
        assert ask(c, "together", "4") == []
        (left,) = ask(c, "left-with", "1")
        (met,) = ask(c, "together", "1", "2")
        assert left["other"] == 2
        assert left["certainty"] == min(met["certainty"], met["confidence"]) > 0.5


def test_left_with(case: Case) -> None:
    (row,) = ask(case, "left-with", "2", within_s=5.0, gap_s=5.0)
    assert (row["other"], row["track_left_t"], row["other_left_t"]) == (3, 10.0, 11.2)
    assert ask(case, "left-with", "2", within_s=1.0, gap_s=5.0) == []
    assert ask(case, "left-with", "2", within_s=5.0) == []
    assert ask(case, "left-with", "1") == []


@pytest.mark.parametrize("deep", [False, True])
def test_who_only_touch_in_the_picture_hardly_met(
    tmp_path: Path,
    story_type: type[Any],
    write_story: Callable[..., Any],
    deep: bool,
) -> None:
    """People are drawn smaller the higher up they stand; two of one row are near one another, two
    who stand one above the other are not.
    """
    rows = {k: (100.0 + 40.0 * k, 40.0 + 30.0 * k) for k in range(8)}  # feet, height
    places = {
        k: (0, 60, (30.0 * k, foot - high, high / 2, high), (0.0, 0.0))
        for k, (foot, high) in rows.items()
    }
    foot, high = rows[0 if deep else 2]
    x = 60.0 if deep else 95.0
    places[9] = (0, 60, (x, foot - high, high / 2, high), (0.0, 0.0))
    story = story_type(61, places, relations=[(2, 9, "INTERACTION", 0, 60)])
    with Case([write_story(story, tmp_path / "deep.mcap")]) as c:
        (row,) = ask(c, "met", "2")
    assert (row["certainty"] < 0.5) == deep, row


@pytest.mark.parametrize(("drawn_apart", "told"), [(0.0, False), (1.0, True)])
def test_who_was_never_seen_apart_from_another_may_be_him(
    tmp_path: Path,
    story_type: type[Any],
    write_story: Callable[..., Any],
    drawn_apart: float,
    told: bool,
) -> None:
    places = {
        1: (0, 60, (100.0, 50.0, 20.0, 40.0), (1.0, 0.0)),
        2: (30, 60, (133.0, 52.0, 20.0, 40.0), (1.0 + drawn_apart, 0.0)),
    }
    story = story_type(61, places, relations=[(1, 2, "INTERACTION", 30, 60)])
    with Case([write_story(story, tmp_path / "one.mcap")]) as c:
        (row,) = ask(c, "met", "1")
        assert (row["certainty"] > 0.5) == told, row
        assert (row["nearest"] is not None) == told


@pytest.mark.parametrize(("step", "sure"), [(0.0, 0.4), (1.0, 0.9)])
def test_who_is_found_standing_did_not_come_in_then(
    tmp_path: Path,
    story_type: type[Any],
    write_story: Callable[..., Any],
    step: float,
    sure: float,
) -> None:
    places = {1: (30, 99, (100.0, 50.0, 10.0, 20.0), (step, 0.0))}
    story = story_type(100, places, events=[("entered", [1], 31, [], {})])
    with Case([write_story(story, tmp_path / "standing.mcap")]) as c:
        (row,) = ask(c, "entered-never-left")
    assert row["certainty"] == pytest.approx(sure)


@pytest.mark.parametrize("beside", [1, 2])
def test_who_comes_up_beside_somebody_came_in_with_him_if_he_did(
    tmp_path: Path,
    story_type: type[Any],
    write_story: Callable[..., Any],
    beside: int,
) -> None:
    """The first was there from the start, the second came in; the third comes up beside one."""
    places = {
        1: (0, 99, (100.0, 50.0, 10.0, 20.0), (0.0, 0.0)),
        2: (30, 99, (200.0, 50.0, 10.0, 20.0), (1.0, 0.0)),
        3: (50, 99, (12.0 + 100.0 * beside, 50.0, 10.0, 20.0), (1.0, 0.0)),
    }
    story = story_type(
        100, places,
        relations=[(beside, 3, "JOINT", 50, 99)],
        events=[("entered", [2], 31, [], {})],
    )  # fmt: skip
    with Case([write_story(story, tmp_path / "beside.mcap")]) as c:
        sure = {r["track"]: r["certainty"] for r in ask(c, "entered-never-left")}
    assert sure == {2: pytest.approx(0.9), 3: 0.4 if beside == 1 else 0.6}


@pytest.mark.parametrize(("step", "leave"), [(2.0, True), (-2.0, False)])
def test_who_pass_and_leave_on_opposite_sides_do_not_leave_together(
    tmp_path: Path,
    story_type: type[Any],
    write_story: Callable[..., Any],
    step: float,
    leave: bool,
) -> None:
    """Both go on from where they met: the second with the first, or the other way."""
    places = {
        1: (0, 30, (100.0, 50.0, 10.0, 20.0), (2.0, 0.0)),
        2: (0, 32, (112.0, 50.0, 10.0, 20.0), (step, 0.0)),
    }
    story = story_type(
        40, places,
        relations=[(1, 2, "INTERACTION", 0, 24)],
        events=[("exited", [1], 31, [], {}), ("exited", [2], 33, [], {})],
    )  # fmt: skip
    with Case([write_story(story, tmp_path / "passing.mcap")]) as c:
        found = ask(c, "left-with", "1")
    assert [r["other"] for r in found] == ([2] if leave else [])


def test_who_was_in(case: Case) -> None:
    assert [
        r["track"] for r in ask(case, "who-was-in", "bench", at=moment("frame:170"))
    ] == [3, 4]
    assert [r["track"] for r in ask(case, "who-was-in", "bench", at=moment("2.5"))] == [3]
    assert [
        r["track"]
        for r in ask(case, "who-was-in", "scene", at=moment("2023-11-14T22:13:20.1Z"))
    ] == [1]
    assert ask(case, "who-was-in", "nowhere' OR '1'='1", at=moment("2.5")) == []


@pytest.mark.parametrize("indexed", [False, True], ids=["logs", "an index"])
def test_a_wall_time_is_asked_of_every_recording_by_its_own_clock(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any], indexed: bool
) -> None:
    boxes = ((9.0, 9.0, 9.0, 9.0), (0.0, 0.0))
    shared = {
        "relations": [(1, 2, "JOINT", 60, 90)],
        "zones": [(1, "bench", 40, 99), (2, "bench", 0, 39)],
    }
    # The second camera's clock was started two seconds after the first one's.
    logs = [
        write_story(
            story_type(
                100,
                {1: (0, 99, *boxes), 2: (0, 99, *boxes)},
                start_ns=1_700_000_000_000_000_000 + late,
                **shared,
            ),
            tmp_path / f"{name}.mcap",
        )
        for name, late in (("gate", 0), ("yard", 2_000_000_000))
    ]
    if indexed:
        build_index(logs, tmp_path / "case.duckdb")
    at = moment("2023-11-14T22:13:22.5Z")
    with Case([tmp_path / "case.duckdb"] if indexed else logs) as case:
        check_moment(case, at, None)
        there = [
            (r["recording"], r["track"]) for r in ask(case, "who-was-in", "bench", at=at)
        ]
        assert there == [("gate", 1), ("yard", 2)]
        assert (
            ask(case, "who-was-in", "bench", at=at, recordings=only("yard"))[0]["track"]
            == 2
        )
        reached = [
            (r["recording"], round(r["reached_t"], 3))
            for r in ask(case, "contacts", "1", at=at, depth=2)
        ]
        assert reached == [("gate", 2.5), ("yard", 2.4)]


def test_loitered(case: Case) -> None:
    assert [r["track"] for r in ask(case, "loitered", "bench", least_s=1.0)] == [3, 4]
    assert [r["track"] for r in ask(case, "loitered", "bench", least_s=5.0)] == [3]
    assert ask(case, "loitered", "bench") == []
    assert [r["track"] for r in ask(case, "loitered", "scene", least_s=11.9)] == [1]


def test_loitering_closes_gaps(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    story = story_type(100, {1: (0, 99, (9.0, 9.0, 9.0, 9.0), (0.0, 0.0))},
                       zones=[(1, "door", 0, 39), (1, "door", 50, 99)])  # fmt: skip
    with Case([write_story(story, tmp_path / "gap.mcap")]) as c:
        assert [
            (r["start_frame"], r["end_frame"])
            for r in ask(c, "loitered", "door", least_s=3.0)
        ] == [(0, 99)]
        assert ask(c, "loitered", "door", least_s=3.0, gap_s=0.1) == []


def test_entered_never_left(case: Case) -> None:
    # Target 1 is there in the first frame: it did not come in. 2 and 3 left.
    assert [
        (r["track"], r["there_at_the_end"]) for r in ask(case, "entered-never-left")
    ] == [(4, True)]


def test_who_left_and_came_in_again_is_there(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    here = (9.0, 9.0, 5.0, 9.0)
    story = story_type(60, {1: (0, 59, here, (0.0, 0.0)), 2: (3, 59, here, (0.0, 0.0)), 3: (3, 59, here, (0.0, 0.0))},
                       events=[("entering", [1], 0, [], {}), ("exited", [1], 20, [], {}), ("entering", [1], 30, [], {}),
                               ("entering", [2], 3, [], {}), ("exited", [2], 40, [], {}),
                               ("entering", [3], 3, [], {})])  # fmt: skip
    with Case([write_story(story, tmp_path / "again.mcap")]) as c:
        found = [(r["track"], r["entered_frame"]) for r in ask(c, "entered-never-left")]
        assert found == [(3, 3), (1, 30)]


def test_who_turns_up_wholly_inside_was_not_seen_to_come_in(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    tracks = {i: (50, 199, (100.0 * i, 100.0, 30.0, 80.0), (0.5, 0.0)) for i in (1, 2)}
    tracks[3] = (180, 199, (300.0, 100.0, 30.0, 80.0), (0.5, 0.0))  # nobody can tell
    events: list[Any] = [("entering", [1], 50, [], {}), ("entering", [2], 50, [], {}),
              ("entered", [1], 51, [], {}), ("entered", [2], 60, [], {}),
              ("entering", [3], 180, [], {}), ("entered", [3], 181, [], {})]  # fmt: skip
    path = write_story(story_type(200, tracks, events=events), tmp_path / "inside.mcap")
    with Case([path]) as c:
        told = {r["track"]: r["certainty"] for r in ask(c, "entered-never-left")}
    assert told == {1: 0.6, 2: 0.9, 3: 0.4}


def test_hidden(case: Case) -> None:
    hers = [
        (r["part"], r["start_frame"], r["end_frame"], r["seconds"])
        for r in ask(case, "hidden", "2")
    ]
    assert hers == [
        ("left_legs", 110, 120, 0.4),
        ("head", 111, 111, 0.0),
        ("left_legs", 130, 131, 0.04),
    ]
    assert [r["track"] for r in ask(case, "hidden")] == [2, 2, 2, 3]
    assert ask(case, "hidden", "1") == []


def test_a_part_is_surely_hidden_only_behind_somebody_or_beyond_the_edge(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    story = story_type(
        30,
        {
            1: (0, 29, (100.0, 100.0, 30.0, 80.0), (0.0, 0.0)),
            2: (0, 29, (85.0, 110.0, 30.0, 80.0), (0.0, 0.0)),
            3: (0, 29, (620.0, 100.0, 40.0, 80.0), (0.0, 0.0)),
        },
        hidden=[(1, "left_legs", 5, 20), (1, "right_legs", 5, 20), (2, "right_legs", 5, 20),
                (3, "right_torso", 5, 20), (3, "left_torso", 5, 20)],
    )  # fmt: skip
    with Case([write_story(story, tmp_path / "behind.mcap")]) as c:
        rows = {(r["track"], r["part"]): r for r in ask(c, "hidden")}
    sure = {key: r["behind"] for key, r in rows.items() if r["certainty"] > 0.5}
    assert sure == {(1, "left_legs"): [2], (3, "right_torso"): []}
    assert rows[1, "right_legs"]["certainty"] == rows[2, "right_legs"]["certainty"] == 0.4


def test_who_drives_beside_somebody_does_not_join_him(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    """3 drives ahead; 1 and 2 fall back, side by side, or 2 closes in on 1."""
    bits = [(1, "grouping", [2], 50, 80), (1, "splitting", [3], 50, 80)]
    told = {}
    for name, speed in (("beside", 1.0), ("closes in", 0.2)):
        tracks = {
            1: (0, 120, (100.0, 100.0, 30.0, 80.0), (1.0, 0.0)),
            2: (
                0,
                120,
                (160.0 if speed == 1.0 else 210.0, 100.0, 30.0, 80.0),
                (speed, 0.0),
            ),
            3: (0, 120, (60.0, 100.0, 30.0, 80.0), (3.0, 0.0)),
        }
        path = write_story(story_type(121, tracks, bits=bits), tmp_path / f"{name}.mcap")
        with Case([path]) as c:
            (row,) = ask(c, "grouping-and-splitting")
            told[name] = row["certainty"]
    assert told["beside"] == 0.4
    assert told["closes in"] > 0.6


def test_nobody_is_surely_first_seen_in_the_middle_of_the_picture(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    box = (300.0, 200.0, 30.0, 80.0)
    story = story_type(
        200,
        {
            1: (50, 150, (0.0, 200.0, 30.0, 80.0), (2.0, 0.0)),
            2: (50, 199, box, (1.0, 0.0)),
            3: (50, 150, box, (0.0, 0.0)),
            4: (50, 150, box, (1.0, 0.0)),
        },
        events=[("entering", [i], 50, [], {}) for i in (1, 2, 3)] + [("exited", [1], 150, [], {})],
    )  # fmt: skip
    with Case([write_story(story, tmp_path / "ends.mcap")]) as c:
        ends = {
            i: [r["certainty"] for r in ask(c, "first-last", str(i))] for i in story.tracks
        }
    # At the edge, and gone over it; hidden until then, and there at the end; stood there; came out of a group.
    assert ends == {1: [0.9, 0.9], 2: [0.6, 0.9], 3: [0.4, 0.4], 4: [0.4, 0.4]}


def test_grouping_and_splitting(case: Case) -> None:
    (row,) = ask(case, "grouping-and-splitting")
    assert (row["track"], row["start_frame"], row["end_frame"]) == (2, 170, 179)
    assert (row["grouping_with"], row["splitting_from"]) == ([3], [1])


def test_group_history(case: Case) -> None:
    assert [(r["is"], r["group_id"]) for r in ask(case, "group-history", "3")] == [
        ("ancestor", 2),
        ("itself", 3),
    ]
    assert [(r["is"], r["group_id"]) for r in ask(case, "group-history", "2")] == [
        ("itself", 2),
        ("descendant", 3),
    ]
    assert ask(case, "group-history", "99") == []


def test_a_history_that_bites_its_tail_ends(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    box = (9.0, 9.0, 9.0, 9.0)
    story = story_type(30, {1: (0, 29, box, (0.0, 0.0)), 2: (0, 29, box, (0.0, 0.0))},
                       groups=[(1, [1, 2], 0, 9, [2]), (2, [1, 2], 10, 19, [1])])  # fmt: skip
    with Case([write_story(story, tmp_path / "loop.mcap")]) as c:
        assert {r["group_id"] for r in ask(c, "group-history", "1")} == {1, 2}


def test_before(case: Case) -> None:
    rows = ask(case, "before", "9", within_s=60.0)
    assert {(r["subject"], r["other"]) for r in rows} >= {(2, 3), (3, 4), (4, 3), (2, 1)}
    assert all(r["until_t"] <= 9.64 for r in rows)
    near = ask(case, "before", "event:9", within_s=0.5)
    assert all(r["seconds_before"] <= 0.5 for r in near)
    assert len(near) < len(rows)


def test_contacts(case: Case) -> None:
    rows = ask(case, "contacts", "1")
    assert [(r["track"], r["contacts"], r["via"]) for r in rows] == [
        (2, 1, [1]),
        (3, 2, [1, 2]),
        (4, 3, [1, 2, 3]),
    ]
    assert [r["track"] for r in ask(case, "contacts", "1", depth=2)] == [2, 3]
    # Back in time nothing passes on: 4 meets 3 after 3 met 2, and 2 is no longer near then.
    assert [r["track"] for r in ask(case, "contacts", "4", at=moment("frame:205"))] == [3]
    assert [r["track"] for r in ask(case, "contacts", "1", by="joint")] == [2]
    assert [r["track"] for r in ask(case, "contacts", "1", by="groups")] == [2, 3, 4]
    assert ask(case, "contacts", "1", by="encounters")[0]["track"] == 2


def test_timeline(case: Case) -> None:
    rows = ask(case, "timeline", "2")
    assert [(r["start_t"], r["what"], r["others"]) for r in rows if not r["what"].startswith("together")] == [
        (0.4, "present", []), (0.8, "event entered", []), (1.6, "INTERACTION", [1]),
        (1.6, "event interaction_started", [1]), (4.0, "JOINT", [1]), (4.0, "group 1", [1]),
        (4.0, "event group_formed", [1]), (4.0, "event joined", [1]), (6.0, "INTERACTION", [1]),
        (6.0, "event group_ended", [1]), (6.8, "INTERACTION", [3]), (8.04, "group 3", [3, 4]),
        (8.04, "event group_changed", [3, 4]), (9.64, "event group_ended", [3, 4]), (10.0, "event exited", []),
    ]  # fmt: skip


def test_every_row_can_be_explained(case: Case) -> None:
    asked: list[tuple[str, list[str], dict[str, Any]]] = [
        ("met", ["1"], {}), ("together", ["1", "2"], {}), ("left-with", ["2"], {"within_s": 5.0, "gap_s": 5.0}),
        ("who-was-in", ["bench"], {"at": moment("7")}), ("loitered", ["bench"], {"least_s": 1.0}),
        ("entered-never-left", [], {}), ("grouping-and-splitting", [], {}), ("group-history", ["3"], {}),
        ("before", ["9"], {}), ("contacts", ["1"], {}), ("hidden", [], {}), ("timeline", ["2"], {}),
        ("timeline", ["3"], {}), ("first-last", ["1"], {}), ("between", ["1", "5"], {}), ("dwell", ["bench"], {}),
    ]  # fmt: skip
    # Metres, drawn lines, things that are left and who follows whom have stories of their own; a count's
    # row may be of a time in which nobody came, of which there is nothing to explain.
    elsewhere = {
        "apart",
        "count",
        "crossed",
        "followed",
        "heatmap",
        "left",
        "moved",
        "took",
    }
    assert {name for name, _, _ in asked} == set(QUESTIONS) - elsewhere
    for name, words, options in asked:
        rows = ask(case, name, *words, **options)
        assert rows, name
        for row in rows:
            told = [explain(case, reference) for reference in row["explain"].split()]
            assert told
            for found in told:
                assert found.rule
                assert str(found.subjects[0]) in found.text
                assert found.lines()[0].startswith(found.reference)
            # They are about this row: its targets, at its time.
            ids = {row[k] for k in ("track", "other", "subject", "a", "b") if k in row}
            assert ids <= {i for found in told for i in found.subjects}, (name, row)
            if "start_frame" in row:
                assert any(
                    found.start_frame <= row["end_frame"]
                    and row["start_frame"] <= found.end_frame
                    for found in told
                )
            if "start_t" in row and "end_t" in row:
                assert any(
                    found.start_t <= row["end_t"] and row["start_t"] <= found.end_t
                    for found in told
                )


@pytest.mark.parametrize(
    ("name", "words", "options", "said"),
    [
        ("met", [], {}, "0 arguments"),
        ("met", ["1", "2", "3"], {}, "3 arguments"),
        ("met", ["one"], {}, "id 'one'"),
        ("met", ["1 OR 1=1"], {}, "id '1 OR 1=1'"),
        ("met", ["99999999999"], {}, "id '99999999999'"),
        ("together", ["1", "1"], {}, "two different"),
        ("who-was-in", ["bench"], {}, "give --at"),
        ("contacts", ["1"], {"depth": 0}, "--depth 0"),
        ("contacts", ["1"], {"by": "mail"}, "--by mail"),
    ],
)
def test_wrong_questions(name: str, words: list[str], options: dict, said: str) -> None:
    with pytest.raises(UsageError, match=said):
        question(name).sql(words, Options(**options))


def test_unknown_question_names_the_known() -> None:
    with pytest.raises(UsageError, match="grouping-and-splitting"):
        question("whodunnit")


def test_values() -> None:
    assert [duration(t) for t in ("30", "30s", "500ms", "2min", "1.5h", ".5")] == [
        30,
        30,
        0.5,
        120,
        5400,
        0.5,
    ]
    for bad in ("", "s", "3 days", "-1", "1e9", "99999999999"):
        with pytest.raises(UsageError, match="duration"):
            duration(bad)
    assert moment("frame:12") == Moment(frame=12)
    assert moment("12.5s") == Moment(seconds=12.5)
    assert moment("2026-01-31T12:00:00.25+01:00") == Moment(since_ns=1769857200250000000)
    for bad in ("noon", "2026-01-31T12:00:00", "frame:x"):
        with pytest.raises(UsageError, match="time"):
            moment(bad)
    assert identity("12") == 12


def test_explain_says_what_it_takes(case: Case) -> None:
    with pytest.raises(UsageError, match="relation:1-2@40"):
        explain(case, "because")
    with pytest.raises(UsageError, match="event:999: there is none"):
        explain(case, "999")


SEVENTHS = 142_857_143


@pytest.fixture(scope="module")
def sevenths(
    tmp_path_factory: pytest.TempPathFactory,
    story_type: type[Any],
    write_story: Callable[..., Any],
) -> Iterator[Case]:
    """Seven frames a second, so that no time has few digits: 1 and 2 meet and leave, 2 three
    frames after 1.
    """
    places = {
        i: (20 if i == 2 else 0, 59, (200.0 + 9.0 * i, 9.0, 5.0, 9.0), (0.0, 0.0))
        for i in (1, 2, 3)
    }
    story = story_type(
        60, places,
        relations=[(1, 2, "INTERACTION", 24, 30)],
        events=[("exited", [1], 37, [], {}), ("exited", [2], 40, [], {})],
        zones=[(2, "bench", 21, 24), (2, "bench", 27, 30)], frame_ns=SEVENTHS,
    )  # fmt: skip
    with Case(
        [write_story(story, tmp_path_factory.mktemp("ready") / "sevenths.mcap")]
    ) as c:
        yield c


def test_a_limit_that_a_row_shows_itself_lets_it_in(sevenths: Case) -> None:
    """Times are shown to the millisecond: 3/7 s is 0.429 s, 10/7 s is 1.429 s, 4/7 s is 0.571 s."""
    assert [
        r["seconds_after"] for r in ask(sevenths, "left-with", "1", within_s=9.0, gap_s=9.0)
    ] == [0.429]
    assert len(ask(sevenths, "left-with", "1", within_s=0.429, gap_s=9.0)) == 1
    assert ask(sevenths, "left-with", "1", within_s=0.428, gap_s=9.0) == []
    assert len(ask(sevenths, "left-with", "1", within_s=9.0, gap_s=1.0)) == 1
    assert ask(sevenths, "left-with", "1", within_s=9.0, gap_s=0.999) == []

    assert [r["seconds_before"] for r in ask(sevenths, "before", "2", within_s=9.0)] == [
        1.429
    ]
    assert len(ask(sevenths, "before", "2", within_s=1.429)) == len(
        ask(sevenths, "before", "2", within_s=9.0)
    )
    assert ask(sevenths, "before", "2", within_s=1.428) == []

    (whole,) = ask(sevenths, "loitered", "bench", least_s=1.0, gap_s=0.429)
    assert whole["seconds"] == 1.286
    assert len(ask(sevenths, "loitered", "bench", least_s=1.286, gap_s=0.429)) == 1
    assert ask(sevenths, "loitered", "bench", least_s=1.287, gap_s=0.429) == []
    assert ask(sevenths, "loitered", "bench", least_s=1.0, gap_s=0.428) == []


def test_a_moment_as_it_is_shown_is_within(sevenths: Case) -> None:
    """20/7 s is shown as 2.857 s, which is less."""
    assert [
        r["track"] for r in ask(sevenths, "who-was-in", "scene", at=moment("2.857"))
    ] == [1, 2, 3]
    assert [
        r["track"] for r in ask(sevenths, "who-was-in", "scene", at=moment("2.856"))
    ] == [1, 3]
    assert [
        r["track"] for r in ask(sevenths, "who-was-in", "bench", at=moment("4.286"))
    ] == [2]
    assert ask(sevenths, "who-was-in", "bench", at=moment("4.287")) == []


def test_a_pattern_keeps_to_the_millisecond(sevenths: Case) -> None:
    for limit, count in (("1s", 1), ("0.999s", 0)):
        assert len(sevenths.rows(plan(f"interaction(1,2) ; exited(1)[<={limit}]"))) == count
    for limit, count in (("0.857s", 1), ("0.858s", 0)):
        assert len(sevenths.rows(plan(f"interaction(1,2)[>={limit}]"))) == count
