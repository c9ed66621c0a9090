"""What of a log is told once it is read: messages that were recorded twice, detections made for other
picture sizes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import groupby
from statistics import median_low

from recorders.log import Message

Said = tuple[int, int, bytes]
_MOST_AT_ONCE, _MOST_SIZES = 64, 5


class Repeats:
    """Tells messages that were there before: of one topic, with the same times, sequence number
    and data.

    Where many messages have one time, as of a clock that counts seconds, and do not say which
    picture they are of, two that are alike are two.

    Args:
        times: log times of the topic's first messages; None: not known yet, and then only those
            that say which picture they are of count as repeated.
        says: whether a message says which picture it is, or is of.

    Attributes:
        count: how many there were.
        first_ns: the log time of the first.
    """

    def __init__(
        self, times: Sequence[int] | None, says: Callable[[Message], bool]
    ) -> None:
        runs = [len(list(run)) for _, run in groupby(times or [])]
        self._is_coarse = times is None or (bool(runs) and median_low(runs) > 1)
        self._says = says
        self._now = -1
        self._here: list[Said] = []
        self.count = 0
        self.first_ns = 0

    def has(self, message: Message) -> bool:
        """Whether this message was there before."""
        if message.log_time_ns != self._now:
            self._now, self._here = message.log_time_ns, []
        said = (message.publish_time_ns, message.sequence, message.data)
        if said in self._here:
            if self._is_coarse and not self._says(message):
                return False
            self.first_ns = self.first_ns if self.count else message.log_time_ns
            self.count += 1
            return True
        if len(self._here) < _MOST_AT_ONCE:
            self._here.append(said)
        return False

    def notes(self, topic: str) -> list[str]:
        """One line, if there were any."""
        if not self.count:
            return []
        what = "message was" if self.count == 1 else "messages were"
        return [
            f"{self.count} {what} recorded twice on {topic}, the first at {self.first_ns} ns:"
            " read once"
        ]


class SizesMet:
    """The picture sizes that detections were made for, as their messages say them."""

    def __init__(self) -> None:
        self._found: dict[tuple[int, int], tuple[int, int]] = {}

    def take(self, size: tuple[int, int], frame: int) -> None:
        """A frame's detections are made for this size."""
        first, count = self._found.get(size, (frame, 0))
        self._found[size] = first, count + 1

    def notes(self, size: tuple[int, int]) -> list[str]:
        """Where all are of one other size than the recording."""
        if len(self._found) != 1 or size in self._found:
            return []
        (other,) = self._found
        return [f"the detections are made for {_text(other)}: scaled to {_text(size)}"]

    def losses(self, size: tuple[int, int]) -> list[str]:
        """Where they are of several sizes: those that were scaled."""
        if len(self._found) < 2:
            return []
        others = [
            f"{count} of {_text(other)}, the first in frame {first}"
            for other, (first, count) in self._found.items()
            if other != size
        ]
        return [
            f"detections made for several picture sizes were scaled to {_text(size)}:"
            f" {'; '.join(others[:_MOST_SIZES])}"
        ]


def _text(size: tuple[int, int]) -> str:
    return f"{size[0]}x{size[1]}"
