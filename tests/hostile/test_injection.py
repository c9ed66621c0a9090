"""Names in a recording that would steer a page, a terminal, a spreadsheet, or a path."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest

from replay.cli import main

NASTY = (
    '"><img src=x onerror=alert(1)>',
    "</script><script>alert(1)</script>",
    "\x1b[2J\x1b]0;owned\x07",
    "=HYPERLINK(A1)",
    "../../escaped",
    "'; DROP TABLE tracks; --",
    "}</style><style>*{display:none;owned:1}",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A scene whose zones and labels bear those names, replayed."""
    folder = tmp_path_factory.mktemp("nasty")
    square = [[0, 0], [640, 0], [640, 480], [0, 480]]
    zones = {name: [[x + k, y] for x, y in square] for k, name in enumerate(NASTY)}
    (folder / "regions.json").write_text(json.dumps({"roi": square, "zones": zones}))
    with (folder / "det.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(["frame", "x1", "y1", "x2", "y2", "score", "label"])
        for frame in range(40):
            for k, name in enumerate(NASTY):
                x = 20 + 80 * k + frame
                rows.writerow([frame, x, 200, x + 40, 300, 0.9, name])
    scene, log = str(folder / "scene.mcap"), str(folder / "annotated.mcap")
    source = str(folder / "det.csv")
    words = ["--fps", "25", "--size", "640x480", "--regions", str(folder / "regions.json")]
    assert main(["record", source, "-o", scene, *words]) == 0
    assert main(["replay", scene, "-o", log]) == 0
    return folder


def outside(folder: Path) -> set[str]:
    return {str(path) for path in folder.parent.rglob("*escaped*")}


def test_a_terminal_is_not_steered(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = str(folder / "annotated.mcap")
    for words in (
        ["query", log, "SELECT DISTINCT zone FROM zones"],
        ["query", log, "SELECT DISTINCT label FROM tracks"],
        ["info", log],
    ):
        capsys.readouterr()
        assert main(words) == 0
        said = capsys.readouterr()
        assert "\x1b" not in said.out + said.err
        assert "\x07" not in said.out + said.err


def test_a_spreadsheet_computes_nothing(folder: Path, tmp_path: Path) -> None:
    log = str(folder / "annotated.mcap")
    answer, tables = tmp_path / "answer.csv", tmp_path / "tables"
    query = "SELECT zone FROM zones ORDER BY zone"
    assert main(["query", log, query, "--format", "csv", "-o", str(answer)]) == 0
    assert main(["export", log, "--to", "csv", "-o", str(tables)]) == 0
    cells = [
        cell
        for path in (answer, tables / "zones.csv", tables / "tracks.csv")
        for row in csv.reader(path.read_text().splitlines())
        for cell in row
    ]
    assert "'=HYPERLINK(A1)" in cells
    formulas = [c for c in cells if c.startswith(("=", "+", "@", "\t", "\r"))]
    assert formulas == []


def test_pages_hold_no_script_of_a_recording(folder: Path, tmp_path: Path) -> None:
    log = str(folder / "annotated.mcap")
    assert main(["report", log, "-o", str(tmp_path / "report.html")]) == 0
    assert main(
        ["evidence", log, "--event-kind", "track_confirmed", "-o", str(tmp_path / "e")]
    ) in (0, 2)
    pages = [*tmp_path.rglob("*.html")]
    assert pages
    for page in pages:
        text = page.read_text()
        assert "<img src=x" not in text
        assert "<script>alert" not in text
        # Within the page's own style sheet nothing of a recording can stand.
        for style in re.findall(r"<style[^>]*>(.*?)</style>", text, re.DOTALL):
            assert "owned" not in style


def test_no_name_leads_out_of_the_output(folder: Path, tmp_path: Path) -> None:
    log = str(folder / "annotated.mcap")
    before = outside(folder)
    for kind in ("csv", "parquet", "coco", "graphml", "srt"):
        assert main(["export", log, "--to", kind, "-o", str(tmp_path / kind)]) in (0, 2, 3)
    assert outside(folder) == before
    assert not outside(tmp_path)


def test_a_name_is_no_sql(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = str(folder / "annotated.mcap")
    capsys.readouterr()
    for name in NASTY:
        assert main(["query", log, "--ask", "who-was-in", name, "--at", "1", "--json"]) == 0
        assert json.loads(capsys.readouterr().out)
