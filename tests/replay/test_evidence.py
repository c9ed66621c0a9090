"""Every event's evidence is what `explain` shows: the values of its kind, each that decides beside
its limit.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import msgspec
import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import SCRIPTS, GeneratedScene, generate
from reasoning import events as tell
from reasoning.interactions import InteractionParameters, PairChange
from reasoning.questions.thresholds import event_measures
from reasoning.reasoner import Reasoner
from reasoning.relations import RelationChange
from reasoning.transitions import GROUPED, SPLITTING
from recorders.evidence import EVIDENCE, unlike
from recorders.log import LogReader
from recorders.messages import EVENT_KINDS, Event, Targets
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions
from replay.trackers.catalogue import TRACKERS

PLAYS = ("three_way_group", "full_occlusion", "leave_and_come_back")
FRAMES = 80
Play = tuple[GeneratedScene, list[Targets]]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("evidence")
    found = {}
    for name in PLAYS:
        found[name] = folder / f"{name}.mcap"
        scene = generate(name, size=(160, 120), frames=FRAMES)
        write_scene_log(scene, found[name], style="merged", pictures="png")
    return found


def _replayed(path: Path, tracker: str, hindsight: bool) -> Iterator[Event]:
    config = replay_config(
        tracker, assignments=[f"{tracker}.hindsight={hindsight}".lower()]
    )
    out = path.with_name(f"{path.stem}-{tracker}-{hindsight}.mcap")
    replay(path, out, ReplayOptions(tracker=tracker, config=config))
    with LogReader(out) as log:
        for message in log.messages():
            if message.topic.endswith("/events"):
                yield msgspec.json.decode(message.data, type=Event)


def _from_truth(scene: GeneratedScene, answers: Sequence[Targets]) -> Iterator[Event]:
    reasoner = Reasoner({}, scene.width, scene.height)
    for targets in answers:
        yield from reasoner.step(
            targets.frame, scene.time_ns(targets.frame), targets, scene.truth.regions
        ).events


def _check(events: Iterator[Event]) -> set[str]:
    kinds = set()
    for e in events:
        assert not unlike(e.kind, e.evidence), (e.frame, e.subjects, e.evidence)
        kinds.add(e.kind)
        for m in event_measures(e.evidence):
            if m.threshold is not None:
                assert m.margin is not None
                assert m.margin >= -1e-9, (e.frame, e.kind, m)
    return kinds


def test_every_kind_is_in_the_table() -> None:
    assert set(EVIDENCE) == set(EVENT_KINDS)


@pytest.mark.parametrize("hindsight", [False, True])
@pytest.mark.parametrize("tracker", sorted(TRACKERS))
def test_of_every_tracker(logs: Any, tracker: str, hindsight: bool) -> None:
    kinds = set()
    for path in logs.values():
        kinds |= _check(_replayed(path, tracker, hindsight))
    assert {"track_confirmed", "mode_changed", "joined", "grouped"} <= kinds


def test_of_the_reasoning_alone(play: Callable[..., Play]) -> None:
    kinds = set()
    for name in SCRIPTS:
        kinds |= _check(_from_truth(*play(name)))
    told = set(EVENT_KINDS) - {
        "track_lost",
        "mode_changed",
        "occluded",
        "anomaly",
        "identity",
        "scene_changed",
    }
    assert kinds >= told - {"disagreement", "group_entered_scene"}


def test_of_anomalies() -> None:
    log = tell.EventLog()
    log.open(0, 0)
    torn = RelationChange(
        1, 2, "JOINT", "INTERACTION", "torn", "r", 60.0, 20.0, 20.0, False, 0, 0
    )
    apart = PairChange(1, 2, GROUPED, SPLITTING, 1.5, 0, 0, jumped=True)
    tell.torn(log, torn)
    tell.jumped(log, apart, InteractionParameters())
    tell.forbidden(log, 1, GROUPED, 0)
    assert _check(iter(log.events)) == {"anomaly"}
    assert "jumped" not in log.events[1].text


def test_a_value_out_of_the_table_is_told() -> None:
    assert "extra is unknown" in unlike("occluded", {"evidence": 1.0, "extra": 2})
    assert "evidence has no limit" in unlike("occluded", {"evidence": 1.0, "confidence": 1})
    assert unlike("dancing", {}) == "dancing: no such kind"
