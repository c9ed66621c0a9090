"""What an annotated log says happened, gathered frame by frame: it grows with what happens, not
with the frames.
"""

from __future__ import annotations

from array import array
from bisect import bisect_left
from dataclasses import dataclass, field

import msgspec

from recorders.annotated.reader import AnnotatedFrame
from recorders.messages import Event
from replay.compare.intervals import Interval, extend

NANOS = 1_000_000_000


@dataclass(frozen=True, slots=True)
class Happening:
    """An event: what it is matched by, and the whole of it as JSON."""

    id: int
    kind: str
    subjects: tuple[int, ...]
    groups: tuple[int, ...]
    frame: int
    time_ns: int
    whole: bytes

    def event(self) -> Event:
        """The event itself."""
        return msgspec.json.decode(self.whole, type=Event)


@dataclass
class Lasting:
    """A relation's or a group's members while it held without a break; ``label`` is a relation's
    state or a group's.
    """

    label: str
    members: tuple[int, ...]
    first: int
    last: int


@dataclass
class Content:
    """One log's tracks, events, relations and groups.

    Frames are counted by their place among the frames of both logs; `number` gives the
    recording's own count.

    Attributes:
        frames: which frames there are.
        tracks: in which frames each track is present.
        events: in their order.
        relations, groups, encounters: by first frame.
        origin_ns: log time that seconds count from, the recording's start.
    """

    frames: list[Interval] = field(default_factory=list)
    tracks: dict[int, list[Interval]] = field(default_factory=dict)
    events: list[Happening] = field(default_factory=list)
    relations: list[Lasting] = field(default_factory=list)
    groups: list[Lasting] = field(default_factory=list)
    encounters: list[Lasting] = field(default_factory=list)
    origin_ns: int = 0
    _places: array[int] = field(default_factory=lambda: array("q"))
    _numbers: array[int] = field(default_factory=lambda: array("q"))
    _times: array[int] = field(default_factory=lambda: array("q"))
    _alive: dict[tuple[str, str], Lasting] = field(default_factory=dict)

    def _at(self, frame: int) -> int:
        """Where a frame is, or the next one where it is not there."""
        return min(bisect_left(self._places, frame), len(self._places) - 1)

    def time_ns(self, frame: int) -> int:
        """A frame's log time; of a frame that is not there, that of the next one."""
        return self._times[self._at(frame)] if self._times else 0

    def number(self, frame: int) -> int:
        """A frame's number in its log; of a frame that is not there, that of the next one."""
        return self._numbers[self._at(frame)] if self._numbers else 0

    def place(self, number: int) -> int:
        """A frame's place by its number in its log."""
        at = min(bisect_left(self._numbers, number), len(self._places) - 1)
        return self._places[at] if self._places else 0

    def distance_ns(self, frame: int, time_ns: int) -> int:
        """From a time at a place among its frames to the nearest of them; -1 before the first and
        after the last.
        """
        if not self._places or not self._places[0] <= frame <= self._places[-1]:
            return -1
        at = self._at(frame)
        return min(abs(time - time_ns) for time in self._times[max(at - 1, 0) : at + 1])

    def seconds(self, frame: int) -> float:
        """A frame's time in seconds from the recording's start."""
        return (self.time_ns(frame) - self.origin_ns) / NANOS if self._times else 0.0

    def add(self, k: int, frame: AnnotatedFrame) -> None:
        """Take the next frame in, which is the k-th of both logs together."""
        # A frame that only the other log has interrupts nothing.
        gap = k - self._places[-1] if self._places else 1
        self._places.append(k)
        self._numbers.append(frame.index)
        self._times.append(frame.time_ns)
        extend(self.frames, k)
        for track in frame.tracks:
            if track.present:
                extend(self.tracks.setdefault(track.id, []), k, gap)
        for event in frame.events:
            whole = msgspec.json.encode(event)
            self.events.append(
                Happening(
                    event.id,
                    event.kind,
                    tuple(event.subjects),
                    tuple(event.groups),
                    k,
                    frame.time_ns,
                    whole,
                )
            )
        for edge in frame.relations:
            self._last(
                "relation",
                f"{edge.a} {edge.b} {edge.state}",
                edge.state,
                (edge.a, edge.b),
                k,
                gap,
            )
        for group in frame.groups:
            members = tuple(sorted(group.members))
            self._last(
                "group", f"{group.label} {members}", str(group.label), members, k, gap
            )

    def _last(
        self,
        what: str,
        key: str,
        label: str,
        members: tuple[int, ...],
        frame: int,
        gap: int,
    ) -> None:
        alive = self._alive.get((what, key))
        if alive is not None and frame - alive.last <= gap:
            alive.last = frame
            return
        self._alive[what, key] = alive = Lasting(label, members, frame, frame)
        (self.relations if what == "relation" else self.groups).append(alive)
