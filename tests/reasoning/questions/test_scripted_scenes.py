"""The ready questions on every scripted scene, against what the generator knows to be true.

The targets are the truth's, through the reasoning; so what is tested is what the questions make of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from fixtures.targets import truth_targets
from reasoning.questions import Case
from reasoning.questions.ready import Options, question
from reasoning.questions.values import Moment
from reasoning.reasoner import Reasoner
from recorders import channels
from recorders.log import LogWriter

CHANNELS = ("tracks", "relations", "groups", "events")


def write(scene: GeneratedScene, path: Path) -> Path:
    reasoner = Reasoner({}, scene.width, scene.height)
    with LogWriter(path) as log:
        ids = {
            n: log.channel(channels.topic("camera", n), channels.schema(n), channels.message_encoding(n))
            for n in CHANNELS
        }
        for targets in truth_targets(scene):
            ns = targets.frame * scene.frame_ns
            made = reasoner.step(targets.frame, ns, targets, scene.truth.regions)
            messages = [("tracks", made.tracks), ("relations", made.relations), ("groups", made.groups)]
            for name, message in [*messages, *(("events", e) for e in made.events)]:
                log.write(ids[name], channels.encode(name, message), ns)
    return path


@pytest.fixture(scope="session")
def played(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[GeneratedScene, Path]]:
    """A scene and its annotated log by name, made once in whatever order the tests run."""
    folder = tmp_path_factory.mktemp("scripted")
    made: dict[str, tuple[GeneratedScene, Path]] = {}

    def play(name: str) -> tuple[GeneratedScene, Path]:
        if name not in made:
            scene = generate(name)
            made[name] = scene, write(scene, folder / f"{name}.mcap")
        return made[name]

    return play


@pytest.fixture(params=[n for n in SCRIPTS if n != "empty_scene"])
def asked(request: pytest.FixtureRequest, played) -> Iterator[tuple[GeneratedScene, Case]]:
    scene, path = played(request.param)
    with Case([path]) as case:
        yield scene, case


def ask(case: Case, name: str, *words: object, **options) -> list[dict]:
    answer = case.sql(question(name).sql([str(w) for w in words], Options(**options)))
    return [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]


def present(scene: GeneratedScene, frame: int) -> set[int]:
    """Who is tracked: from the first time partly in the region of interest to the time wholly beyond the border."""
    found = set()
    for actor in {s.actor for s in scene.truth.region_stays}:
        here = False
        for stay in sorted((s for s in scene.truth.region_stays if s.actor == actor), key=lambda s: s.start):
            if stay.start > frame:
                break
            here = stay.status != "outside" and (here or stay.status in ("inside", "partly"))
            if stay.end <= frame:
                gone = all(s.start != stay.end for s in scene.truth.region_stays if s.actor == actor)
                here = here and not gone
        if here:
            found.add(actor)
    return found


def test_who_was_in_the_scene(asked) -> None:
    scene, case = asked
    for frame in range(0, scene.frame_count, max(1, scene.frame_count // 12)):
        rows = ask(case, "who-was-in", "scene", at=Moment(frame=frame))
        assert {r["track"] for r in rows} == present(scene, frame), frame


def test_who_was_in_a_zone_and_who_loitered(asked) -> None:
    scene, case = asked
    for visit in scene.truth.zone_visits:
        middle = (visit.start + visit.end) // 2
        rows = ask(case, "who-was-in", visit.zone, at=Moment(frame=middle))
        wanted = {v.actor for v in scene.truth.zone_visits if v.zone == visit.zone and v.start <= middle < v.end}
        assert {r["track"] for r in rows} == wanted
    for zone in {v.zone for v in scene.truth.zone_visits}:
        for least in (1.0, 5.0, 20.0):
            rows = ask(case, "loitered", zone, least_s=least, gap_s=0.0)
            stays = [(v.actor, v.start, v.end - 1) for v in scene.truth.zone_visits if v.zone == zone]
            # The middle of a box's lower edge is where one stands to within a stride: two frames at these paces.
            slack = 2 / scene.fps
            found = {r["track"]: (r["start_frame"], r["end_frame"]) for r in rows}
            assert {a for a, s, e in stays if (e - s) / scene.fps >= least + slack} <= set(found)
            assert set(found) <= {a for a, s, e in stays if (e - s) / scene.fps >= least - slack}
            for actor, start, end in stays:
                if actor in found:
                    assert abs(found[actor][0] - start) <= 2
                    assert abs(found[actor][1] - end) <= 2


def test_who_never_left(asked) -> None:
    scene, case = asked
    rows = ask(case, "entered-never-left")
    for row in rows:
        assert row["there_at_the_end"] == (row["track"] in present(scene, scene.frame_count - 1))
    inside = {s.actor for s in scene.truth.region_stays if s.status == "inside"}
    at_the_end = present(scene, scene.frame_count - 1)
    assert {r["track"] for r in rows} <= inside
    never_out = {a for a in inside if not any(s.actor == a and s.status == "outside" for s in scene.truth.region_stays)}
    assert never_out & at_the_end <= {r["track"] for r in rows}


def test_together_and_met(asked) -> None:
    scene, case = asked
    for group in scene.truth.groups:
        a, b = group.members
        overlapping = [
            r for r in ask(case, "together", a, b) if r["start_frame"] < group.end and r["end_frame"] >= group.start
        ]
        assert len(overlapping) == 1, (group, overlapping)
        covered = min(overlapping[0]["end_frame"] + 1, group.end) - max(overlapping[0]["start_frame"], group.start)
        assert covered >= 0.75 * (group.end - group.start)
        met = [r for r in ask(case, "met", a, b) if r["start_frame"] < group.end and r["end_frame"] >= group.start]
        assert met
        assert {r["other"] for r in ask(case, "met", b)} >= {a}


@pytest.mark.parametrize("name", ["pass_by", "leave_and_come_back", "stand_on_edge", "single_walker"])
def test_nobody_together(name: str, played) -> None:
    with Case([played(name)[1]]) as case:
        assert case.rows("SELECT * FROM encounters") == []


def test_contacts_reach_everybody_that_was_met(asked) -> None:
    scene, case = asked
    for actor in [a.id for a in scene.truth.actors][:3]:
        direct = {r["other"]: r["start_t"] for r in reversed(ask(case, "met", actor))}
        chains = ask(case, "contacts", actor, depth=4)
        assert set(direct) <= {r["track"] for r in chains}
        assert all(r["reached_t"] <= direct[r["track"]] for r in chains if r["track"] in direct)
        assert all(r["contacts"] == len(r["via"]) <= 4 for r in chains)


def test_partner_lists_of_who_groups_and_splits(asked) -> None:
    _, case = asked
    for row in ask(case, "grouping-and-splitting"):
        assert row["grouping_with"]
        assert row["splitting_from"]
        assert not set(row["grouping_with"]) & set(row["splitting_from"])
        at = row["start_frame"]
        bits = case.rows(f"SELECT grouping, splitting FROM tracks WHERE track = {row['track']} AND frame = {at}")
        assert bits == [(True, True)]


def test_history_timeline_and_before_hold_together(asked) -> None:
    _, case = asked
    for (label,) in case.rows("SELECT group_id FROM groups WHERE len(formed_from) > 0 LIMIT 3"):
        family = {r["group_id"]: r["is"] for r in ask(case, "group-history", label)}
        assert family[label] == "itself"
        assert "ancestor" in family.values()
    for event, t in case.rows("SELECT event, t FROM events WHERE kind = 'exited'"):
        for row in ask(case, "before", event, within_s=3.0):
            assert t - 3.0 <= row["until_t"] <= t
    for (track,) in case.rows("SELECT DISTINCT track FROM presence LIMIT 3"):
        told = {r["explain"] for r in ask(case, "timeline", track)}
        events = case.rows(f"SELECT event FROM events WHERE list_contains(subjects, {track})")
        assert {f"event:{e}" for (e,) in events} <= told


def test_two_leave_together_in_the_demo(played) -> None:
    with Case([played("demo")[1]]) as case:
        assert [r["other"] for r in ask(case, "left-with", 1)] == [3]
        assert [r["other"] for r in ask(case, "left-with", 3)] == [1]
        assert ask(case, "left-with", 4) == []
