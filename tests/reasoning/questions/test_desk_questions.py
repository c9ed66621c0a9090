"""Lines and zones drawn after the fact, and what an investigator asks, against the generator's
truth: feet are the truth's, the boxes in the log are tight around what was painted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from fixtures.scenes import SCRIPTS, GeneratedScene
from fixtures.scripts import Script, walk
from reasoning.geometry import Area
from reasoning.questions import Case
from reasoning.questions.drawn import Drawn, DrawnZone, drawn
from reasoning.questions.explain import explain
from reasoning.questions.literals import Moment, moment
from reasoning.questions.name_checks import check_words
from reasoning.questions.ready_questions import Options, question
from reasoning.questions.standing import Steps, crossings, stays
from recorders.errors import UsageError

PLAYED = ("loiter", "pass_by", "demo", "meet_and_walk_on_together", "three_way_group")


Played = Callable[[str], tuple[GeneratedScene, Path]]


def ask(case: Case, name: str, *words: object, **options: Any) -> list[dict[str, Any]]:
    given = Options(**options)
    text = [str(w) for w in words]
    check_words(case, question(name), text, given)
    answer = case.sql(question(name).sure_sql(text, given))
    return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]


def play(script: Script, write_scene: Callable[..., Path], path: Path) -> Path:
    frames = round(script.seconds * script.fps)
    return write_scene(GeneratedScene("own", script, 0, script.size, frames), path)


def feet(scene: GeneratedScene) -> Iterator[tuple[int, list[int], NDArray[np.float64]]]:
    """Each actor's frames and feet."""
    for info in scene.truth.actors:
        found = [(f.index, a.foot) for f in scene.truth.frames if (a := f.actor(info.id))]
        yield info.id, [i for i, _ in found], np.array([p for _, p in found])


@pytest.mark.parametrize("name", PLAYED)
def test_every_crossing_of_a_line_is_told_once(name: str, played: Played) -> None:
    scene, path = played(name)
    # Nobody waits within a margin of it.
    middle = round(scene.width * (0.6 if name == "three_way_group" else 0.5))
    with Case(
        [path], drawn=drawn(lines=[f"gate={middle},0,{middle},{scene.height}"])
    ) as case:
        rows = ask(case, "crossed", "gate")
    wanted = []
    for actor, frames, places in feet(scene):
        side = places[:, 0] >= middle
        for at in np.flatnonzero(side[1:] != side[:-1]) + 1:
            wanted.append((actor, frames[at], "right" if side[at] else "left"))
    told = sorted((r["track"], r["frame"], r["direction"]) for r in rows)
    assert [(a, d) for a, _, d in told] == [(a, d) for a, _, d in sorted(wanted)]
    for (_, one, _), (_, other, _) in zip(told, sorted(wanted), strict=True):
        assert abs(one - other) <= 3


@pytest.mark.parametrize("name", ["loiter", "demo"])
def test_a_zone_drawn_later_is_the_recorded_one(name: str, played: Played) -> None:
    scene, path = played(name)
    zones = scene.truth.regions.zones
    again = Drawn(tuple(DrawnZone(f"{z.name} again", tuple(z.polygon)) for z in zones))
    with Case([path], drawn=again) as case:
        for zone in zones:
            one, other = (
                case.rows(
                    "SELECT * EXCLUDE (zone) FROM zones WHERE zone = $z ORDER BY ALL",
                    {"z": n},
                )
                for n in (zone.name, f"{zone.name} again")
            )
            assert one == other
            assert one
            for name_ in ("dwell", "loitered", "count"):
                options = {"least_s": 1.0} if name_ == "loitered" else {}
                answers = [
                    [{k: v for k, v in row.items() if k != "explain"} for row in
                     ask(case, name_, n, **options)]
                    for n in (zone.name, f"{zone.name} again")
                ]  # fmt: skip
                assert answers[0] == answers[1]


def test_dwell_is_the_truth(played: Played) -> None:
    scene, path = played("loiter")
    with Case([path]) as case:
        for zone in scene.truth.regions.zones:
            wanted = {
                v.actor: (v.end - 1 - v.start) / scene.fps
                for v in scene.truth.zone_visits
                if v.zone == zone.name
            }
            rows = ask(case, "dwell", zone.name)
            assert {r["track"] for r in rows} == set(wanted)
            for row in rows:
                assert row["seconds"] == pytest.approx(wanted[row["track"]], abs=0.5)


