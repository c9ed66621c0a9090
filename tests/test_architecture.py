"""The rooms: imports point one way, each tracker stands alone, OpenCV and the clock come in at
one door.
"""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
ROOMS = ("recorders", "reasoning", "replay", "fixtures")
MAY_IMPORT = {
    "recorders": {"recorders"},
    "reasoning": {"reasoning", "recorders"},
    "fixtures": {"fixtures", "reasoning", "recorders"},
    "replay": {"replay", "reasoning", "recorders"},
}
FILES = sorted(p for room in ROOMS for p in (ROOT / room).rglob("*.py"))


def imported(path: Path) -> list[str]:
    names = []
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: relative import"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


@pytest.mark.parametrize("path", FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_imports_point_one_way(path: Path) -> None:
    room = path.relative_to(ROOT).parts[0]
    allowed = set(MAY_IMPORT[room])
    if "cli" in path.parts:
        allowed.add(
            "fixtures"
        )  # the composition root sees everything: `demo` renders a generated scene
    ours = {name.split(".")[0] for name in imported(path)} & set(ROOMS)
    assert ours <= allowed, f"{path}: {sorted(ours - allowed)}"


@pytest.mark.parametrize("tracker", ["events", "shells", "parts"])
def test_no_tracker_imports_another(tracker: str) -> None:
    others = {f"replay.trackers.{name}" for name in ("events", "shells", "parts")} - {
        f"replay.trackers.{tracker}"
    }
    for path in (ROOT / "replay/trackers" / tracker).rglob("*.py"):
        for name in imported(path):
            assert not any(name.startswith(other) for other in others), (
                f"{path} imports {name}"
            )


# Within recorders: what each part may see of the others, besides the modules that lie in the room
# itself (messages, channels, errors, limits ...), which see none of these.
PARTS = {
    "log": {"log"},
    "formats": {"formats"},
    "annotated": {"annotated", "log"},
    "segmentation": {"segmentation"},
    "sources": {"sources", "formats", "log", "payloads"},
    "recording": {"recording", "sources", "formats", "segmentation", "log"},
}


@pytest.mark.parametrize("part", PARTS)
def test_parts_of_the_recorders_see_those_below_them_alone(part: str) -> None:
    for path in (ROOT / "recorders" / part).rglob("*.py"):
        seen = {
            name.split(".")[1]
            for name in imported(path)
            if name.startswith("recorders.") and name.split(".")[1] in PARTS
        }
        assert seen <= PARTS[part], f"{path} imports {sorted(seen - PARTS[part])}"


def test_opencv_is_imported_in_one_place() -> None:
    users = [p for p in FILES if any(name.split(".")[0] == "cv2" for name in imported(p))]
    assert users == [ROOT / "recorders/vision.py"]


def test_only_questions_read_logs_in_reasoning() -> None:
    for path in (ROOT / "reasoning").rglob("*.py"):
        if "questions" not in path.parts:
            assert not any(name.startswith("recorders.log") for name in imported(path)), (
                path
            )


def test_top_level_is_what_was_agreed() -> None:
    packages = {p.parent.name for p in ROOT.glob("*/__init__.py")}
    assert packages == set(ROOMS)
