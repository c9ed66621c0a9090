"""The parameters of encounters are reached from the command line like every other."""

from __future__ import annotations

from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from replay.cli import main


@pytest.fixture(scope="module")
def annotated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("encounters")
    scene = generate("meet_and_walk_on_together", size=(160, 120))
    write_scene_log(scene, folder / "scene.mcap", pictures="none", masks=False)
    assert main(["replay", str(folder / "scene.mcap"), "-o", str(folder / "a.mcap")]) == 0
    return folder / "a.mcap"


def count(annotated: Path, capsys: pytest.CaptureFixture[str], *words: str) -> int:
    query = "SELECT count(*) AS n FROM encounters"
    assert main(["query", str(annotated), query, "--format", "csv", *words]) == 0
    return int(capsys.readouterr().out.split()[1])


def test_a_longer_least_time_leaves_encounters_out(
    annotated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert count(annotated, capsys) == 1
    assert count(annotated, capsys, "--set", "encounters.least_s=60") == 0


def test_an_unknown_one_is_wrong_usage(
    annotated: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert (
        main(["query", str(annotated), "SELECT 1", "--set", "encounters.nonsense=1"]) == 2
    )
    assert "encounters has: " in capsys.readouterr().err


def test_config_prints_them(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config"]) == 0
    assert "[encounters]" in capsys.readouterr().out
