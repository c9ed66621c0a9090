"""Small sources: two people who walk past each other, as boxes."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path

import pytest

WORDS = ["--fps", "25", "--size", "640x480"]

WriteWalk = Callable[[Path, int], Path]


def walk(path: Path, start: int = 50, frames: int = 20) -> Path:
    """A MOTChallenge file of two people."""
    lines = []
    for frame in range(1, frames + 1):
        for box_x, step in ((start, 4), (560 - start, -4)):
            lines.append(f"{frame},-1,{box_x + step * frame},200,40,100,1,-1,-1,-1")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return path


def three_sources(folder: Path) -> Path:
    """A folder with three walks, of two cameras."""
    for number in range(3):
        walk(folder / f"cam{number % 2}" / f"w{number}.txt", 20 + 10 * number)
    return folder


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    """A folder with three of them, of two cameras."""
    return three_sources(tmp_path / "in")


def digests(case: Path) -> dict[str, str]:
    """Every file of a case and its SHA-256."""
    return {
        path.relative_to(case).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(case.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }
