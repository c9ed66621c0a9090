"""Frame numbers as they follow one another in time."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from recorders.errors import RecordingError
from recorders.log import Message

_MOST = 2**63 - 1


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
        if number > _MOST:
            raise RecordingError(
                f"the frame at {now} ns has the number {number}, beyond any count: damaged or"
                " made up; `scenetrace record LOG -o OUT` numbers the frames anew",
                path,
                record=topic,
            )
        if self.interleaves(number):
            raise RecordingError(
                f"frame {number} at {now} ns comes after frame {self.highest}, and frames"
                " before both came earlier still: the recorder's clock was set back, and"
                " frames of two moments alternate; `scenetrace record LOG -o OUT --time"
                " file` follows the file's order",
                path,
                record=topic,
            )


def two_frames(moment: Sequence[Message], topic: str, path: Path) -> RecordingError:
    """That a moment's messages hold two frames: one that was recorded twice, or two."""
    frames = [message for message in moment if message.topic == topic]
    now = frames[0].log_time_ns
    reason = f"two frames at {now} ns; frames need times of their own"
    if len({(message.sequence, message.data) for message in frames}) == 1:
        reason = (
            f"the frame at {now} ns was recorded twice; `scenetrace record LOG -o OUT` reads"
            " it once"
        )
    return RecordingError(reason, path, record=topic)
