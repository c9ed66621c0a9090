"""The commands as functions."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

import scenetrace
from fixtures.logs import write_truth
from fixtures.scenes import generate
from recorders.messages import EVENT_LEVELS
from replay.cli import main


def test_replay_gives_what_the_command_gives(folder: Path, tmp_path: Path) -> None:
    out = tmp_path / "again.mcap"
    done = scenetrace.replay(folder / "scene.mcap", out, "events")
    with scenetrace.open(folder / "annotated.mcap") as log:
        assert log.facts["output_digest"] == done.output_digest
    assert scenetrace.diff(folder / "annotated.mcap", out).differences == []
    assert scenetrace.verify(out).identical


def test_parameters_are_plain_or_typed(folder: Path, tmp_path: Path) -> None:
    plain = {"events": {"hindsight": False}}
    scenetrace.replay(folder / "scene.mcap", tmp_path / "a.mcap", config=plain)
    with scenetrace.open(tmp_path / "a.mcap") as log:
        assert '"hindsight":false' in log.facts["configuration"]
    with pytest.raises(scenetrace.ConfigError, match="hindsigt"):
        scenetrace.replay(
            folder / "scene.mcap", tmp_path / "b.mcap", config={"events": {"hindsigt": 1}}
        )
    assert not (tmp_path / "b.mcap").exists()


def test_record_and_evaluate(tmp_path: Path) -> None:
    scene = generate("pass_by", size=(160, 120), frames=60)
    write_truth(scene, tmp_path / "gt.txt")
    lines = (tmp_path / "gt.txt").read_text().splitlines()
    detections = [",".join([v.split(",")[0], "-1", *v.split(",")[2:]]) for v in lines]
    (tmp_path / "det.txt").write_text("\n".join(detections) + "\n")
    scene_log, out = tmp_path / "scene.mcap", tmp_path / "annotated.mcap"
    done = scenetrace.record(tmp_path / "det.txt", scene_log, fps=25, size=(160, 120))
    assert done.frames == 60
    scenetrace.replay(scene_log, out)
    scores = scenetrace.evaluate(out, tmp_path / "gt.txt")
    assert scores.clear.mota > 80


def test_brief_leaves_out_what_trackers_say_of_themselves(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def kinds(*words: str) -> set[str]:
        command = [
            "query",
            str(folder / "annotated.mcap"),
            "SELECT DISTINCT kind FROM events",
            "--json",
            *words,
        ]
        assert main(command) == 0
        return {row["kind"] for row in json.loads(capsys.readouterr().out)}

    own = {kind for kind, level in EVENT_LEVELS.items() if level == "DEBUG"}
    assert kinds() & own
    assert kinds("--brief") == kinds() - own
    assert kinds("--brief")
