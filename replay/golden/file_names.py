"""Golden files' names: the test's own, unless two tests would have one file. Nothing heavy:
pytest reads it early.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from pathlib import Path


def golden_name(test: str) -> str:
    """A test's name as a file's.

    >>> golden_name("test_scene[two people-events]")
    'test_scene-two-people-events'
    """
    return re.sub(r"[^A-Za-z0-9_.-]+", "-", test).strip("-")


class Owners:
    """Which test has which golden file."""

    def __init__(self) -> None:
        self._tests: dict[tuple[Path, str], list[str]] = {}
        self._claimed: dict[tuple[Path, str], str] = {}

    def collected(self, tests: Iterable[tuple[Path, str, str]]) -> None:
        """The tests of a run that use the fixture: folder, name and node id of each."""
        for folder, test, node in tests:
            self._tests.setdefault((folder, golden_name(test)), []).append(node)

    def claim(self, folder: Path, name: str, node: str, given: bool) -> str | None:
        """Take a file for a test; what is wrong with that, in words, where another test has it.

        Args:
            folder: where the file lies.
            name: without ``.mcap``.
            node: the test's node id.
            given: the call named it; else it is the test's own name, which others may share.
        """
        alike = [] if given else self._tests.get((folder, name), [])
        other = next((n for n in alike if n != node), None) or self._claimed.get(
            (folder, name), node
        )
        self._claimed.setdefault((folder, name), node)
        if other == node:
            return None
        return (
            f"two tests have one golden file, {name}.mcap:\n  {other}\n  {node}\n"
            "Give one of them another with golden_scene(..., name=...)."
        )
