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

from fixtures.logs import export_images, export_video, write_regions, write_truth
from fixtures.scenes import GeneratedScene, generate
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


@pytest.fixture(scope="session")
def examples(
    tmp_path_factory: pytest.TempPathFactory, constant_model: Callable[..., Path]
) -> Path:
    """The folder; copy it before changing it (fixture `folder`). Two frames a second, so that it
    lasts a minute.
    """
    folder = tmp_path_factory.mktemp("examples")
    scene = generate("three_way_group", seed=1, size=SIZE, frames=FRAMES)
    export_images(scene, folder / "img1")
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
    words = (
        "record",
        folder / "img1",
        "--fps",
        2,
        "--regions",
        folder / "regions.json",
        "--codec",
        "jpeg",
    )
    done(*words, "-o", folder / "scene.mcap")
    alone = ("--camera", "front", "--detect", "none")
    done("record", folder / "img1", "--fps", 2, *alone, "-o", folder / "bag.mcap")
    data = (folder / "scene.mcap").read_bytes()
    (folder / "scene.mcap.part").write_bytes(data[: len(data) // 2])
    for name, change in (
        ("annotated", 0.10),
        ("before", 0.11),
        ("after", 0.12),
        ("monday", 0.13),
        ("tuesday", 0.14),
    ):
        setting = ("--set", f"shell_model.k_s={change}")
        done(
            "replay",
            folder / "scene.mcap",
            "-o",
            folder / f"{name}.mcap",
            "--annotations-only",
            *setting,
        )
    done(
        "replay",
        folder / "scene.mcap",
        "-o",
        folder / "annotated.mcap",
        "--force",
        "--checkpoint",
        20,
    )
    done("export", folder / "annotated.mcap", "--to", "mot", "-o", folder / "result.txt")
    done(
        "index",
        folder / "monday.mcap",
        folder / "tuesday.mcap",
        "-o",
        folder / "case.duckdb",
    )
    done(
        "query",
        folder / "annotated.mcap",
        "SELECT * FROM events",
        "--format",
        "csv",
        "-o",
        folder / "answers.csv",
    )
    for name in ("a", "b", "other"):
        shutil.copy(folder / "scene.mcap", folder / f"{name}.mcap")
        shutil.copy(folder / "gt.txt", folder / f"{name}.txt")
    # Two recordings to fit features on: one may not be given twice.
    done(
        "record",
        folder / "img1",
        "--fps",
        2,
        "--codec",
        "png",
        "-o",
        folder / "b.mcap",
        "--force",
    )
    if importlib.util.find_spec("cryptography"):
        done("seal", "--new-key", folder / "lab.key")
        sealed = [folder / name for name in ("scene.mcap", "annotated.mcap")]
        done("seal", *sealed, "-o", folder / "case.json", "--key", folder / "lab.key")
    (folder / "recordings").mkdir()
    shutil.copy(folder / "before.mcap", folder / "recordings")
    return folder


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
