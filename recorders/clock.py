"""A recorder's clock as it is: stamps that repeat, stand far off, or start anew, made into times
that increase.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby, pairwise
from statistics import median_low
from typing import Generic, TypeVar

Item = TypeVar("Item")
_RESTART_FRAMES = 3
_GAP_FRAMES, _GAP_NS = 10, 2_000_000_000
_MOST_GAPS = 20
_BURST_STEPS, _BURST_RATIO = 8, 4
_CAMERA_NS, _CLIP_NS = 5_000_000, 10_000_000_000


class Gaps:
    """The times in which nothing was recorded: steps of over ten frame times and 2 s.

    Attributes:
        found: frame number and length in ns of each, the first twenty.
    """

    def __init__(self, frame_ns: int) -> None:
        self._least = max(_GAP_NS, _GAP_FRAMES * frame_ns)
        self._last: int | None = None
        self.found: list[tuple[int, int]] = []

    def step(self, frame: int, time_ns: int) -> None:
        """A frame came."""
        if self._last is not None:
            length = time_ns - self._last
            if length > self._least and len(self.found) < _MOST_GAPS:
                self.found.append((frame, length))
        self._last = time_ns

    def lines(self) -> list[str]:
        """One line for each."""
        return [
            f"a gap of {seconds(length)} before frame {frame}: nothing was recorded then"
            for frame, length in self.found
        ]


class Clock(Generic[Item]):
    """Stamps into times that increase, counted from the first.

    - A stamp that its successor belies, because that lies between it and its predecessor, is
      replaced by one frame time after the predecessor.
    - Where stamps go back by more than three frame times, a new segment begins: it follows its
      predecessor by one frame time, and keeps its own steps.
    - Any other stamp that does not increase follows its predecessor by one frame time, or stands
      halfway to its successor where that is nearer.

    Attributes:
        mended, joined, belied: how many of each.
        gaps: when nothing was recorded.
    """

    def __init__(self, frame_ns: int) -> None:
        self._frame_ns = max(1, frame_ns)
        self._offset = 0
        self._last: int | None = None
        self._stamped = 0
        self._count = 0
        self.mended = self.joined = self.belied = 0
        self.gaps = Gaps(frame_ns)

    def times(
        self, stamped: Iterable[tuple[int | None, Item]]
    ) -> Iterator[tuple[int, Item]]:
        """Time in ns and item for each stamp (None: not known) and item, in the same order."""
        held: tuple[int | None, Item] | None = None
        for following in stamped:
            if held is not None:
                yield self._next(held[0], following[0]), held[1]
            held = following
        if held is not None:
            yield self._next(held[0], None), held[1]

    def _next(self, stamp: int | None, following: int | None) -> int:
        time = self._time(stamp, following)
        self.gaps.step(self._count, time)
        self._last = time
        self._count += 1
        return time

    def _time(self, stamp: int | None, following: int | None) -> int:
        last = self._last
        if last is None:
            self._offset = -(stamp or 0)
            self._stamped = 0
            return 0
        usual = last + self._frame_ns
        if stamp is None:
            self._stamped = usual
            return usual
        time = stamp + self._offset
        after = last if following is None else following + self._offset
        if last < after < time:
            self.belied += 1
            self._stamped = min(usual, (last + after + 1) // 2)
            return self._stamped
        before, self._stamped = self._stamped, time
        if time > last:
            return time
        # Frames of one time may have run ahead of it: only a stamp tells that it went back.
        if time < before - _RESTART_FRAMES * self._frame_ns:
            self.joined += 1
            self._offset += usual - time
            self._stamped = usual
            return usual
        self.mended += 1
        return min(usual, (last + after + 1) // 2) if after > last else usual

    def notes(self, what: str = "frames") -> list[str]:
        """What was made of the stamps, one line each."""
        found = []
        if self.mended:
            found.append(
                f"{self.mended} {what} had times that did not increase; they follow their"
                " predecessors by one frame time"
            )
        if self.belied:
            found.append(
                f"{self.belied} {what} had times far off their neighbours'; they follow"
                " their predecessors by one frame time"
            )
        if self.joined:
            found.append(
                f"the clock was set back {self.joined} time{'s' * (self.joined > 1)}: each segment follows the one"
                " before by one frame time"
            )
        return found + self.gaps.lines()


def nominal_ns(times: Sequence[int]) -> int | None:
    """The time between frames: the median step, or, where most come in bursts, the median of the
    mean over some steps in a row. Steps of a camera's with long times between are clips, not
    bursts. Frames of one time, as of a clock that counts seconds, share the
    step to the next. None where no two times differ.

    >>> nominal_ns([0, 40, 80, 120, 160]), nominal_ns([0, 1, 2, 3, 160, 161, 162, 163, 320, 321])
    (40, 40)
    >>> nominal_ns([0, 0, 0, 0, 160, 160, 160, 160, 320])
    40
    >>> hour, frame = 3_600_000_000_000, 40_000_000
    >>> nominal_ns([hour * clip + frame * k for clip in range(9) for k in range(5)])
    40000000
    """
    steps = [max(0, b - a) for a, b in pairwise(times)]
    if not any(steps):
        return None
    alike = median_low(len(list(run)) for _, run in groupby(times[:-1]))
    if alike > 1:
        return median_low(step for step in steps if step) // alike or 1
    width = min(_BURST_STEPS, len(steps))
    means = [
        sum(steps[index : index + width]) // width
        for index in range(len(steps) - width + 1)
    ]
    median, mean = median_low([step for step in steps if step]), median_low(means)
    is_clips = median >= _CAMERA_NS and mean >= _CLIP_NS
    return mean if mean > _BURST_RATIO * median and not is_clips else median


def seconds(length_ns: int) -> str:
    """A length of time for a person.

    >>> seconds(90_500_000_000), seconds(28_800_000_000_000)
    ('90.5 s', '28800 s (8 h 0 min)')
    """
    value = length_ns / 1e9
    if value < 3600:
        return f"{value:.4g} s"
    minutes = round(value / 60)
    hours, days = minutes // 60, minutes // 1440
    if days:
        return f"{value:.0f} s ({days} d {hours % 24} h)"
    return f"{value:.0f} s ({hours} h {minutes % 60} min)"
