"""Every command that reads a log takes `--limit`, and means it."""

from __future__ import annotations

from pathlib import Path

import pytest

from replay.cli import main

READING = [
    ["query", "annotated.mcap", "SELECT 1"],
    ["verify", "annotated.mcap"],
    ["verify", "--quick", "annotated.mcap"],
    ["report", "annotated.mcap", "-o", "limits.html"],
    ["evidence", "annotated.mcap", "--events", "1", "-o", "limits-evidence"],
    ["explain", "annotated.mcap", "1"],
    ["export", "annotated.mcap", "--to", "mot", "-o", "limits.txt"],
    ["export", "annotated.mcap", "--to", "json", "-o", "limits.json"],
    ["export", "annotated.mcap", "--to", "graphml", "-o", "limits.graphml"],
    ["export", "annotated.mcap", "--to", "csv", "-o", "limits.csv"],
    ["index", "annotated.mcap", "-o", "limits.duckdb"],
    ["diff", "annotated.mcap", "annotated.mcap"],
    ["eval", "annotated.mcap", "--truth", "truth.txt"],
    ["info", "annotated.mcap"],
    ["replay", "scene.mcap", "-o", "limits.mcap"],
    ["cut", "annotated.mcap", "--to", "1", "-o", "limits.mcap"],
    ["find", "annotated.mcap", "--colour", "red"],
    ["view", "annotated.mcap"],
    ["seal", "annotated.mcap", "-o", "limits.seal.json"],
    ["fit", "annotated.mcap", "--truth", "truth.txt", "-o", "limits.toml"],
]


@pytest.mark.parametrize("words", READING, ids=" ".join)
def test_a_limit_holds(
    words: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if "truth.txt" in words:
        Path("truth.txt").write_text("1,1,10,10,20,40,1,-1,-1,-1\n")
    capsys.readouterr()
    limit = ["--limit", "max_channels=2"]
    assert main([*words, *limit]) == 1
    assert "over the limit max_channels = 2" in capsys.readouterr().err
    assert not list(Path().glob("limits*"))


@pytest.mark.parametrize("word", ["max_chanels=2", "max_channels=-1", "max_channels"])
def test_no_such_limit(word: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["query", "annotated.mcap", "SELECT 1", "--limit", word]) == 2
    assert "--limit" in capsys.readouterr().err
