"""Encounters: who is together and who only passes; the same in any scale and order; live never
looks ahead.
"""

from __future__ import annotations

import importlib.util
import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from reasoning.encounters import (
    PHASES,
    EncounterParameters,
    History,
    find_encounters,
    near,
    still,
)
from reasoning.encounters.ground import ground_of
from reasoning.encounters.pair import running_median, spans
from recorders.errors import ConfigError
from tests.examples import examples

FPS = 25.0
H = 80.0
SIZE = float(np.hypot(H, 30.0))


def walk(xs: np.ndarray, y: float = 200.0, first: int = 0) -> History:
    """A person of height H whose standing point goes along xs at height y."""
    n = len(xs)
    boxes = np.stack(
        [xs - 15.0, np.full(n, y - H), np.full(n, 30.0), np.full(n, H)], axis=1
    )
    frames = np.arange(first, first + n)
    return History(frames, frames / FPS, boxes.astype(np.float64))


def arriving(frames: int, where: float) -> np.ndarray:
    """Comes from the right within a second and stays."""
    return np.concatenate(
        [where + np.arange(100.0, 0.0, -4.0), np.full(frames - 25, where)]
    )


def meet_and_part() -> dict[int, History]:
    """1 comes to 2 at 100 px/s, stays 6 s at 0.75 H, and goes; a walk of 500 px on either side."""
    come = np.arange(0.0, 500.0, 4.0)
    path = np.concatenate([come, np.full(150, 500.0), come[::-1]])
    return {1: walk(path), 2: walk(np.full(len(path), 560.0))}


def test_two_who_meet_are_one_encounter() -> None:
    (found,) = find_encounters(meet_and_part())
    assert (found.a, found.b, found.kind) == (1, 2, "meeting")
    p = EncounterParameters()
    # The approach begins when so much room is left between their boxes (30 px wide).
    assert abs(found.start_frame - (560 - 30 - p.far_gap_sizes * SIZE) / 4) <= 4
    assert found.sure_frame > found.start_frame + 20
    assert [(x.kind, PHASES[x.kind]) for x in found.phases] == [
        ("approach", "approach"),
        ("meeting", "together"),
        ("separation", "parting"),
    ]
    approach, together, parting = found.phases
    assert approach.start_frame == found.start_frame
    assert parting.end_frame == found.end_frame
    # Together is from when one stops to when he goes on, a walk of 500 px on either side.
    assert (together.start_frame, together.end_frame) == (
        found.together_frame,
        found.apart_frame,
    )
    assert abs(found.together_frame - 125) <= 12
    assert abs(found.apart_frame - 275) <= 12
    assert found.seen_share == 1.0
    assert 0.5 < found.confidence < 1
    assert found.near_s == pytest.approx(6.0, abs=1.5)


def test_two_who_only_stand_there_are_none() -> None:
    """Who stands beside somebody from first to last sight shows nothing; who came to him, does."""
    stand = np.full(300, 300.0)
    assert find_encounters({1: walk(stand), 2: walk(stand + 40)}) == []
    assert len(find_encounters({1: walk(stand), 2: walk(arriving(300, 340.0))})) == 1


def test_a_prediction_meets_nobody() -> None:
    """What is only predicted beside somebody proves nothing, and what is seen before and after
    does.
    """
    people = meet_and_part()
    n = len(people[1].frames)
    never, hidden = np.zeros(n, np.bool_), np.ones(n, np.bool_)
    never[:110] = True
    hidden[150:225] = False
    drifting = replace(people[1], seen=never)
    assert find_encounters({1: drifting, 2: people[2]}) == []
    (found,) = find_encounters({1: replace(people[1], seen=hidden), 2: people[2]})
    assert abs(found.seen_share - (1 - 75 / 150)) < 0.1
    assert found.near_s == pytest.approx(3.0, abs=0.5)


def test_one_hidden_by_the_other_is_seen_and_proves_nothing() -> None:
    path = arriving(300, 305.0)
    hidden = np.ones(300, np.bool_)
    hidden[125:200] = False
    (found,) = find_encounters(
        {1: walk(np.full(300, 300.0)), 2: replace(walk(path), seen=hidden)}
    )
    assert found.seen_share == 1.0
    hidden[40:] = False
    assert (
        find_encounters({1: walk(np.full(300, 300.0)), 2: replace(walk(path), seen=hidden)})
        == []
    )


