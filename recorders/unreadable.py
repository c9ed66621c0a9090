"""Pictures of logs that cannot be decoded: noted where it happens, told where a command ends."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

from recorders.left_out import LeftOut

_MOST_NAMED = 10_000
_noticed: ContextVar[list[Unreadable] | None] = ContextVar("noticed", default=None)


class Unreadable:
    """Pictures of a topic that could not be decoded: why, by log time."""

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self._reasons: dict[int, tuple[str, int | None]] = {}
        everywhere = _noticed.get()
        if everywhere is not None:
            everywhere.append(self)

    def note(self, time_ns: int, reason: str, frame: int | None = None) -> None:
        """One more, once for each time; ``frame`` is the first frame's that it belongs to."""
        if len(self._reasons) < _MOST_NAMED:
            self._reasons.setdefault(time_ns, (reason, frame))

    def lines(self) -> list[str]:
        """One line for each reason, with the first time and frame."""
        found = LeftOut()
        for time_ns, (reason, frame) in sorted(self._reasons.items()):
            named = "" if frame is None else f" (frame {frame})"
            found.note(reason, f"{time_ns} ns on {self.topic}{named}")
        return found.lines()


@contextmanager
def noticed() -> Iterator[list[Unreadable]]:
    """All that are made inside, in a list that grows: what a command met in whatever it opened."""
    found: list[Unreadable] = []
    token = _noticed.set(found)
    try:
        yield found
    finally:
        _noticed.reset(token)
