"""Small sources: two people who walk past each other, as boxes."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from replay.batch.jobs import Job, Outcome
from replay.batch.nursery import Nursery

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


class _Lent:
    """A nursery that goes on after its batch."""

    def __init__(self, free: list[Nursery]) -> None:
        self._free = free
        self._nursery: Nursery | None = free.pop() if free else Nursery()

    def do(self, job: Job) -> Outcome:
        assert self._nursery is not None
        return self._nursery.do(job)

    def close(self) -> None:
        if self._nursery is not None:
            self._free.append(self._nursery)
        self._nursery = None


@pytest.fixture(scope="session")
def _free_nurseries() -> Iterator[list[Nursery]]:
    free: list[Nursery] = []
    yield free
    for nursery in free:
        nursery.close()


@pytest.fixture(scope="module", autouse=True)
def _lent_nurseries(_free_nurseries: list[Nursery]) -> Iterator[None]:
    """Batches of one test after another use the same nurseries: each job is in a process of its
    own all the same, and loading everything takes longer than these jobs. Commands that a test
    starts as a process have their own.
    """
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("replay.batch.engines.Nursery", lambda: _Lent(_free_nurseries))
        yield
