"""A small scene, recorded and replayed once for all tests of the library."""

from __future__ import annotations

from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from replay.annotated_writer import replay
from replay.run import ReplayOptions


@pytest.fixture(scope="session")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """``scene.mcap`` with pictures and masks, ``annotated.mcap``, ``span.mcap`` (frames 30 to 39,
    annotations alone).
    """
    place = tmp_path_factory.mktemp("library")
    scene = generate("three_way_group", size=(240, 180), frames=120)
    recorded = write_scene_log(scene, place / "scene.mcap")
    replay(recorded, place / "annotated.mcap", ReplayOptions("events"))
    frame_ns = 1_000_000_000 // 25
    with_span = ReplayOptions(
        "events", from_ns=30 * frame_ns, to_ns=40 * frame_ns, annotations_only=True
    )
    replay(recorded, place / "span.mcap", with_span)
    return place
