"""What notebooks show, and the notebook of the docs, cell by cell."""

from __future__ import annotations

import ast
import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from fixtures.streams import write_stream
from replay.library import OpenLog, Rows, record, replay
from replay.library.html import table

NOTEBOOK = Path(__file__).parents[2] / "docs" / "notebook.py"


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("notebook")
    film = write_stream(folder / "film.mkv", "matroska", 100, fps=10)
    record(film, folder / "scene.mcap")
    replay(folder / "scene.mcap", folder / "annotated.mcap")
    return folder


def well_formed(html: str) -> ElementTree.Element:
    """The HTML as a tree: every element is closed, every text escaped."""
    assert "<script" not in html
    return ElementTree.fromstring(f"<div>{html}</div>")


def shown(cell: str, names: dict[str, Any]) -> Any:
    """What a cell's last line gives."""
    tree = ast.parse(cell)
    last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
    exec(compile(tree, "cell", "exec"), names)
    if last is None:
        return None
    assert isinstance(last, ast.Expr)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names)


def test_the_notebook_runs(logs: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(logs)
    cells = re.split(
        r"^# %%(?! \[markdown\]).*$", NOTEBOOK.read_text(), flags=re.MULTILINE
    )[1:]
    names: dict[str, Any] = {}
    found = [shown(cell, names) for cell in cells]
    names["log"].close()
    assert len(found) == 5
    assert all(value is not None for value in found)


def test_a_log_is_a_timeline(logs: Path) -> None:
    with OpenLog(logs / "annotated.mcap") as log:
        tree = well_formed(log._repr_html_())
        stays = log.sql("SELECT * FROM presence")
    assert "100 frames, 9.9 s, 192x96, annotated by events" in "".join(tree.itertext())
    assert len(tree.findall(".//rect")) == len(stays) > 0
    with OpenLog(logs / "scene.mcap") as scene:
        assert "a scene log" in scene._repr_html_()


def test_a_frame_is_its_picture_with_boxes(logs: Path) -> None:
    with OpenLog(logs / "annotated.mcap") as log, OpenLog(logs / "scene.mcap") as scene:
        drawn, plain = log[20]._repr_html_(), scene[20]._repr_html_()
    for html in (drawn, plain):
        tree = well_formed(html)
        assert "frame 20, 2.00 s" in "".join(tree.itertext())
        (picture,) = tree.findall(".//img")
        assert picture.attrib["src"].startswith("data:image/jpeg;base64,")
    assert drawn != plain


def test_an_answer_is_a_table(logs: Path) -> None:
    with OpenLog(logs / "annotated.mcap") as log:
        rows = log.sql("SELECT frame, t, 'a <b> & c' AS word FROM frames")
    assert isinstance(rows, Rows)
    tree = well_formed(rows._repr_html_())
    assert len(tree.findall(".//tbody/tr")) == 20
    text = "".join(tree.itertext())
    assert "20 of 100 rows" in text
    assert "a <b> & c" in text
    assert well_formed(table([], [], 0)) is not None
