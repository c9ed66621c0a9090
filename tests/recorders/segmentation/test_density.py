"""The density segmenter: the same from run to run and whatever the threads."""

from __future__ import annotations

from pathlib import Path

from fixtures.logs import export_video
from fixtures.scenes import generate
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from recorders.vision import cv2


def test_density_is_the_same_with_any_number_of_threads(tmp_path: Path) -> None:
    video = export_video(generate("three_fish", seed=3, frames=40), tmp_path / "fish.mp4")
    logs, threads = [], cv2.getNumThreads()
    try:
        for k, count in enumerate((1, 4, 1)):
            cv2.setNumThreads(count)
            logs.append(tmp_path / f"{k}.mcap")
            record(open_source(video), logs[-1], RecordOptions(detect="density"))
    finally:
        cv2.setNumThreads(threads)
    assert logs[0].read_bytes() == logs[1].read_bytes() == logs[2].read_bytes()
    with SceneLog(logs[0]) as scene:
        assert sum(len(frame.boxes) for frame in scene.frames()) >= 3 * 30
