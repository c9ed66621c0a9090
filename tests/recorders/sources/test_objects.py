"""Objects of other libraries, told by what they have."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from recorders.errors import UsageError
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import ObjectSource


def test_supervision_and_norfair_say_the_same(tmp_path: Path) -> None:
    corners = np.array([[10, 20, 30, 60], [50, 20, 80, 90]], np.float32)
    supervision = SimpleNamespace(
        xyxy=corners,
        confidence=np.array([0.5, 0.75], np.float32),
        class_id=np.array([0, 2]),
        data={"class_name": np.array(["person", "car"])},
    )
    norfair = [
        SimpleNamespace(points=c.reshape(2, 2), scores=np.array([s, s]), label=name)
        for c, s, name in zip(corners, (0.5, 0.75), ("person", "car"), strict=True)
    ]
    tracked = [SimpleNamespace(estimate=c.reshape(2, 2), label=None) for c in corners]
    source = ObjectSource([supervision, norfair, tracked, []], (320, 240), 25)
    done = record(source, tmp_path / "scene.mcap", RecordOptions())
    assert (done.frames, done.detections, done.losses) == (4, 6, ())
    with SceneLog(tmp_path / "scene.mcap") as scene:
        found = [frame.detections for frame in scene.frames()]
    assert found[0].boxes == found[1].boxes == found[2].boxes
    assert found[0].boxes == [(10, 20, 20, 40), (50, 20, 30, 70)]
    assert (found[0].scores, found[0].labels) == ([0.5, 0.75], ["person", "car"])
    assert (found[1].scores, found[1].labels) == ([0.5, 0.75], ["person", "car"])
    assert found[3].boxes == []


def test_boxes_that_are_none_are_left_out_and_told() -> None:
    bad = SimpleNamespace(
        xyxy=[(10, 10, 10, 20), (900, 0, 910, 9), (1, 1, float("nan"), 9)]
    )
    source = ObjectSource([bad], (320, 240), 25)
    assert [f.detections.boxes for f in source.frames() if f.detections] == [[]]
    assert source.losses == [
        "a box that is none: 2 times, the first at frame 0",
        "a box beyond the picture, at frame 0",
    ]


def test_what_is_neither_is_named() -> None:
    with pytest.raises(UsageError, match="neither supervision's Detections nor"):
        list(ObjectSource([3], (320, 240), 25).frames())
