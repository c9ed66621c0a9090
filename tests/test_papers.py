"""docs/papers.md: every row names code that is there and tests that are collected."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
HEAD = "| rule | where it lives | test | deviation and its effect |"


def rows_of(text: str) -> list[list[str]]:
    """The cells of every row below such a head."""
    rows: list[list[str]] = []
    within = False
    for line in text.splitlines():
        if line == HEAD:
            within = True
        elif not line.startswith("|"):
            within = False
        elif within and not line.startswith("|--"):
            rows.append([cell.strip() for cell in line.strip("|").split("|")])
    return rows


def faults(rows: list[list[str]]) -> list[str]:
    """What is wrong with rows: code or tests that do not exist, cells that are empty."""
    wrong: list[str] = []
    for row in rows:
        rule = row[0]
        if len(row) != 4 or not all(row):
            wrong.append(f"{rule}: must have four cells, none empty")
            continue
        for path in re.findall(r"`([^`]+)`", row[1]) or [""]:
            if not (ROOT / path).is_file():
                wrong.append(f"{rule}: no file {path!r}")
        for test in re.findall(r"`([^`]+)`", row[2]) or [""]:
            wrong += [f"{rule}: no test {test!r}"] if not exists(test) else []
    return wrong


def exists(test: str) -> bool:
    """Whether a test, ``file.py::name`` from tests/, or a file with tests, is there."""
    name, _, function = test.partition("::")
    path = ROOT / "tests" / name
    if not name.endswith(".py") or not path.is_file():
        return False
    tree = ast.parse(path.read_text())
    found = {n.name for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)}
    if function:
        return function.startswith("test_") and function in found
    return any(f.startswith("test_") for f in found)


def test_every_row_names_code_and_tests_that_are_there() -> None:
    text = (ROOT / "docs" / "papers.md").read_text()
    rows = rows_of(text)
    assert len(rows) == sum(
        line.startswith("| ") and line != HEAD for line in text.splitlines()
    )
    assert len(rows) > 30
    assert faults(rows) == []


@pytest.mark.parametrize(
    ("row", "told"),
    [
        ("| a | `replay/engine.py` | `test_papers.py::test_gone` | none |", "no test"),
        ("| a | `replay/engine.py` | shown by nothing | none |", "no test"),
        ("| a | `replay/gone.py` | `test_papers.py` | none |", "no file"),
        ("| a | `replay/engine.py` | `test_papers.py` | |", "four cells"),
    ],
)
def test_a_row_that_names_what_is_not_there_fails(row: str, told: str) -> None:
    (fault,) = faults(rows_of(f"{HEAD}\n|---|---|---|---|\n{row}\n"))
    assert told in fault
