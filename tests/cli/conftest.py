"""A folder with all the files that the examples of the help name, made from a small generated
scene.
"""

from __future__ import annotations

import importlib.util
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fixtures.logs import export_video, write_regions, write_truth
from fixtures.scenes import GeneratedScene, generate
from recorders.pictures import encode_jpeg
from replay.cli import main

SIZE = (384, 288)
FRAMES = 150
PROGRAM = [
    sys.executable,
    "-c",
    "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))",
]


def _caviar(scene: GeneratedScene) -> str:
    frames = []
    for frame in scene.truth.frames:
        boxes = [
            (a.id, [round(v) for v in a.box]) for a in frame.actors if a.visibility > 0.5
        ]
        objects = "".join(
            f'<object id="{i}"><box xc="{min(max(x + w // 2, 0), SIZE[0] - 1)}" '
            f'yc="{min(max(y + h // 2, 0), SIZE[1] - 1)}" w="{w}" h="{h}"/></object>'
            for i, (x, y, w, h) in boxes
        )
        frames.append(
            f'<frame number="{frame.index}"><objectlist>{objects}</objectlist></frame>'
        )
    return f"<dataset>{''.join(frames)}</dataset>"


def _detections(scene: GeneratedScene) -> str:
    rows = [
        f"{f.index + 1},-1,{a.box[0]},{a.box[1]},{a.box[2]},{a.box[3]},1"
        for f in scene.truth.frames
        for a in f.actors
        if a.visibility > 0.5
    ]
    return "\n".join(rows) + "\n"


def done(*words: object) -> None:
    """A command that has to work."""
    assert main([str(w) for w in words]) == 0, words


def _pictures(scene: GeneratedScene, folder: Path) -> None:
    folder.mkdir()
    for index, _, image in scene.frames():
        (folder / f"{index + 1:06d}.jpg").write_bytes(encode_jpeg(image, 75))


def _inputs(folder: Path, constant_model: Callable[..., Path]) -> None:
    """What is recorded, and what goes with it. Two frames a second, so that it lasts a minute."""
    scene = generate("three_way_group", seed=1, size=SIZE, frames=FRAMES)
    _pictures(scene, folder / "img1")
    export_video(scene, folder / "video.avi")
    write_truth(scene, folder / "gt.txt", min_visible=0.3)
    (folder / "det.txt").write_text(_detections(scene))
    constant_model(
        folder / "yolo11n.onnx",
        {"output0": np.zeros((1, 84, 189), np.float32)},
        (1, 3, 96, 96),
    )
    (folder / "Walk1.xml").write_text(_caviar(scene))
    shutil.copy(folder / "Walk1.xml", folder / "sequence.xml")
    regions = json.loads(write_regions(scene, folder / "regions.json").read_bytes())
    regions["zones"] = {"bench": regions["roi"][0]}
    (folder / "regions.json").write_text(json.dumps(regions))


def _scene_logs(folder: Path) -> None:
    recorded = ("record", folder / "img1", "--fps", 2)
    looked = ("--regions", folder / "regions.json", "--codec", "jpeg")
    done(*recorded, *looked, "-o", folder / "scene.mcap")
    alone = ("--camera", "front", "--detect", "none")
    done(*recorded, *alone, "-o", folder / "bag.mcap")
    data = (folder / "scene.mcap").read_bytes()
    (folder / "scene.mcap.part").write_bytes(data[: len(data) // 2])
    # Two recordings to fit features on (one may not be given twice), and one to score.
    for name, until in (("a", 30), ("b", 20), ("other", 30)):
        span = ("--from", 0, "--to", until, "-o", folder / f"{name}.mcap")
        done("cut", folder / "scene.mcap", *span)
        shutil.copy(folder / "gt.txt", folder / f"{name}.txt")


def _annotated_logs(folder: Path) -> None:
    scene = folder / "scene.mcap"
    for name, again, change in (("before", "monday", 0.11), ("after", "tuesday", 0.12)):
        out = ("-o", folder / f"{name}.mcap", "--annotations-only")
        done("replay", scene, *out, "--set", f"shell_model.k_s={change}")
        shutil.copy(folder / f"{name}.mcap", folder / f"{again}.mcap")
    done("replay", scene, "-o", folder / "annotated.mcap", "--checkpoint", 20)
    (folder / "recordings").mkdir()
    shutil.copy(folder / "before.mcap", folder / "recordings")


def _made_of_them(folder: Path) -> None:
    annotated = folder / "annotated.mcap"
    done("export", annotated, "--to", "mot", "-o", folder / "result.txt")
    days = [folder / "monday.mcap", folder / "tuesday.mcap"]
    done("index", *days, "-o", folder / "case.duckdb")
    rows = ("--format", "csv", "-o", folder / "answers.csv")
    done("query", annotated, "SELECT * FROM events", *rows)
    if importlib.util.find_spec("cryptography"):
        done("seal", "--new-key", folder / "lab.key")
        sealed = [folder / "scene.mcap", annotated]
        done("seal", *sealed, "-o", folder / "case.json", "--key", folder / "lab.key")


@pytest.fixture(scope="session")
def examples(made_once: Callable[..., Path], constant_model: Callable[..., Path]) -> Path:
    """The folder; copy it before changing it (fixture `folder`)."""

    def fill(folder: Path) -> None:
        _inputs(folder, constant_model)
        _scene_logs(folder)
        _annotated_logs(folder)
        _made_of_them(folder)

    return made_once("examples", fill)


@pytest.fixture
def folder(examples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of the examples' folder, which is the working directory."""
    copy = tmp_path / "work"
    shutil.copytree(examples, copy)
    monkeypatch.chdir(copy)
    return copy


@pytest.fixture
def start() -> Callable[..., subprocess.Popen[bytes]]:
    """Start `scenetrace` with words as a process of its own; stdout and stderr are pipes unless
    told.
    """

    def begin(*words: object, **more: object) -> subprocess.Popen[bytes]:
        streams = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, **more}
        return subprocess.Popen([*PROGRAM, *map(str, words)], **streams)  # type: ignore[call-overload]

    return begin