def test_ways_in_depth_are_longer_than_they_look() -> None:
    """A camera that looks along the ground draws people who are further off smaller and higher."""

    def passer(y: float, height: float) -> History:
        history = walk(np.arange(0.0, 600.0, 3.0), y)
        boxes = history.boxes.copy()
        boxes[:, 1], boxes[:, 3] = y - height, height
        return replace(history, boxes=boxes)

    slanted = {k: passer(200.0 + 20 * k, 60.0 + 8 * k) for k in range(6)}
    ground = ground_of(slanted, 640.0)
    assert ground.slope == pytest.approx(0.4, abs=0.05)
    assert ground.stretch(np.array([80.0]))[0] == pytest.approx(3.0, abs=0.2)
    above = {k: passer(200.0 + 20 * k, 80.0) for k in range(6)}
    assert ground_of(above, 640.0).stretch(np.array([80.0])).tolist() == [1.0]
    # 30 px apart in the picture, side by side: near from above, far apart along the ground.
    lanes = {8: passer(240.0, 76.0), 9: passer(270.0, 88.0)}
    for people, meet in (({**above, **lanes}, True), ({**slanted, **lanes}, False)):
        found = find_encounters(people, ground=ground_of(people, 640.0))
        assert ((8, 9) in {(e.a, e.b) for e in found}) is meet


def test_two_who_pass_are_none() -> None:
    there = np.arange(0.0, 1000.0, 4.0)
    assert find_encounters({1: walk(there), 2: walk(there[::-1], 230.0)}) == []


@pytest.mark.parametrize("sizes_per_s", [0.35, 0.45, 0.55])
@pytest.mark.parametrize("heading", [1, -1])
def test_two_who_pass_slowly_are_none(sizes_per_s: float, heading: int) -> None:
    """Slow against one another and near for seconds, but one goes past the other from side to
    side.
    """
    n, pace = 400, sizes_per_s * SIZE / FPS
    # One walks, the other one comes from behind and overtakes, or comes towards and passes.
    one = np.arange(n) * (2.0 if heading > 0 else pace / 2)
    two = np.arange(n) * (2.0 + pace if heading > 0 else -pace / 2) - heading * 200 * pace
    together = {1: walk(one), 2: walk(two, 225.0)}
    assert find_encounters(together) == []
    loose = EncounterParameters(drift_sizes_per_s=20.0)
    assert len(find_encounters(together, loose)) == 1, (
        "else the test shows nothing of the drift"
    )


def test_who_stops_to_talk_and_walks_on_was_together() -> None:
    """One comes, stands for five seconds, and goes on the other way: the drift of a meeting is
    small.
    """
    path = np.concatenate(
        [np.arange(300.0, 480.0, 3.0), np.full(125, 480.0), np.arange(480.0, 800.0, 3.0)]
    )
    (found,) = find_encounters({1: walk(path), 2: walk(np.full(len(path), 520.0))})
    assert found.drift < 0.2


def test_two_who_walk_together_are_moving() -> None:
    path = np.arange(0.0, 1000.0, 3.0)
    (found,) = find_encounters({4: walk(path), 9: walk(path + 50, 210.0)})
    assert found.kind == "moving"
    assert (found.start_frame, found.end_frame) == (0, len(path) - 1)


def test_overtaking_slowly_beside_another_lane_is_none() -> None:
    path = np.arange(0.0, 900.0, 3.0)
    assert find_encounters({1: walk(path), 2: walk(path + 10, 200.0 + 4 * H)}) == []


def test_joint_makes_contact() -> None:
    pair = {1: walk(np.full(200, 300.0)), 2: walk(arriving(200, 340.0))}
    found = find_encounters(pair)
    assert {p.kind for e in found for p in e.phases} == {"approach", "meeting"}
    (touch,) = find_encounters(pair, joint={(1, 2): [(50, 180)]})
    assert touch.kind == "contact"
    assert [(p.kind, p.start_frame, p.end_frame) for p in touch.phases][2] == (
        "contact",
        50,
        180,
    )


def wrestle(seconds: float, pace: float) -> np.ndarray:
    """Back and forth by 0.4 body sizes at a speed in body sizes per second."""
    n = round(seconds * FPS)
    way = (
        np.cumsum(
            np.where((np.arange(n) * pace / FPS / 0.4).astype(int) % 2 == 0, 1.0, -1.0)
        )
        * pace
        * SIZE
        / FPS
    )
    come = np.arange(200.0, 0.0, -4.0)
    return np.concatenate([come, np.zeros(60), way, np.full(60, way[-1])])


