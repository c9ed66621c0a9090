"""Scenes of the generator as annotated logs with their pictures, tracks being the truth's."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import GeneratedScene
from fixtures.scripts import Script
from fixtures.targets import truth_targets
from reasoning.reasoner import Reasoner
from recorders import channels
from recorders.log import LogReader, LogWriter

NAMES = ("tracks", "relations", "groups", "events")
Filmed = Callable[..., tuple[GeneratedScene, Path]]


def film(scene: GeneratedScene, path: Path, start_ns: int = 0) -> Path:
    """The scene with pictures (PNG), masks and truth detections, and what is reasoned of truth
    targets.
    """
    plain = write_scene_log(
        scene, path.with_suffix(".scene.mcap"), pictures="png", start_ns=start_ns
    )
    reasoner = Reasoner({}, scene.width, scene.height)
    targets = truth_targets(scene)
    with LogReader(plain) as log, LogWriter(path) as out:
        ids = {
            c.id: out.channel(c.topic, c.schema, c.message_encoding) for c in log.channels
        }
        ours = {
            n: out.channel(
                channels.topic("camera", n),
                channels.schema(n),
                channels.message_encoding(n),
            )
            for n in NAMES
        }
        for message in log.messages():
            now = message.log_time_ns
            out.write(ids[message.channel.id], message.data, now)
            if not message.topic.endswith("/detections"):
                continue
            seen = next(targets)
            made = reasoner.step(seen.frame, now, seen, scene.truth.regions)
            for name in NAMES[:3]:
                out.write(ours[name], channels.encode(name, getattr(made, name)), now)
            for event in made.events:
                out.write(ours["events"], channels.encode("events", event), now)
        out.metadata("scenetrace", {"tracker": "truth", "scene": "scene.mcap"})
    return path


@pytest.fixture(scope="session")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Filmed:
    """A script's scene and its annotated log, each made once."""
    folder = tmp_path_factory.mktemp("filmed")
    made: dict[tuple[str, int], tuple[GeneratedScene, Path]] = {}

    def make(name: str, script: Script, start_ns: int = 0) -> tuple[GeneratedScene, Path]:
        if (name, start_ns) not in made:
            frames = round(script.seconds * script.fps)
            scene = GeneratedScene(name, script, 0, script.size, frames)
            path = folder / f"{name}{'' if not start_ns else '-clocked'}.mcap"
            made[name, start_ns] = scene, film(scene, path, start_ns)
        return made[name, start_ns]

    return make
