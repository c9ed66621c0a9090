"""The pattern ``leaving_object`` on the product's own tracks: who left which thing, never who took
it.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fixtures.left_things import LEFT_THINGS
from fixtures.logs import write_scene_log
from fixtures.scenes import GeneratedScene, generate
from reasoning.questions import Case
from reasoning.questions.patterns import plan
from recorders.annotated.reader import AnnotatedLog
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions
from replay.trackers.association import iou

MISSED = {
    "left_bag_taken_back": "out of touch with the bag before it is seen apart from him",
}
"""Scenes in which nothing is found, and why."""


def actor_of(scene: GeneratedScene, log: AnnotatedLog, track: int) -> int:
    """The actor that a track covers in most frames."""
    votes: dict[int, int] = {}
    for frame in log.frames(("tracks",)):
        actors = scene.truth.frames[frame.index].actors
        for told in frame.tracks:
            if told.id == track and told.present and actors:
                overlap = iou(np.array([told.box]), np.array([a.box for a in actors]))[0]
                best = int(np.argmax(overlap))
                if overlap[best] > 0.3:
                    votes[actors[best].id] = votes.get(actors[best].id, 0) + 1
    return max(votes, key=lambda k: votes[k])


@pytest.mark.parametrize("name", sorted(LEFT_THINGS))
def test_who_left_it_is_told_on_tracks(name: str, tmp_path: Path) -> None:
    scene, truth = generate(name), LEFT_THINGS[name]
    log = write_scene_log(scene, tmp_path / "scene.mcap", style="merged")
    out = tmp_path / "annotated.mcap"
    config = replay_config("events", assignments=[])
    replay(log, out, ReplayOptions(tracker="events", config=config, annotations_only=True))
    with Case([out]) as case:
        answer = case.sql(plan("leaving_object"))
        rows = [dict(zip(answer.columns, row, strict=True)) for row in answer.rows]
    with AnnotatedLog(out) as annotated:
        told = [
            (actor_of(scene, annotated, r["owner"]), actor_of(scene, annotated, r["thing"]))
            for r in rows
        ]
    if truth.owner is None or name in MISSED:
        assert told == []
    else:
        assert told == [(truth.owner, truth.thing)]


def test_the_scenes_are_of_several_kinds() -> None:
    takers = {v.taker for v in LEFT_THINGS.values() if v.taker is not None}
    assert any(v.taker not in (None, v.owner) for v in LEFT_THINGS.values())
    assert takers
    assert any(v.owner is None for v in LEFT_THINGS.values())
    assert set(MISSED) < set(LEFT_THINGS)