def test_counts_add_up_to_the_crossings(played: Played) -> None:
    _, path = played("loiter")
    with Case([path], drawn=drawn(lines=["gate=160,0,160,240"])) as case:
        rows = ask(case, "count", "gate", every_s=60.0)
        assert [(r["direction"], r["start_t"], r["count"]) for r in rows] == [
            ("left", 0.0, 1), ("right", 0.0, 1), ("left", 60.0, 1), ("right", 60.0, 2),
        ]  # fmt: skip
        inside = ask(case, "count", "shopfront", every_s=60.0)
        assert {(r["direction"], r["start_t"]): r["count"] for r in inside} == {
            ("in", 0.0): 1, ("out", 0.0): 0, ("in", 60.0): 1, ("out", 60.0): 2,
        }  # fmt: skip


def steps(x: list[float], size: float = 80.0) -> Steps:
    count = len(x)
    boxes = np.array([(v - 15, 100.0 - size, 30.0, size) for v in x])
    one = np.ones(count)
    index = np.arange(count)
    return Steps(index, index, index / 25, boxes, one > 0, one, one)


def test_who_stands_on_an_edge_is_counted_once() -> None:
    """He comes up to the edge at x = 100 and trembles there by less than a tenth of his size."""
    tremble = [100 + 5 * (-1) ** k for k in range(40)]
    way = [*range(50, 100, 5), *tremble]
    square = Area([[(100, 50), (200, 50), (200, 150), (100, 150)]])
    assert len(stays(square, steps(way))) == 1
    assert list(crossings((100, 0), (100, 200), steps(way))) == []
    over = [*way, *range(100, 150, 5)]
    assert [c.direction for c in crossings((100, 0), (100, 200), steps(over))] == ["right"]
    back = [*over, *range(150, 40, -5)]
    assert [c.direction for c in crossings((100, 0), (100, 200), steps(back))] == [
        "right",
        "left",
    ]


def test_who_walks_round_a_lines_end_has_not_crossed_it() -> None:
    assert list(crossings((100, 0), (100, 90), steps([*range(50, 150, 5)]))) == []
    assert len(list(crossings((100, 0), (100, 101), steps([*range(50, 150, 5)])))) == 1


def test_a_crossing_that_nobody_saw_is_not_sure() -> None:
    """He is seen on the left, then not for ten times as long, then on the right."""
    whole = steps([50.0, 51.0, 149.0, 150.0])
    gap = Steps(
        np.array([0, 1, 40, 41]), np.array([0, 1, 40, 41]), np.array([0, 1, 40, 41]) / 25,
        whole.boxes, whole.seen, whole.existence, whole.identity,
    )  # fmt: skip
    (told,) = crossings((100, 0), (100, 200), gap)
    assert told.belief[0] == pytest.approx(2 / 40)


FOLLOWED = Script(
    "One crosses; another walks the same way four seconds later; a third beside the first; a"
    " fifth comes back along the way of both",
    18.0,
    (
        walk("0 -.1 .8; 12 1.1 .8", "red"),
        walk("4 -.1 .8; 16 1.1 .8", "blue"),
        walk("0 -.1 .62; 12 1.1 .62", "green"),
        walk("2 1.1 .9; 14 -.1 .9", "white"),
        walk("8 1.1 .8; 20 -.1 .8", "black"),
    ),
)
LEFT_BAG = Script(
    "One puts a bag down and leaves; another passes; a third takes it",
    24.0,
    (
        walk("0 -.1 .8; 5 .4 .8; 7 .4 .8; 12 -.1 .8", "red"),
        walk("6 .45 .8; 18 .45 .8", "black", tall=0.25, body="wheel"),
        walk("8 1.1 .62; 16 -.1 .62", "green"),
        walk("12 1.1 .82; 17 .52 .82; 18.5 .52 .82; 23 1.1 .82", "blue"),
    ),
)


def test_who_followed_whom(write_scene: Callable[..., Path], tmp_path: Path) -> None:
    path = play(FOLLOWED, write_scene, tmp_path / "followed.mcap")
    with Case([path]) as case:
        (row,) = ask(case, "followed", 1)
        assert row["follower"] == 2
        assert row["behind_s"] == pytest.approx(4.0, abs=0.5)
        assert row["seconds"] > 6
        assert row["certainty"] == min(
            row["existence"], row["identity"], 1 - row["off_sizes"]
        )
        assert ask(case, "followed", 2) == []
        assert ask(case, "followed", 1, 3) == []
        assert len(ask(case, "followed", 1, 2)) == 1
        assert ask(case, "followed", 1, within_s=2.0) == []


def test_who_left_a_thing_and_who_took_it(
    write_scene: Callable[..., Path], tmp_path: Path
) -> None:
    path = play(LEFT_BAG, write_scene, tmp_path / "bag.mcap")
    with Case([path]) as case:
        for words in ((), (2,)):
            (row,) = ask(case, "left", *words)
            assert (row["object"], row["who"]) == (2, 1)
            assert row["t"] == pytest.approx(6.0, abs=0.3)
            assert 7 < row["went_away_t"] < 11
            (row,) = ask(case, "took", *words)
            assert (row["object"], row["who"]) == (2, 4)
            assert row["t"] == pytest.approx(18.0, abs=0.3)


