"""Why a row is there: a phase's own values, a contact's rule, the thresholds that the row was
found with.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from reasoning.encounters import EncounterParameters
from reasoning.questions import Case
from reasoning.questions.explain import Explanation, explain
from reasoning.questions.literals import Moment
from reasoning.questions.patterns import plan
from reasoning.questions.ready_questions import Options, question
from recorders import channels
from recorders.errors import UsageError
from recorders.log import LogWriter
from recorders.messages import Groups, Relation, Relations, Track, Tracks

FPS = 25
FRAME_NS = 1_000_000_000 // FPS
SIZE = float(np.hypot(30.0, 80.0))


def _track(i: int, x: float) -> Track:
    return Track(
        id=i, box=(x, 100.0, 30.0, 80.0), ellipse=None, velocity=(0.0, 0.0), shell_radius=40.0, mode="motion",
        confidence=1.0, present=True, observed=True, blob=-1, grouping=False, grouped=False, splitting=False,
        grouping_partners=[], grouped_partners=[], splitting_partners=[], group=None, scene="inside",
    )  # fmt: skip


@pytest.fixture(scope="module")
def fight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """1 stands. 2 stands beside it (JOINT in frames 20 to 39), wrestles with it in 100 to 199,
    stands, and goes.
    """
    n = 100
    way = (
        np.cumsum(
            np.where((np.arange(n) * 0.8 / FPS / 0.56).astype(int) % 2 == 0, 1.0, -1.0)
        )
        * 0.8
        * SIZE
        / FPS
    )
    here = 320.0 + way[-1]
    path = np.concatenate(
        [np.full(100, 320.0), 320.0 + way, np.full(50, here), here + 4.0 * np.arange(80)]
    )
    path += np.concatenate(
        [np.zeros(100), np.full(n, -20.0), np.full(50, -20.0), np.full(80, -20.0)]
    )
    out = tmp_path_factory.mktemp("explain") / "fight.mcap"
    with LogWriter(out) as log:
        ids = {c: log.channel(channels.topic("camera", c), channels.schema(c), channels.message_encoding(c))
               for c in ("tracks", "relations", "groups")}  # fmt: skip
        for k, x in enumerate(path.tolist()):
            t = k * FRAME_NS
            joint = (
                [Relation(1, 2, "JOINT", 20, 20 * FRAME_NS, False, True, False, 0.5)]
                if 20 <= k < 40
                else []
            )
            log.write(
                ids["tracks"],
                channels.encode("tracks", Tracks(k, [_track(1, 300.0), _track(2, x)])),
                t,
            )
            log.write(
                ids["relations"], channels.encode("relations", Relations(k, joint)), t
            )
            log.write(ids["groups"], channels.encode("groups", Groups(k)), t)
    return out


@pytest.fixture(scope="module")
def case(fight: Path) -> Iterator[Case]:
    with Case([fight]) as c:
        yield c


def value(found: Explanation, words: str) -> object:
    (measure,) = [m for m in found.measures if words in m.name]
    return measure.value


def phase(case: Case, frame: int) -> Explanation:
    return explain(case, f"phase:1-2@{frame}")


def test_why_this_is_a_fight(case: Case) -> None:
    (row,) = case.rows(plan("fighting"))
    (reference,) = row[-1].split()
    found = explain(case, reference)
    p = EncounterParameters()
    assert "abrupt" in found.rule
    assert "touching distance" in found.rule
    decided = {m.threshold: m for m in found.measures if m.threshold is not None}
    assert set(decided) == {p.touch_sizes, p.abrupt_sizes_per_s, p.through_share}
    assert all(m.margin is not None and m.margin >= 0 for m in decided.values())
    assert 0.5 < float(str(value(found, "median agitation"))) < 0.9
    assert abs(found.start_frame - 100) <= 20
    assert abs(found.end_frame - 199) <= 20


def test_a_contact_says_which_way_it_is_one(case: Case) -> None:
    by_joint, by_force = phase(case, 30), phase(case, 150)
    assert by_joint.kind == by_force.kind == "phase (contact)"
    assert value(by_joint, "a contact by") == "JOINT"
    assert "relation:1-2@20 (frames 20 to 39" in str(value(by_joint, "JOINT in it"))
    assert value(by_joint, "a fight's mark") == "never"
    assert value(by_force, "a contact by") == "touching and abrupt"
    assert value(by_force, "JOINT in it") == "never"
    assert str(value(by_force, "a fight's mark")).startswith("abrupt:1-2@")
    assert "JOINT, or within touching distance and abrupt" in by_force.rule


def test_phases_have_their_own_values_over_their_own_frames(case: Case) -> None:
    """Reckoned here from the path: 20 pixels apart while they stand, on the way out ever more."""
    stand, apart, whole = (
        phase(case, 60),
        phase(case, 260),
        explain(case, "encounter:1-2@60"),
    )
    assert value(stand, "median distance") == pytest.approx(20.0 / SIZE, abs=0.01)
    assert float(str(value(apart, "median distance"))) > 0.4
    room = EncounterParameters().far_gap_sizes
    assert value(apart, "last frame") == pytest.approx(room + 30 / SIZE, abs=0.1)
    assert 0.5 < float(str(value(apart, "median relative speed"))) <= 4.0 * FPS / SIZE
    assert stand.measures != apart.measures
    assert (stand.start_frame, stand.end_frame) != (whole.start_frame, whole.end_frame)
    # The encounter has both: the moments that decided, and all of its frames.
    assert (
        float(str(value(whole, "median distance in the moments together for sure"))) < 1.0
    )
    assert value(whole, "median distance with approach") != value(
        whole, "median distance in the moments"
    )


def test_nearness_and_standing_still_have_their_values(case: Case) -> None:
    near, still = explain(case, "near:1-2@60"), explain(case, "still:1@60")
    assert near.measures[-1].threshold == EncounterParameters().touch_sizes
    assert near.measures[-1].margin is not None
    assert near.measures[-1].margin >= 0
    assert value(near, "median distance") == pytest.approx(20.0 / SIZE, abs=0.1)
    assert value(still, "highest speed") == 0
    assert still.measures[-1].threshold == 0.08


def test_a_reference_names_its_interval_by_its_first_frame(case: Case) -> None:
    for kind, frames in (
        ("relation", (20, 39)),
        ("near", (60, 61)),
        ("encounter", (60, 140)),
        ("still", (3, 200)),
    ):
        who = "1" if kind == "still" else "1-2"
        one, two = (explain(case, f"{kind}:{who}@{n}") for n in frames)
        assert one == two
        assert one.reference == f"{kind}:{who}@{one.start_frame}"


def test_the_thresholds_are_those_of_the_rows(fight: Path) -> None:
    with Case(
        [fight], encounters=EncounterParameters(near_sizes=1.5, touch_sizes=0.7)
    ) as c:
        held = {m.threshold for m in explain(c, "encounter:1-2@60").measures}
        assert 1.5 in held
        assert explain(c, "near:1-2@60").measures[-1].threshold == 0.7


def test_a_stay_is_explained_in_the_zone_that_the_row_named(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    odd = "bus stop, 'A' 50%"
    story = story_type(
        100,
        {2: (0, 99, (9.0, 9.0, 9.0, 9.0), (0.0, 0.0))},
        zones=[(2, "hall", 0, 99), (2, odd, 0, 99), (2, "bench", 40, 60)],
    )
    with Case([write_story(story, tmp_path / "nested.mcap")]) as case:
        for zone in ("hall", odd):
            told = f"Target 2 was in the zone {zone!r}."
            for name, options in (
                ("loitered", {"least_s": 1.0}),
                ("who-was-in", {"at": Moment(seconds=1.0)}),
            ):
                answer = case.sql(question(name).sql([zone], Options(**options)))
                (row,) = [dict(zip(answer.columns, r, strict=True)) for r in answer.rows]
                assert explain(case, row["explain"]).text == told
                assert explain(case, row["explain"]).reference == row["explain"]
        answer = case.sql(plan("in(a, hall)[>2s]"))
        (row,) = [dict(zip(answer.columns, r, strict=True)) for r in answer.rows]
        assert explain(case, row["explain"]).text == "Target 2 was in the zone 'hall'."
        answer = case.sql(question("timeline").sql(["2"], Options()))
        rows = [dict(zip(answer.columns, r, strict=True)) for r in answer.rows]
        stays = {
            r["what"]: explain(case, r["explain"]).text
            for r in rows
            if r["what"].startswith("in ")
        }
        assert stays == {
            f"in {z}": f"Target 2 was in the zone {z!r}." for z in ("hall", odd, "bench")
        }
        with pytest.raises(
            UsageError, match=r"in 3 zones then; give one of them: .*zone:2@50:hall"
        ):
            explain(case, "zone:2@50")
        with pytest.raises(UsageError, match="zone:2@70:bench: there is none"):
            explain(case, "zone:2@70:bench")


def test_the_zone_may_be_left_out_where_there_is_one(
    tmp_path: Path, story_type: type[Any], write_story: Callable[..., Any]
) -> None:
    story = story_type(
        50, {4: (0, 49, (9.0, 9.0, 9.0, 9.0), (0.0, 0.0))}, zones=[(4, "bench", 10, 40)]
    )
    with Case([write_story(story, tmp_path / "one.mcap")]) as case:
        assert explain(case, "zone:4@20").reference == "zone:4@10:bench"
