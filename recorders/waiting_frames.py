"""Which picture belongs to which frame, where their times are not the same."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

from recorders.log import Message
from recorders.pictures import Image
from recorders.scene_frame import Frame


@dataclass(frozen=True)
class TimedPicture:
    """A picture's message and what decodes it."""

    message: Message
    load: Callable[[int], Image | None]


class WaitingFrames:
    """Frames until it is known which picture is theirs: that of their own time, else the nearest
    within the tolerance, the earlier one of two that are as near.
    """

    def __init__(self, tolerance_ns: int, has_images: bool) -> None:
        self._tolerance_ns = tolerance_ns
        self._has_images = has_images
        self._frames: deque[tuple[Frame, TimedPicture | None]] = deque()

    def frame(self, frame: Frame, last: TimedPicture | None) -> Iterator[Frame]:
        """A frame came, the last picture before it or with it."""
        if last is not None:
            apart = frame.time_ns - last.message.log_time_ns
            if apart == 0 and not self._frames:
                yield _given(frame, last)
                return
            last = last if apart <= self._tolerance_ns else None
        if not self._has_images:
            yield frame
            return
        self._frames.append((frame, last))

    def picture(self, found: TimedPicture) -> Iterator[Frame]:
        """A picture came: the frames that it decides for."""
        now = found.message.log_time_ns
        while self._frames:
            frame, before = self._frames[0]
            apart = now - frame.time_ns
            nearer = before is None or apart < frame.time_ns - before.message.log_time_ns
            chosen = found if apart <= self._tolerance_ns and nearer else before
            self._frames.popleft()
            yield _given(frame, chosen)

    def ready(self, now: int) -> Iterator[Frame]:
        """The frames that no picture from ``now`` on can belong to."""
        while self._frames and now > self._frames[0][0].time_ns + self._tolerance_ns:
            yield _given(*self._frames.popleft())

    def rest(self) -> Iterator[Frame]:
        """All that still wait."""
        while self._frames:
            yield _given(*self._frames.popleft())


def _given(frame: Frame, picture: TimedPicture | None) -> Frame:
    if picture is not None:
        frame.give_picture(picture.message, partial(picture.load, frame.index))
    return frame
