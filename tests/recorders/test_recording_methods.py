"""`record` with detectors: a network's, one in Python, with masks and without."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders.log import LogReader
from recorders.messages import Detections
from recorders.pictures import encode_png
from recorders.scene import SceneLog
from replay.cli import main

DETECTOR = """
class Bright:
    '''Everything over 200, as one box.'''

    def detect(self, image):
        rows, columns = (image.min(axis=2) > 200).nonzero()
        if len(rows):
            x, y = int(columns.min()), int(rows.min())
            yield (x, y, int(columns.max()) + 1 - x, int(rows.max()) + 1 - y), 0.9, "lamp"

class Wrong:
    def detect(self, image):
        return [((0, 0, 5), 0.5)]

class Broken:
    def detect(self, image):
        raise ValueError("no\\nlight")

class Other:
    pass
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "pictures"
    path.mkdir()
    ground = np.random.default_rng(0).integers(90, 130, (96, 96, 3), np.uint8)
    for k in range(12):
        image = ground.copy()
        image[30:60, 4 * k : 4 * k + 12] = 250
        (path / f"{k:03}.png").write_bytes(encode_png(image))
    return path


@pytest.fixture
def lamps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    (tmp_path / "lamps_of_a_test.py").write_text(textwrap.dedent(DETECTOR))
    monkeypatch.syspath_prepend(str(tmp_path))
    return "lamps_of_a_test"


def run(*words: object) -> int:
    return main(["record", *map(str, words)])


def facts(out: Path) -> dict[str, str]:
    with LogReader(out) as log:
        return dict(log.metadata())["scenetrace"]


def detections(out: Path) -> list[Detections]:
    with SceneLog(out) as scene:
        return [frame.detections for frame in scene.frames()]


def test_a_detector_in_python_finds_labels_and_stands_in_the_log(
    tmp_path: Path, folder: Path, lamps: str
) -> None:
    out = tmp_path / "a.mcap"
    assert run(folder, "--fps", 5, "-o", out, "--detect", f"{lamps}:Bright") == 0
    found = detections(out)
    assert [d.boxes for d in found[:2]] == [[(0, 30, 12, 30)], [(4, 30, 12, 30)]]
    assert found[3].labels == ["lamp"]
    told = facts(out)
    assert told["detect"] == f"{lamps}:Bright"
    assert json.loads(told["detector"])["version"].startswith("sha256:")
    with LogReader(out) as log:
        assert "/camera/foreground" not in [c.topic for c in log.channels]


def test_masks_and_detector_together_give_blobs(
    tmp_path: Path, folder: Path, lamps: str
) -> None:
    out = tmp_path / "a.mcap"
    words = ("--detect", "motion", "--detect", f"{lamps}:Bright")
    assert run(folder, "--fps", 5, "-o", out, *words) == 0
    found = detections(out)
    assert facts(out)["detect"] == f"motion,{lamps}:Bright"
    seen = [d for d in found if d.components and d.boxes]
    assert len(seen) >= 10
    assert all(d.blobs[0] >= 1 for d in seen)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("Wrong", "in frame 0: ((0, 0, 5), 0.5); wanted"),
        ("Broken", r"in frame 0: ValueError: no\nlight"),
        ("Other", "has no method detect(image)"),
        ("Absent", "has no 'Absent'"),
    ],
)
def test_detectors_that_fail_are_named(
    tmp_path: Path,
    folder: Path,
    lamps: str,
    capsys: pytest.CaptureFixture[str],
    name: str,
    said: str,
) -> None:
    out = tmp_path / "a.mcap"
    code = run(folder, "--fps", 5, "-o", out, "--detect", f"{lamps}:{name}")
    assert code in (1, 2)
    error = capsys.readouterr().err
    assert said in error
    assert len(error.strip().splitlines()) == 1
    assert not out.exists()


def test_a_network_with_labels_and_least_score(
    tmp_path: Path, folder: Path, constant_model: Callable[..., Any]
) -> None:
    rows = np.zeros((1, 300, 6), np.float32)
    rows[0, 0] = [10, 20, 40, 60, 0.9, 0]
    rows[0, 1] = [50, 20, 80, 60, 0.5, 1]
    rows[0, 2] = [50, 70, 80, 90, 0.2, 1]
    model = constant_model(
        tmp_path / "m.onnx",
        {"output0": rows},
        (1, 3, 96, 96),
        metadata={"names": "{0: 'person', 1: 'car'}"},
    )
    out = tmp_path / "a.mcap"
    words = (folder, "--fps", 5, "-o", out, "--detect", "onnx", "--model", model)
    assert run(*words) == 0
    assert detections(out)[0].labels == ["person", "car"]
    told = json.loads(facts(out)["detector"])
    assert (told["model"], told["format"], told["min_score"]) == (
        "m.onnx",
        "end2end",
        "0.25",
    )
    assert run(*words, "--force", "--labels", "car", "--min-score", 0.1) == 0
    assert detections(out)[0].scores == pytest.approx([0.5, 0.2])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--detect", "onnx"], "--detect onnx needs --model FILE.onnx"),
        (["--model", "m.onnx"], "--model m.onnx goes with --detect onnx"),
        (["--detect", "motion", "--model", "m.onnx"], "goes with --detect onnx"),
        (["--labels", "person"], "--labels goes with --detect onnx"),
        (["--min-score", ".5"], "--min-score goes with --detect onnx"),
        (["--detect", "motion,density"], "one way to masks at a time"),
        (["--detect", "none,motion"], "none goes with nothing else"),
        (["--detect", "people"], "must be one of motion, threshold, density, onnx"),
        (["--detect", "onnx", "--model", "m.onnx", "--min-score", "2"], "must be in"),
    ],
)
def test_words_that_do_not_go_together(
    tmp_path: Path,
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    assert run(folder, "--fps", 5, "-o", tmp_path / "a.mcap", *words) == 2
    assert said in capsys.readouterr().err


def test_a_detector_beside_given_detections_is_refused(
    tmp_path: Path, folder: Path, lamps: str, capsys: pytest.CaptureFixture[str]
) -> None:
    given = tmp_path / "det.txt"
    given.write_text("1,-1,10,10,20,20,0.9,-1,-1,-1\n")
    words = ("--detections", given, "--detect", f"{lamps}:Bright")
    assert run(folder, "--fps", 5, "-o", tmp_path / "a.mcap", *words) == 2
    assert "comes with detections" in capsys.readouterr().err
