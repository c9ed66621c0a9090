"""What an annotated log says happened, gathered frame by frame: it grows with what happens, not with the frames."""

from __future__ import annotations

from array import array
from bisect import bisect_left
from dataclasses import dataclass, field

import msgspec

from recorders.messages import Event
from replay.annotated import AnnotatedFrame
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
    """A relation's or a group's members while it held without a break; ``label`` is a relation's state or a group's."""

    label: str
    members: tuple[int, ...]
    first: int
    last: int


@dataclass
class Content:
    """One log's tracks, events, relations and groups.

    Attributes:
        frames: which frames there are.
        tracks: in which frames each track is present.
        events: in their order.
        relations, groups: by first frame.
        origin_ns: log time that seconds count from, the recording's start.
    """

    frames: list[Interval] = field(default_factory=list)
    tracks: dict[int, list[Interval]] = field(default_factory=dict)
    events: list[Happening] = field(default_factory=list)
    relations: list[Lasting] = field(default_factory=list)
    groups: list[Lasting] = field(default_factory=list)
    origin_ns: int = 0
    _numbers: array[int] = field(default_factory=lambda: array("q"))
    _times: array[int] = field(default_factory=lambda: array("q"))
    _alive: dict[tuple[str, str], Lasting] = field(default_factory=dict)

    def time_ns(self, frame: int) -> int:
        """A frame's log time; of a frame that is not there, that of the next one."""
        at = min(bisect_left(self._numbers, frame), len(self._times) - 1)
        return self._times[at] if self._times else 0

    def seconds(self, frame: int) -> float:
        """A frame's time in seconds from the recording's start."""
        return (self.time_ns(frame) - self.origin_ns) / NANOS if self._times else 0.0

    def add(self, frame: AnnotatedFrame) -> None:
        """Take the next frame in."""
        k = frame.index
        self._numbers.append(k)
        self._times.append(frame.time_ns)
        extend(self.frames, k)
        for track in frame.tracks:
            if track.present:
                extend(self.tracks.setdefault(track.id, []), k)
        for e in frame.events:
            whole = msgspec.json.encode(e)
            self.events.append(Happening(e.id, e.kind, tuple(e.subjects), tuple(e.groups), k, e.time_ns, whole))
        for edge in frame.relations:
            self._last("relation", f"{edge.a} {edge.b} {edge.state}", edge.state, (edge.a, edge.b), k)
        for group in frame.groups:
            members = tuple(sorted(group.members))
            self._last("group", f"{group.label} {members}", str(group.label), members, k)

    def _last(self, what: str, key: str, label: str, members: tuple[int, ...], frame: int) -> None:
        alive = self._alive.get((what, key))
        if alive is not None and alive.last == frame - 1:
            alive.last = frame
            return
        self._alive[what, key] = alive = Lasting(label, members, frame, frame)
        (self.relations if what == "relation" else self.groups).append(alive)