def test_two_who_wrestle_are_abrupt_and_the_values_are_those_of_the_moments() -> None:
    way = wrestle(3.0, 0.8)
    (found,) = find_encounters({1: walk(np.full(len(way), 300.0)), 2: walk(310.0 + way)})
    (fierce,) = found.abrupt
    assert abs(fierce.start_frame - 110) <= 25
    assert abs(fierce.end_frame - 185) <= 25
    p = EncounterParameters()
    assert fierce.distance <= p.touch_sizes
    assert fierce.agitation >= p.abrupt_sizes_per_s
    assert fierce.through <= 0.5
    assert fierce.abrupt_s <= fierce.end_s - fierce.start_s + 1 / FPS + 1e-9
    (contact,) = [x for x in found.phases if x.kind == "contact"]
    assert (contact.start_frame, contact.end_frame) == (
        fierce.start_frame,
        fierce.end_frame,
    )


def test_joint_or_passing_by_is_not_abrupt() -> None:
    """From pixels two are JOINT whenever one hides the other, and one who walks past another is
    abrupt for a moment.
    """
    stand = np.full(200, 300.0)
    (found,) = find_encounters(
        {1: walk(stand), 2: walk(arriving(200, 340.0))}, joint={(1, 2): [(50, 180)]}
    )
    assert [x.kind for x in found.phases].count("contact") == 1
    assert found.abrupt == ()
    # Two stand together; then one walks past the other, from touching on one side to touching on
    # the other.
    step = 0.7 * SIZE / FPS
    past = np.concatenate(
        [
            np.arange(150.0, 250.0, 4.0),
            np.full(100, 250.0),
            np.arange(250.0, 350.0, step),
            np.full(100, 350.0),
        ]
    )
    (found,) = find_encounters({1: walk(np.full(len(past), 300.0)), 2: walk(past)})
    assert [x.kind for x in found.phases].count("contact") == 1, (
        "else the test shows nothing"
    )
    assert found.abrupt == ()


def test_a_phases_values_are_of_its_own_frames() -> None:
    """They stand close, then one goes: the median distance of each part is its own."""
    step = 4.0
    path = np.concatenate([np.full(150, 330.0), np.arange(330.0, 800.0, step)])
    (found,) = find_encounters({1: walk(np.full(len(path), 300.0)), 2: walk(path)})
    first, last = found.phases[0], found.phases[-1]
    assert (first.kind, last.kind) == ("meeting", "separation")
    assert abs(first.distance - 30 / SIZE) < 0.05
    assert last.distance > first.distance + 0.1
    assert last.end_distance >= last.distance
    assert first.slower < 0.01
    assert 0.5 < last.relative_speed / (step * FPS / SIZE) <= 1
    assert found.distance <= found.all_distance < last.distance


def test_a_gap_splits_and_a_short_one_does_not() -> None:
    path = np.full(400, 300.0) + np.arange(400) % 200 * 0.5
    whole, other = walk(path), walk(path + 40)
    for missing, count in ((20, 1), (80, 2)):
        keep = np.r_[0:150, 150 + missing : 400]
        holed = History(whole.frames[keep], whole.times_s[keep], whole.boxes[keep])
        assert len(find_encounters({1: holed, 2: other})) == count


def test_nobody_and_single_frames() -> None:
    empty = History(np.zeros(0, np.int64), np.zeros(0), np.zeros((0, 4)))
    assert find_encounters({}) == []
    assert find_encounters({1: empty, 2: walk(np.zeros(5))}) == []
    assert find_encounters({1: walk(np.zeros(1)), 2: walk(np.zeros(1))}) == []
    assert still(empty) == []


def test_parameters_are_checked() -> None:
    with pytest.raises(ConfigError, match="near_sizes"):
        EncounterParameters(near_sizes=0)


@given(st.integers(0, 10_000), st.floats(0.25, 8.0))
@settings(max_examples=examples(25), deadline=None)
def test_neither_scale_nor_order_nor_place_matters(seed: int, scale: float) -> None:
    rng = np.random.default_rng(seed)
    people = {
        i: walk(np.cumsum(rng.normal(0, 3, 200)) + 120 * i, 200.0 + 10 * i)
        for i in range(4)
    }
    moved = {
        i: History(h.frames, h.times_s, h.boxes * scale)
        for i, h in reversed(people.items())
    }
    one, two = find_encounters(people), find_encounters(moved)
    assert [(e.a, e.b, e.kind, e.start_frame, e.end_frame) for e in one] == [
        (e.a, e.b, e.kind, e.start_frame, e.end_frame) for e in two
    ]


