"""The loop reads ahead of the tracker, and nobody notices."""

from __future__ import annotations

from pathlib import Path

import pytest

from recorders import channels
from recorders.errors import RecordingError
from recorders.log import LogWriter
from recorders.messages import Detections
from recorders.scene import SceneLog
from replay.engine import Engine


@pytest.mark.parametrize("damaged", [0, 1, 3, 4, 9])
def test_frames_before_a_damaged_one_are_all_given_out(
    tmp_path: Path, damaged: int
) -> None:
    with LogWriter(tmp_path / "s.mcap") as log:
        channel = log.channel("/camera/detections", channels.schema("detections"), "json")
        # The first 64 are looked at when the scene is opened.
        for k in range(64 + 12):
            data = (
                b"{"
                if k == 64 + damaged
                else channels.encode("detections", Detections(k, 64, 48))
            )
            log.write(channel, data, k * 40_000_000)
    with SceneLog(tmp_path / "s.mcap") as scene:
        engine = Engine(scene, "events")
        for k in range(64 + damaged):
            assert (found := engine.step()) is not None
            assert found.frame.index == k
        with pytest.raises(RecordingError, match="not a detections message"):
            engine.step()
