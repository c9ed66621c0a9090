"""The examples of docs/library.md, run as they stand, one after another."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import scenetrace
from fixtures.logs import write_scene_log, write_truth
from fixtures.scenes import generate

DOC = Path(__file__).resolve().parents[2] / "docs" / "library.md"
BLOCKS = [
    (DOC.read_text()[: block.start()].count("\n") + 2, block[1])
    for block in re.finditer(r"^```python\n(.*?)^```", DOC.read_text(), re.S | re.M)
]


def test_the_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    scene = generate("three_way_group", size=(240, 180), frames=100)
    write_scene_log(scene, tmp_path / "scene.mcap")
    write_truth(scene, tmp_path / "gt.txt")
    rows = (line.split(",") for line in (tmp_path / "gt.txt").read_text().splitlines())
    detections = [",".join([row[0], "-1", *row[2:]]) for row in rows]
    (tmp_path / "det.txt").write_text("\n".join(detections) + "\n")
    monkeypatch.chdir(tmp_path)
    names: dict[str, Any] = {"__name__": "examples"}
    for line, code in BLOCKS:
        compiled = compile("\n" * (line - 1) + code, str(DOC), "exec", dont_inherit=True)
        exec(compiled, names)
    assert names["met"] is not None
    assert len(names["entered"]) > 0
    assert len(names["holding"]) > 0
    assert names["boxes"] > 100


def test_every_public_name_is_in_the_table() -> None:
    table = DOC.read_text().split("## All public names")[1]
    listed = set(
        re.findall(
            r"`(\w+)`",
            "\n".join(r.split("|")[1] for r in table.splitlines() if r.startswith("| `")),
        )
    )
    assert listed == set(scenetrace.__all__)