@given(st.integers(0, 10_000))
@settings(max_examples=examples(20), deadline=None)
def test_live_onsets_never_look_ahead(seed: int) -> None:
    """What live mode announced by frame n is announced by a recording that ends in frame n."""
    rng = np.random.default_rng(seed)
    people = {i: walk(np.cumsum(rng.normal(0, 4, 240)) + 100 * i) for i in range(3)}
    cut = 160
    short = {
        i: History(h.frames[:cut], h.times_s[:cut], h.boxes[:cut])
        for i, h in people.items()
    }
    whole = {
        (e.a, e.b, e.start_frame)
        for e in find_encounters(people, live=True)
        if e.start_frame < cut
    }
    assert whole == {(e.a, e.b, e.start_frame) for e in find_encounters(short, live=True)}


@given(st.lists(st.booleans(), max_size=60))
def test_spans_cover_exactly_what_is_true(values: list[bool]) -> None:
    mask = np.array(values, bool)
    rebuilt = np.zeros(len(mask), bool)
    found = spans(mask)
    for start, end in found:
        rebuilt[start : end + 1] = True
    assert (rebuilt == mask).all()
    assert all(b[0] > a[1] + 1 for a, b in pairwise(found))


def test_a_causal_median_uses_the_past_alone() -> None:
    values = np.array([0.0, 0, 0, 9, 9, 9, 9])
    assert running_median(values, 1).tolist() == [0, 0, 0, 9, 9, 9, 9]
    assert running_median(values, 1, causal=True).tolist() == [0, 0, 0, 0, 9, 9, 9]


def test_still_and_near() -> None:
    path = np.concatenate(
        [np.arange(0.0, 300.0, 4.0), np.full(100, 300.0), np.arange(300.0, 700.0, 4.0)]
    )
    (stood,) = still(walk(path))
    assert abs(stood.start_frame - 75) <= 15
    assert abs(stood.end_frame - 175) <= 15
    (close,) = [s for a, b, s in near({1: walk(path), 2: walk(np.full(len(path), 330.0))})]
    assert close.start_frame < 75 < 160 < close.end_frame
    assert close.median <= close.most <= EncounterParameters().touch_sizes
    assert stood.most <= 0.08


@pytest.fixture(scope="module")
def bench(real_data: Path) -> Iterator[tuple[Any, Any, list[Any]]]:
    folder = Path(__file__).parents[2] / "benchmarks"
    loaded = {}
    for name in ("caviar", "bench_encounters"):
        spec = importlib.util.spec_from_file_location(name, folder / f"{name}.py")
        assert spec is not None
        assert spec.loader is not None
        loaded[name] = sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(loaded[name])
    sequences = [
        loaded["caviar"].read(p) for p in sorted((real_data / "caviar").glob("*.xml"))
    ]
    yield loaded["caviar"], loaded["bench_encounters"], sequences
    for name in loaded:
        del sys.modules[name]


@pytest.mark.real
def test_caviar_truth_is_what_the_labels_say(bench: Any) -> None:
    _, _, sequences = bench
    assert len(sequences) == 12
    assert sum(len(s.together) for s in sequences) == 15
    assert [
        (x.a, x.b, x.start, x.end)
        for s in sequences
        if s.name == "Meet_WalkSplit"
        for x in s.together
    ] == [(1, 3, 100, 300)]
    assert [sorted(s.things) for s in sequences if s.name.startswith("LeftBag")] == [
        [4],
        [4],
    ]


@pytest.mark.real
def test_caviar_leave_one_out(bench: Any) -> None:
    caviar, module, sequences = bench
    scored = module.leave_one_out(sequences)
    frame, interval, onset = caviar.f1(scored.held_out.sum(axis=0))
    assert frame >= 0.93
    assert interval >= 0.88
    assert onset >= 0.70
    live = caviar.f1(scored.live.sum(axis=0))
    assert live[0] >= 0.84
    assert live[2] >= 0.45


@pytest.mark.real
def test_who_walks_together_on_a_street(bench: Any, real_data: Path) -> None:
    """The same thresholds, seen from above: pairs that were labelled as walking together."""
    _, module, _ = bench
    there = module.street(real_data / "ewap-hotel")
    assert len(there.together) == 47
    assert module.pair_f1(module.on_street(there, EncounterParameters())) >= 0.82
