"""Pictures and the detections that belong to them, from one stream of messages.

Where both bear the same stamps, these decide: a detector copies its picture's stamp. Else the
nearest in time within the tolerance belong together, each to one only.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

from recorders.limits import Limits
from recorders.log import Message
from recorders.payloads import Detected
from recorders.sources.log_pictures import Pictured

LATEST_NS = 5_000_000_000
"""How long after its picture a detection of the same stamp is waited for."""
_MOST_WAITING = 4096
_HOLE = 0.75
"""Of a frame: no picture as near to detections is theirs."""


@dataclass(slots=True)
class Joined:
    """A picture with its detections; one of the two may be missing."""

    picture: Pictured | None
    detected: Detected | None
    message: Message | None = None
    """Of detections that lack their picture."""
    late_ns: int = 0
    """How much later than their pictures such detections come."""


@dataclass(slots=True)
class _WaitingPicture:
    time_ns: int
    log_ns: int
    picture: Pictured
    detected: Detected | None = None


@dataclass(slots=True)
class _Found:
    time_ns: int
    detected: Detected
    message: Message = field(repr=False)


class Pairing:
    """Joins pictures and detections as they come.

    Args:
        by_stamp: the messages' own stamps decide; else the times.
        frame_ns: from one picture to the next; where one is missing, its detections stand alone.
        several: there are several messages of detections for a picture.
        tolerance_ns: how far apart two that belong together may be; by stamps, how long after its
            picture a detection is waited for, where that is longer than `LATEST_NS`.
        clock: a message's time for pairing.
        limits: how much may wait.

    Attributes:
        unpaired_pictures, unpaired_detections: how many of each found no partner.
        first_unpaired: the time of the first such detections.
        largest_ns: the largest difference of two that were paired by time.
    """

    def __init__(
        self,
        by_stamp: bool,
        tolerance_ns: int,
        clock: Callable[[Message], int],
        limits: Limits,
        frame_ns: int,
        several: bool = False,
    ) -> None:
        self._hole_ns = max(tolerance_ns, round(_HOLE * frame_ns))
        self._several = several
        self._last: tuple[int, int] | None = None
        self._late_ns = 0
        self._by_stamp = by_stamp
        self._tolerance_ns = tolerance_ns
        self._clock = clock
        self._longest = max(LATEST_NS, tolerance_ns) if by_stamp else tolerance_ns
        self._limits = limits
        self._pictures: deque[_WaitingPicture] = deque()
        self._detections: deque[_Found] = deque()
        self._bytes = 0
        self.unpaired_pictures = self.unpaired_detections = 0
        self.first_unpaired: int | None = None
        self.largest_ns = 0

    def picture(self, found: Pictured) -> Iterator[Joined]:
        """A picture came: what is ready by now."""
        now = self._clock(found.message)
        self._pictures.append(_WaitingPicture(now, found.message.log_time_ns, found))
        self._bytes += _size(found)
        yield from self._ready(found.message.log_time_ns)

    def detections(self, message: Message, found: Detected) -> Iterator[Joined]:
        """Detections came: what is ready by now."""
        now = self._clock(message)
        self._detections.append(_Found(now, found, message))
        yield from self._ready(message.log_time_ns)

    def rest(self) -> Iterator[Joined]:
        """Everything that still waits."""
        yield from self._ready(None)
        while self._detections:
            self._alone(self._detections.popleft())

    def _alone(self, found: _Found) -> None:
        self.unpaired_detections += 1
        if self.first_unpaired is None:
            self.first_unpaired = found.message.log_time_ns

    def _ready(self, now: int | None) -> Iterator[Joined]:
        """Pictures in their order, as soon as nothing better can come for the first."""
        while self._pictures:
            first = self._pictures[0]
            match = self._match(first)
            wait = self._longest
            over = (
                now is None
                or now > first.log_ns + wait
                or self._bytes > self._limits.max_open_bytes
                or len(self._pictures) > _MOST_WAITING
            )
            waits = match is None or not self._by_stamp or self._more_may_come(first)
            if not over and waits:
                return
            yield from self._without_picture(first)
            self._pictures.popleft()
            self._bytes -= _size(first.picture)
            if match is not None:
                self._detections.remove(match)
                self._late_ns = match.time_ns - first.time_ns
                match = self._with_others(match)
                if not self._by_stamp:
                    self.largest_ns = max(
                        self.largest_ns, abs(match.time_ns - first.time_ns)
                    )
            else:
                self.unpaired_pictures += 1
            self._forget(first)
            self._last = first.time_ns, first.picture.stamp_ns
            yield Joined(first.picture, None if match is None else match.detected)

    def _more_may_come(self, first: _WaitingPicture) -> bool:
        """Whether other detections of a picture may still come: until those of another do."""
        stamp = first.picture.stamp_ns
        return self._several and all(d.detected.stamp_ns <= stamp for d in self._detections)

    def _with_others(self, match: _Found) -> _Found:
        """Detections with those that other messages have of the same picture."""
        if not self._several:
            return match
        others = [d for d in self._detections if self._place(d) == self._place(match)]
        for other in others:
            self._detections.remove(other)
            match = _Found(
                match.time_ns, _joined(match.detected, other.detected), match.message
            )
        return match

    def _place(self, found: _Found) -> int:
        return found.detected.stamp_ns if self._by_stamp else found.time_ns

    def _without_picture(self, first: _WaitingPicture) -> Iterator[Joined]:
        """Detections between the last picture and the first that waits, far from both: their own
        picture is missing.
        """
        if self._last is None:
            return
        at = 1 if self._by_stamp else 0
        before, after = self._last[at], (first.time_ns, first.picture.stamp_ns)[at]
        late = 0 if self._by_stamp else self._late_ns
        for found in list(self._detections):
            place = self._place(found) - late
            if before + self._hole_ns <= place <= after - self._hole_ns:
                before = place
                self._detections.remove(found)
                yield Joined(None, found.detected, found.message, self._late_ns)

    def _forget(self, done: _WaitingPicture) -> None:
        """Detections before the next pictures' reach belong to none."""
        wait = self._longest
        while self._detections and (
            self._detections[0].message.log_time_ns < done.log_ns - wait
            or len(self._detections) > _MOST_WAITING
        ):
            self._alone(self._detections.popleft())

    def _match(self, first: _WaitingPicture) -> _Found | None:
        if self._by_stamp:
            stamp = first.picture.stamp_ns
            return next(
                (
                    detection
                    for detection in self._detections
                    if detection.detected.stamp_ns == stamp
                ),
                None,
            )
        near = [
            detection
            for detection in self._detections
            if abs(detection.time_ns - first.time_ns) <= self._tolerance_ns
            and not self._nearer_to_next(detection, first)
        ]
        return min(near, key=lambda d: abs(d.time_ns - first.time_ns), default=None)

    def _nearer_to_next(self, found: _Found, first: _WaitingPicture) -> bool:
        if len(self._pictures) < 2:
            return False
        following = self._pictures[1]
        return abs(found.time_ns - following.time_ns) < abs(found.time_ns - first.time_ns)


def _size(picture: Pictured) -> int:
    return len(picture.message.data)


def _joined(one: Detected, other: Detected) -> Detected:
    """What two messages say of one picture; what both say, once."""
    rows = dict.fromkeys(
        [
            *zip(one.boxes, one.scores, one.labels, strict=True),
            *zip(other.boxes, other.scores, other.labels, strict=True),
        ]
    )
    return replace(
        one,
        boxes=[row[0] for row in rows],
        scores=[row[1] for row in rows],
        labels=[row[2] for row in rows],
    )
