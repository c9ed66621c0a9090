"""A ready question of somebody else's, in a package of its own."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import scenetrace
from replay.cli import main

DOC = Path(__file__).resolve().parents[2] / "docs" / "library.md"


@pytest.fixture
def installed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The documentation's question, with an entry point."""
    about = tmp_path / "site" / "fast_questions-1.dist-info"
    about.mkdir(parents=True)
    (about / "METADATA").write_text(
        "Metadata-Version: 2.1\nName: fast-questions\nVersion: 1\n"
    )
    (about / "entry_points.txt").write_text(
        "[scenetrace.questions]\nfaster = fast_questions:fast\nbroken = fast_questions:number\n"
    )
    code = re.search(r"^fast = scenetrace\.Question\(.*?^\)$", DOC.read_text(), re.S | re.M)
    assert code is not None
    (tmp_path / "site" / "fast_questions.py").write_text(
        f"import scenetrace\n\n{code[0]}\nnumber = 3\n"
    )
    monkeypatch.syspath_prepend(tmp_path / "site")
    yield
    monkeypatch.delitem(__import__("sys").modules, "fast_questions", raising=False)


@pytest.mark.usefixtures("installed")
def test_it_is_asked_listed_and_explained(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = folder / "annotated.mcap"
    rows = scenetrace.ask(log, "faster", 5)
    assert rows.columns == ["recording", "track", "t", "explain"]
    expected = scenetrace.query(
        log, "SELECT DISTINCT track FROM tracks WHERE vx * vx + vy * vy > 25"
    )
    assert sorted(row[1] for row in rows) == sorted(row[0] for row in expected)
    assert len(rows) > 0
    assert list(scenetrace.ask(log, "fast_questions:fast", 5)) == list(rows)
    assert list(scenetrace.ask(log, "faster", 5, recording="annotated")) == list(rows)
    assert main(["query", str(log), "--ask", "faster", "5", "--format", "csv"]) == 0
    assert capsys.readouterr().out.startswith("recording,track,t,explain")
    assert main(["query", "--ask", "list"]) == 0
    listed = capsys.readouterr().out
    assert re.search(r"^faster V +who moved faster than V pixels", listed, re.M)
    assert re.search(r"^broken +cannot be used: the question broken is int", listed, re.M)


@pytest.mark.usefixtures("installed")
def test_what_is_wrong_with_it_is_told(folder: Path) -> None:
    log = folder / "annotated.mcap"
    with pytest.raises(scenetrace.UsageError, match=r"faster-than V: ValueError.*'quick'"):
        scenetrace.ask(log, "faster", "quick")
    with pytest.raises(
        scenetrace.UsageError, match=r"is int, must be a scenetrace\.Question"
    ):
        scenetrace.ask(log, "broken")
    with pytest.raises(scenetrace.UsageError, match=r"there are: met, .*broken, faster"):
        scenetrace.ask(log, "slower")