def test_first_and_last(played: Played) -> None:
    scene, path = played("loiter")
    with Case([path]) as case:
        first, last = ask(case, "first-last", 1)
        assert (first["place"], last["place"]) == ("at the left edge", "at the right edge")
        at = {f.index: f.actor(1) for f in scene.truth.frames}
        for row in (first, last):
            assert row["x"] == pytest.approx(at[row["frame"]].foot[0], abs=8)


def test_what_happened_between_two_times(played: Played) -> None:
    _, path = played("loiter")
    with Case([path], drawn=drawn(lines=["gate=160,0,160,240"])) as case:
        rows = ask(case, "between", "0:30", "1:00")
        assert all(30 <= r["t"] <= 60 for r in rows)
        told = {(r["what"], tuple(r["targets"])) for r in rows}
        assert ("crossed gate", (3,)) in told
        assert ("in square", (3,)) in told
        assert ("together: meeting", (3, 4)) in told
        assert not any(r["what"] == "grouping" for r in rows)
        whole = ask(case, "between", "0", "1:00:00", certainty=0.0)
        assert [r for r in whole if 30 <= r["t"] <= 60 and r["certainty"] >= 0.5] == [
            r for r in rows if r["certainty"] >= 0.5
        ]


def test_what_is_drawn_wrongly_is_said(played: Played) -> None:
    _, path = played("loiter")
    wrong: tuple[tuple[list[str], list[str], str], ...] = (
        (["bench=1,2,3"], [], "no pairs"), (["bench=1,2,3,4,5,6"], [], "no area"), (["=1,2,3,4"], [], "wanted --zone"),
        ([], ["gate=1,2,1,2"], "one point"), ([], ["gate=1,2,3,4,5,6"], "two are wanted"),
        (["a=0,0,9,9", "a=0,0,8,8"], [], "drawn twice"), (["scene=0,0,9,9"], [], "wanted --zone"),
    )  # fmt: skip
    for zones, lines, said in wrong:
        with pytest.raises(UsageError, match=said):
            drawn(zones, lines)
    for zones, said in (
        (["far=900,0,990,90"], "beyond the picture"),
        (["square=0,0,9,9"], "recorded zone"),
    ):
        with pytest.raises(UsageError, match=said):
            Case([path], drawn=drawn(zones))
    with Case([path], drawn=drawn(lines=["gate=160,0,160,240"])) as case:
        with pytest.raises(UsageError, match="is crossed to the"):
            ask(case, "crossed", "gate", direction="up")
        with pytest.raises(UsageError, match="there are gate"):
            ask(case, "crossed", "door")


def test_nobody_in_a_drawn_zone_is_an_empty_answer(played: Played) -> None:
    _, path = played("loiter")
    with Case([path], drawn=drawn(["sky=0,0,300,5"])) as case:
        assert ask(case, "dwell", "sky") == []


def test_a_crossing_is_explained(played: Played) -> None:
    _, path = played("loiter")
    with Case([path], drawn=drawn(lines=["main gate=160,0,160,240"])) as case:
        row = ask(case, "crossed", "main gate")[0]
        told = explain(case, row["explain"])
        assert told.subjects == [row["track"]]
        assert told.start_frame == row["frame"]
        assert "crossed line main gate to the left" in told.text


@pytest.mark.parametrize(
    ("text", "wanted"),
    [("1:20", Moment(seconds=80.0)), ("0:07.5", Moment(seconds=7.5)), ("12:03:40", Moment(of_day=43420.0))],
)  # fmt: skip
def test_times_as_people_say_them(text: str, wanted: Moment) -> None:
    assert moment(text) == wanted


def test_a_time_of_day_is_one_of_the_recordings(
    write_story: Callable[..., Path], meeting_story: Any, tmp_path: Path
) -> None:
    """It began at 22:13:20 UTC, which is 23:13:20 in Vienna."""
    path = write_story(meeting_story, tmp_path / "day.mcap")
    with Case([path]) as case:
        for text, zone in (("22:13:26", "UTC"), ("23:13:26", "Europe/Vienna")):
            at = moment(text, zone)
            assert case.rows(f"SELECT {at.sql('r')} FROM recordings r") == [(6.0,)]
        assert case.rows(f"SELECT {moment('22:13:20').sql('r')} FROM recordings r") == [
            (0.0,)
        ]
        late = moment("22:13:19").sql("r")
        assert case.rows(f"SELECT {late} FROM recordings r") == [(86399.0,)]
    assert set(PLAYED) < set(SCRIPTS)
