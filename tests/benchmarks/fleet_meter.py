"""Processor time of this process and all that it started, whoever waited for them or did not."""

from __future__ import annotations

import os
import threading
from pathlib import Path
from typing import NamedTuple, Self

_EVERY_S = 0.3


class _Process(NamedTuple):
    """A process as it was seen last: its parent, its name, seconds with the children that it
    waited for.
    """

    parent: int
    name: str
    used: float


class Meter:
    """Measures while it is entered.

    Who is waited for counts with its parent. A Ray node waits for none of its workers: they count as
    they were seen last.

    Attributes:
        seconds: of all processors, when it is left.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._seen: dict[int, _Process] = {}
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, daemon=True)

    def __enter__(self) -> Self:
        self._before = _tree()
        self._seen = dict(self._before)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._ended.set()
        self._thread.join()
        now = _tree()
        lost = [
            one
            for number, one in self._seen.items()
            if number not in now and self._is_unwaited(one)
        ]
        used = sum(one.used for one in [*now.values(), *lost])
        self.seconds = used - sum(one.used for one in self._before.values())

    def _is_unwaited(self, one: _Process) -> bool:
        parent = self._seen.get(one.parent)
        return parent is not None and parent.name.startswith(("raylet", "ray::"))

    def _watch(self) -> None:
        while not self._ended.wait(_EVERY_S):
            self._seen |= _tree()


def _tree() -> dict[int, _Process]:
    tick = os.sysconf("SC_CLK_TCK")
    there = {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            head, _, rest = stat.read_text().rpartition(")")
        except OSError:
            continue  # it has just ended
        fields = rest.split()
        there[int(stat.parent.name)] = _Process(
            int(fields[1]),
            head.partition("(")[2],
            sum(map(int, fields[11:15])) / tick,
        )
    ours, new = set[int](), {os.getpid()}
    while new:
        ours |= new
        new = {number for number, one in there.items() if one.parent in new}
    return {number: one for number, one in there.items() if number in ours}
