"""Frame numbers as they follow one another in time."""

from __future__ import annotations

from pathlib import Path

from recorders.errors import RecordingError


class FrameOrder:
    """Frame numbers as they follow one another in time, to find where those of two moments
    alternate: numbers fall back into a gap that they jumped over.

    A count that begins anew is none.

    Attributes:
        highest: the number before.
    """

    def __init__(self) -> None:
        self.highest = -1
        self._below = -1
        self._above = -1

    def interleaves(self, number: int) -> bool:
        """Whether this number was jumped over before.

        >>> order = FrameOrder()
        >>> [order.interleaves(n) for n in (0, 1, 2, 7, 8, 3)]
        [False, False, False, False, False, True]
        >>> order = FrameOrder()
        >>> [order.interleaves(n) for n in (0, 1, 5, 6, 0, 1)]
        [False, False, False, False, False, False]
        """
        fell_back = number < self.highest and self._below < number < self._above
        if number > self.highest + 1:
            self._below, self._above = self.highest, number
        elif number < self.highest:
            self._below = self._above = -1
        if not fell_back:
            self.highest = number
        return fell_back

    def check(self, number: int, now: int, path: Path, topic: str) -> None:
        """Hold a scene log's next frame, at ``now`` ns, to what `interleaves` asks.

        Raises:
            RecordingError: its number was jumped over before.
        """
        if self.interleaves(number):
            raise RecordingError(
                f"frame {number} at {now} ns comes after frame {self.highest}, and frames"
                " before both came earlier still: the recorder's clock was set back, and"
                " frames of two moments alternate; `scenetrace record LOG -o OUT --time"
                " file` follows the file's order",
                path,
                record=topic,
            )
