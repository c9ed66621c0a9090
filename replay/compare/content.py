"""What an annotated log says happened, gathered from its frames in one reading."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Event
from replay.annotated import AnnotatedFrame, AnnotatedLog

NANOS = 1_000_000_000


@dataclass
class Span:
    """Something that lasts from a frame to a frame, both included."""

    first: int
    last: int


@dataclass
class GroupLife(Span):
    """A group's members while they stayed the same, under one label."""

    label: int
    members: tuple[int, ...]


@dataclass
class Content:
    """An annotated log's tracks, events, relations and groups.

    Attributes:
        boxes: (N, 6) float64: frame, track, x, y, w, h; by frame, then track.
        relations: (a, b, state) to the spans in which it held.
        groups: by first frame.
    """

    path: Path
    start_ns: int = 0
    times: dict[int, int] = field(default_factory=dict)
    rows: array[float] = field(default_factory=lambda: array("d"))
    events: list[Event] = field(default_factory=list)
    relations: dict[tuple[int, int, str], list[Span]] = field(default_factory=dict)
    groups: list[GroupLife] = field(default_factory=list)
    _alive: dict[int, GroupLife] = field(default_factory=dict)

    @property
    def boxes(self) -> NDArray[np.float64]:
        """All present tracks' boxes."""
        return np.frombuffer(self.rows, np.float64).reshape(-1, 6) if self.rows else np.zeros((0, 6))

    def seconds(self, frame: int) -> float:
        """A frame's time in seconds from the start."""
        return (self.times.get(frame, self.start_ns) - self.start_ns) / NANOS

    def add(self, frame: AnnotatedFrame) -> None:
        """Take the next frame in."""
        k = frame.index
        if not self.times:
            self.start_ns = frame.time_ns
        self.times[k] = frame.time_ns
        for track in frame.tracks:
            if track.present:
                self.rows.extend((k, track.id, *track.box))
        self.events += frame.events
        for edge in frame.relations:
            spans = self.relations.setdefault((edge.a, edge.b, edge.state), [])
            if spans and spans[-1].last == k - 1:
                spans[-1].last = k
            else:
                spans.append(Span(k, k))
        for group in frame.groups:
            life = self._alive.get(group.label)
            members = tuple(sorted(group.members))
            if life is None or life.last != k - 1 or life.members != members:
                self._alive[group.label] = life = GroupLife(k, k, group.label, members)
                self.groups.append(life)
            life.last = k


def read_content(path: str | Path, limits: Limits = DEFAULT_LIMITS) -> Content:
    """Read an annotated log's meaning; pictures are never read.

    Raises:
        RecordingError: not an annotated log, or a damaged one.
    """
    content = Content(Path(path))
    with AnnotatedLog(path, limits=limits) as log:
        for frame in log.frames(("tracks", "relations", "groups", "events")):
            content.add(frame)
    return content
