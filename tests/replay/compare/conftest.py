"""One scene and its replay, shared by the tests of differences.

The truth of the scripted scene stands in for a tracker, so that what happens does not change when
trackers get better.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from fixtures.targets import truth_targets
from recorders.messages import Targets
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions

FRAMES = 200
SCENE = generate("three_way_group", seed=1, size=(96, 72), frames=FRAMES)
ANSWERS = list(truth_targets(SCENE))


class Truth:
    """A tracker that knows; its state is how far it is."""

    def __init__(self, scene: object, config: object) -> None:
        self.done = 0

    def step(self, frame: Any) -> Targets:
        self.done += 1
        return Targets(frame.index, ANSWERS[frame.index].targets)

    def state(self) -> dict[str, int]:
        return {"done": self.done}

    def restore(self, state: Mapping[str, int]) -> None:
        self.done = state["done"]


Told = Callable[..., Path]


@pytest.fixture(scope="session")
def truth() -> type[Truth]:
    return Truth


@pytest.fixture(scope="session")
def told() -> Told:
    """Replay a scene with the truth for a tracker: ``told(scene, out, "section.field=value",
    ...)``.
    """

    def run(scene: Path, out: Path, *assignments: str, **more: Any) -> Path:
        config = replay_config(Truth, assignments=assignments)
        replay(
            scene,
            out,
            ReplayOptions(tracker=Truth, config=config, force=True, **more),
        )
        return out

    return run


@pytest.fixture(scope="session")
def trusted(tmp_path_factory: pytest.TempPathFactory, told: Told) -> Path:
    """A folder with ``scene.mcap``, three people who meet and merge, and ``annotated.mcap``, its
    story.
    """
    folder = tmp_path_factory.mktemp("trusted")
    write_scene_log(SCENE, folder / "scene.mcap", style="merged", pictures="png")
    told(folder / "scene.mcap", folder / "annotated.mcap", checkpoint_ns=2_000_000_000)
    return folder


@pytest.fixture(scope="session")
def by_events(trusted: Path) -> Path:
    """The same scene through a tracker of the catalogue."""
    out = trusted / "events.mcap"
    replay(trusted / "scene.mcap", out, ReplayOptions(config=replay_config("events")))
    return out
