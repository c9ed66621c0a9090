"""The code stays as easy to read as it is: the bars of `tests/measures.py`."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest


def _loaded(path: Path) -> ModuleType:
    """A module by its path: the tests are no package."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[path.stem] = module
    spec.loader.exec_module(module)
    return module


measures: Any = _loaded(Path(__file__).with_name("measures.py"))
ROOT, measure, product_files = measures.ROOT, measures.measure, measures.product_files
MOST_TOKENS_A_LINE = 9.0
MOST_ONE_LETTER = 0.10
# Formulas of the papers and geometry keep more of their letters.
MATHEMATICS = {
    "replay/trackers": 0.15,
    "replay/hindsight": 0.19,
    "reasoning/encounters": 0.13,
    "recorders/segmentation": 0.15,
}


def in_mathematics(path: Path) -> bool:
    return any(path.is_relative_to(ROOT / part) for part in MATHEMATICS)


def measured(text: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(measures, "ROOT", tmp_path)
    (tmp_path / "some.py").write_text(text)
    return measure([tmp_path / "some.py"])


def test_what_is_counted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = '"""Docs."""\n\n# A comment.\nclass A:\n    def f(self, k, name):\n        return k + 1\n'
    found = measured(text, tmp_path, monkeypatch)
    assert (found.tokens, found.lines) == (3 + 10 + 4, 3)
    assert (found.names, dict(found.one_letter)) == (3, {"k": 1})
    assert found.shared_classes == {}
    many = measured("f(1, 2, 3, 4, 5, 6, 7, 8)\n", tmp_path, monkeypatch)
    assert many.many_arguments == ["some.py:1 f() 8"]


def test_a_line_of_code_holds_about_one_thought() -> None:
    found = measure(product_files())
    assert found.tokens_a_line <= MOST_TOKENS_A_LINE


def test_names_say_what_they_are() -> None:
    found = measure(product_files())
    assert found.one_letter_share <= MOST_ONE_LETTER, found.by_file.most_common(10)
    plain = measure([path for path in product_files() if not in_mathematics(path)])
    assert plain.one_letter_share <= MOST_ONE_LETTER, plain.by_file.most_common(10)


@pytest.mark.parametrize("part", MATHEMATICS)
def test_mathematics_gets_no_more_letters(part: str) -> None:
    found = measure(sorted((ROOT / part).rglob("*.py")))
    assert found.one_letter_share <= MATHEMATICS[part], found.by_file.most_common(10)


def test_no_two_modules_of_a_package_differ_by_a_suffix_alone() -> None:
    for path in product_files():
        others = {p.stem for p in path.parent.glob("*.py")} - {path.stem}
        alike = [
            other
            for other in others
            for ending in ("s", "d", "ed", "ing", "er", "or", "ion", "_sql", "2")
            if path.stem + ending == other
        ]
        assert not alike, f"{path}: {alike}"
