"""What the documents name is there: files, folders, modules, and their names."""

from __future__ import annotations

import importlib
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("recorders", "reasoning", "replay", "fixtures")
PAGES = [
    *sorted((ROOT / "docs").glob("*.md")),
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md")),
]
EXAMPLES = ("nearest.py", "conftest.py", "test_nearest.py")
"""Files of docs/golden.md's example, which a reader writes."""
PLACEHOLDER = re.compile(r"\bNAME\b")
HOUSE = {
    path.relative_to(ROOT).as_posix()
    for room in (*ROOMS, "tests", "docs")
    for path in (ROOT / room).rglob("*")
    if "__pycache__" not in path.parts
}


def missing(text: str) -> list[str]:
    """Files, folders and dotted names of this project that a text names and that do not exist."""
    files = set(re.findall(r"(?<![\w./-])[\w./-]+\.py\b", text))
    files |= {
        path.rstrip("/")
        for path in re.findall(rf"`((?:{'|'.join(ROOMS)}|tests)/[^` ]*)`", text)
    }
    names = set(re.findall(rf"`((?:{'|'.join(ROOMS)})(?:\.\w+)+)`", text))
    wrong = [file for file in files if not _is_file(file.partition("::")[0])]
    return sorted(wrong + [name for name in names if not _is_name(name)])


def _is_file(path: str) -> bool:
    """Whether it is a path from the root or from tests/, or the bare name of some file."""
    if PLACEHOLDER.search(path) or path in EXAMPLES or (ROOT / path).exists():
        return True
    if "/" in path:
        return f"tests/{path}" in HOUSE
    return any(found.endswith(f"/{path}") for found in HOUSE)


def _is_name(dotted: str) -> bool:
    """Whether it is a module, or what one holds."""
    parts = dotted.split(".")
    for length in range(len(parts), 0, -1):
        module = "/".join(parts[:length])
        if f"{module}.py" in HOUSE or f"{module}/__init__.py" in HOUSE:
            value: object = importlib.import_module(module.replace("/", "."))
            for part in parts[length:]:
                if not hasattr(value, part):
                    return False
                value = getattr(value, part)
            return True
    return False


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_names_what_is_there(page: Path) -> None:
    assert missing(page.read_text(encoding="utf-8")) == []


def test_what_is_not_there_is_told() -> None:
    text = (
        "`recorders/gone.py`, gone_too.py, `replay/nowhere/`, `replay.run.Gone`, `replay.gone`;"
        " `replay/run.py`, `replay.run.Run`, kalman.py, `replay/trackers/NAME/`"
    )
    assert missing(text) == [
        "gone_too.py", "recorders/gone.py", "replay.gone", "replay.run.Gone", "replay/nowhere",
    ]  # fmt: skip


def test_the_map_names_every_folder() -> None:
    text = (ROOT / "docs/architecture.md").read_text(encoding="utf-8")
    folders = {
        path.rpartition("/")[0]
        for path in HOUSE
        if path.startswith(ROOMS) and path.endswith("/__init__.py")
    }
    inner = ("replay/trackers/", "recorders/segmentation/", "reasoning/questions/")
    rooms = {f for f in folders if f not in ROOMS and not f.startswith(inner)}
    named = re.findall(r"`([\w/]+)/`", text) + re.findall(r"`([\w/]+)/", text)
    # `replay/verification.py`, `compare/`: a folder beside what stands before it.
    named += [f"replay/{name}" for name in named]
    assert sorted(rooms - set(named)) == []
