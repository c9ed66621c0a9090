"""What an annotated log answers at every frame without a replay, and whole replays of scenes and
recordings.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest

from fixtures.logs import record_scene, write_scene_log
from fixtures.scenes import GeneratedScene, generate
from fixtures.targets import truth_targets
from reasoning.graph import to_networkx
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.messages import Graph, Targets
from recorders.recording import RecordOptions, record
from recorders.sources import open_source
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions

LIFE = ("track_confirmed", "track_lost", "track_recovered", "track_removed", "mode_changed")
BITS = ("grouping", "grouped", "splitting")


class TruthTracker:
    """A tracker without a fault: it says what is true."""

    def __init__(self, scene: GeneratedScene) -> None:
        self.answers: Iterator[Targets] = truth_targets(scene)

    def step(self, frame: Any) -> Targets:
        answer = next(self.answers)
        assert answer.frame == frame.index
        return answer

    def state(self) -> Mapping[str, Any]:
        return {}

    def restore(self, state: Mapping[str, Any]) -> None:
        raise NotImplementedError


@pytest.fixture(scope="module")
def three(tmp_path_factory: pytest.TempPathFactory) -> list[AnnotatedFrame]:
    """The annotated log of three people who change company, as its reader gives it."""
    folder = tmp_path_factory.mktemp("three")
    scene = generate("three_way_group")
    log = write_scene_log(
        scene, folder / "scene.mcap", style="none", pictures="none", masks=False
    )
    config = replay_config("events", assignments=["events.hindsight=false"])
    out = folder / "annotated.mcap"
    replay(log, out, ReplayOptions(config=config, tracker=lambda *_: TruthTracker(scene)))
    with AnnotatedLog(out) as annotated:
        return list(annotated.frames())


def test_the_log_tells_the_story(three: list[AnnotatedFrame]) -> None:
    told = [
        (f.index, e.kind, e.subjects)
        for f in three
        for e in f.events
        if e.kind in (*BITS, "single")
    ]
    assert told == [
        (44, "grouping", [1, 2]),
        (60, "grouped", [1, 2]),
        (128, "grouping", [1, 3]),
        (131, "grouping", [2, 3]),
        (151, "grouped", [1, 3]),
        (151, "grouped", [2, 3]),
        (158, "splitting", [1, 2]),
        (158, "splitting", [2, 3]),
        (181, "single", [2]),
        (224, "splitting", [1, 3]),
        (246, "single", [1]),
        (246, "single", [3]),
    ]


def test_who_interacts_with_whom_and_since_when(three: list[AnnotatedFrame]) -> None:
    met: dict[tuple[int, int], int] = {}
    since: dict[tuple[int, int, str], int] = {}
    for f in three:
        for e in f.events:
            if e.kind == "interaction_started":
                met[e.subjects[0], e.subjects[1]] = f.index
            elif e.kind == "interaction_ended":
                del met[e.subjects[0], e.subjects[1]]
        held = {
            (t.id, p, bit)
            for t in f.tracks
            for bit in BITS
            for p in getattr(t, f"{bit}_partners")
            if t.id < p
        }
        since = {k: since.get(k, f.index) for k in held}
        assert {(r.a, r.b): r.met_frame for r in f.relations} == met
        assert {
            (r.a, r.b, bit): r.partners_since_frame
            for r in f.relations
            for bit in BITS
            if getattr(r, bit)
        } == since
        for r in f.relations:
            assert r.met_ns == three[r.met_frame].time_ns
            assert (r.partners_since_frame is None) == (
                not (r.grouping or r.grouped or r.splitting)
            )


def test_who_is_grouping_and_splitting_at_once_and_with_whom(
    three: list[AnnotatedFrame],
) -> None:
    mixed = {
        (t.id, tuple(t.grouped_partners), tuple(t.splitting_partners))
        for f in three
        for t in f.tracks
        if t.grouped and t.splitting
    }
    assert mixed == {(1, (3,), (2,)), (3, (1,), (2,))}, (
        "both stay with one another while the second one leaves"
    )
    both = {
        (t.id, tuple(t.grouping_partners), tuple(t.grouped_partners))
        for f in three
        for t in f.tracks
        if t.grouping and t.grouped
    }
    assert both == {(1, (3,), (2,)), (2, (3,), (1,))}
    for f in three:
        partners = {
            (t.id, bit): getattr(t, f"{bit}_partners") for t in f.tracks for bit in BITS
        }
        assert all(
            i in partners[p, bit] for (i, bit), others in partners.items() for p in others
        ), "symmetric"


def test_the_members_of_each_group_and_where_it_came_from(
    three: list[AnnotatedFrame],
) -> None:
    seen: dict[int, list[int]] = {}
    for f in three:
        for g in f.groups:
            assert seen.setdefault(g.label, g.members) == g.members, (
                "a group is its members"
            )
            assert g.former_members == [seen[label] for label in g.formed_from]
            assert not g.entered_as_one
            assert {t.id for t in f.tracks if t.group == g.label} <= set(g.members)
    assert seen == {1: [1, 2], 2: [1, 2, 3], 3: [1, 3]}
    origin = {g.label: g.formed_from for f in three for g in f.groups}
    assert origin == {1: [], 2: [1], 3: [2]}


def test_the_latest_graph_gives_the_same_answers(three: list[AnnotatedFrame]) -> None:
    for f in three:
        assert isinstance(f.graph, Graph)
        graph = to_networkx(f.graph)
        edges = [(u, v, d) for u, v, d in graph.edges(data=True) if "end_frame" not in d]
        shells = {
            (u, v, d["state"], d["since_frame"])
            for u, v, d in edges
            if d["view"] == "SHELLS"
        }
        assert shells == {
            (f"target:{r.a}", f"target:{r.b}", r.state, r.since_frame) for r in f.relations
        }
        bits = {
            (u, v): (d["state"], d["since_frame"])
            for u, v, d in edges
            if d["state"] in BITS
        }
        assert bits == {
            (f"target:{r.a}", f"target:{r.b}"): (bit, r.partners_since_frame)
            for r in f.relations
            for bit in BITS
            if getattr(r, bit)
        }
        groups = {
            n: d
            for n, d in graph.nodes(data=True)
            if d["kind"] == "group" and not d.get("gone")
        }
        assert {
            n: tuple(json.loads(d[k]) for k in ("members", "formed_from", "former_members"))
            for n, d in groups.items()
        } == {
            f"group:{g.label}": (g.members, g.formed_from, g.former_members)
            for g in f.groups
        }


def told(log: Path) -> list[tuple[int, str, list[int]]]:
    with AnnotatedLog(log) as annotated:
        frames = annotated.frames(("tracks", "events"))
        return [
            (f.index, e.kind, e.subjects)
            for f in frames
            for e in f.events
            if e.kind not in LIFE
        ]


def replayed(scene_log: Path) -> Path:
    out = scene_log.with_suffix(".annotated.mcap")
    replay(scene_log, out, ReplayOptions(config=replay_config("events")))
    return out


def test_two_who_pass_by_from_pixels(tmp_path: Path) -> None:
    log = record_scene(generate("pass_by"), tmp_path / "scene.mcap")
    story = [
        (23, "entering", [1]),
        (33, "entered", [1]),
        (35, "entering", [2]),
        (44, "entered", [2]),
        (70, "interaction_started", [1, 2]),
        (83, "grouping", [1, 2]),
        (88, "joined", [1, 2]),
        (88, "grouped", [1, 2]),
        (88, "group_formed", [1, 2]),
        (100, "separated", [1, 2]),
        (100, "splitting", [1, 2]),
        (104, "single", [1]),
        (104, "single", [2]),
        (104, "group_ended", [1, 2]),
        (118, "interaction_ended", [1, 2]),
        (148, "exiting", [1]),
        (164, "exited", [1]),
        (165, "exiting", [2]),
        (175, "exited", [2]),
    ]
    found = told(replayed(log))
    assert sorted(t[1:] for t in found) == sorted(s[1:] for s in story)
    for frame, kind, who in story:
        assert any(abs(f - frame) <= 20 for f, k, w in found if (k, w) == (kind, who)), (
            kind,
            who,
        )


def test_a_group_that_enters_as_one_is_understood_when_it_splits(tmp_path: Path) -> None:
    log = write_scene_log(
        generate("enter_as_group_and_split"),
        tmp_path / "scene.mcap",
        style="merged",
        pictures="none",
    )
    found = told(replayed(log))
    assert [w for _, k, w in found if k == "entering"] == [[1]], (
        "who is born of the split does not enter"
    )
    assert [w for _, k, w in found if k in ("splitting", "group_entered_scene")] == [
        [1, 2],
        [1, 2],
    ]
    split = next(f for f, k, _ in found if k == "group_entered_scene")
    assert abs(split - 179) <= 12, "they come apart in frame 179"


@pytest.mark.real
def test_one_leaves_the_shop_and_reenters(real_data: Path, tmp_path: Path) -> None:
    """The indoor sequence of EVENTS, Figure 5, from its pixels: two targets, an identity each,
    all events right.
    """
    source = open_source(real_data / "caviar-corridor" / "OneLeaveShopReenter1cor.mpg")
    record(source, tmp_path / "shop.mcap", RecordOptions())
    log = replayed(tmp_path / "shop.mcap")
    with AnnotatedLog(log) as annotated:
        frames = list(annotated.frames())
    # Far down the corridor and behind the shop's glass are others, a third of their size.
    near = {t.id for f in frames for t in f.tracks if t.present and t.box[3] > 80}
    man, woman = sorted(near)
    pair = [man, woman]
    events = [
        (f.index, e.kind, e.subjects)
        for f in frames
        for e in f.events
        if near.issuperset(e.subjects)
    ]
    steps = [(k, w) for _, k, w in events if k in (*BITS, "single")]
    assert steps == [
        ("grouping", pair),
        ("grouped", pair),
        ("splitting", pair),
        ("single", [man]),
        ("single", [woman]),
    ]
    at = {k: f for f, k, _ in events}
    assert (
        205
        <= at["grouping"]
        < at["grouped"]
        <= 222
        < 230
        <= at["splitting"]
        <= 240
        < at["single"]
        <= 250
    )
    modes = {t.mode for f in frames[at["grouped"] : at["splitting"]] for t in f.tracks}
    assert modes == {"appearance"}, "one blob: both are followed by their appearance"
    assert [
        k for _, k, _ in events if k in ("group_formed", "group_ended", "group_changed")
    ] == [
        "group_formed",
        "group_ended",
    ]
    assert not [e for e in events if e[1] in ("disagreement", "anomaly", "track_lost")]
    here = [{t.id for t in f.tracks if t.present} for f in frames]
    assert man in here[115]
    assert woman in here[389]
