"""Gaps in a recording: times in which there is no frame, where there should be some."""

from __future__ import annotations

from collections.abc import Sequence

from reasoning import events as tell

SECOND_NS = 1_000_000_000
LEAST_S = 2.0
"""A gap is longer than this,"""
INTERVALS = 10
"""and than so many of the intervals between the frames before."""
REMEMBERED = 5
"""Usual is the median of so many intervals."""


class Pauses:
    """Tells of gaps: frames that come much later than is usual."""

    def __init__(self) -> None:
        self._times: list[int] = []

    def step(self, log: tell.EventLog, time_ns: int) -> None:
        """Take the next frame's time."""
        self._times.append(time_ns)
        *before, now = self.intervals
        if before:
            usual = sorted(before)[len(before) // 2]
            limit = max(LEAST_S * SECOND_NS, INTERVALS * usual)
            if now > limit:
                _tell(log, now, limit, usual)
        del self._times[: -REMEMBERED - 1]

    @property
    def intervals(self) -> list[int]:
        """Between the last frames, ns; [0] at the first one."""
        return [b - a for a, b in zip(self._times, self._times[1:], strict=False)] or [0]

    def state(self) -> list[int]:
        """The last frames' times, ns."""
        return list(self._times)

    def restore(self, state: Sequence[int]) -> None:
        """Go on from there."""
        self._times = list(state)


def _tell(log: tell.EventLog, now: int, limit: float, usual: int) -> None:
    tell.scene_changed(
        log,
        "gap",
        {
            "gap_s": tell.seconds(now),
            "gap_s_over": round(limit / SECOND_NS, 3),
            "usual_s": tell.seconds(usual),
        },
        f"Nothing was recorded for {_duration(now)}.",
    )


def _duration(ns: int) -> str:
    """A duration in words.

    >>> _duration(28_800_000_000_000), _duration(90_500_000_000), _duration(3_000_000_000)
    ('8 h 0 min', '1 min 30 s', '3.0 s')
    """
    whole = ns // SECOND_NS
    if whole >= 3600:
        return f"{whole // 3600} h {whole % 3600 // 60} min"
    if whole >= 60:
        return f"{whole // 60} min {whole % 60} s"
    return f"{ns / SECOND_NS:.1f} s"
