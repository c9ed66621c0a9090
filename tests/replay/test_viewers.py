"""What viewers ask of an annotated log: stamps that match, items in every frame, levels, schemas."""

from __future__ import annotations

from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders import channels
from recorders.log import LogReader, Message
from recorders.messages import EVENT_LEVELS
from replay.annotated_writer import replay
from replay.run import ReplayOptions

LEVELS = {1: "DEBUG", 2: "INFO", 3: "WARNING"}


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("viewers")
    scene = generate("three_way_group", size=(160, 120), frames=80)
    write_scene_log(scene, folder / "scene.mcap", style="merged", pictures="png")
    replay(folder / "scene.mcap", folder / "annotated.mcap", ReplayOptions())
    return folder / "annotated.mcap"


def messages(path: Path, name: str) -> list[Message]:
    with LogReader(path) as log:
        return list(log.messages([f"/camera/{name}"]))


def test_drawings_have_the_stamp_of_their_picture(annotated: Path) -> None:
    pictures = [channels.decode("image", m.data) for m in messages(annotated, "image")]
    drawings = [
        channels.decode("annotations", m.data) for m in messages(annotated, "annotations")
    ]
    assert len(pictures) == len(drawings) == 80
    for picture, drawing in zip(pictures, drawings, strict=True):
        items = [*drawing.circles, *drawing.points, *drawing.texts]
        assert items
        assert all(item.timestamp == picture.timestamp for item in items)


def test_lines_of_the_log_have_the_level_of_their_kind(annotated: Path) -> None:
    lines = [channels.decode("log", m.data) for m in messages(annotated, "log")]
    said = {line.name: LEVELS[line.level] for line in lines}
    assert said["track_confirmed"] == "DEBUG"
    assert said["interaction_started"] == "INFO"
    for name, level in said.items():
        assert level == EVENT_LEVELS.get(name, "INFO"), name


def test_every_topic_has_a_schema_of_today(annotated: Path) -> None:
    with LogReader(annotated) as log:
        for channel in log.channels:
            name = channels.split(channel.topic)[1]
            assert channel.schema == channels.schema(name), channel.topic
