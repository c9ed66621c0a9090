"""Who was where in an annotated log: what a correction is held against before it is written."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import dataclass, field

from recorders.annotated.provenance import CORRECTIONS
from recorders.annotated.reader import AnnotatedLog
from recorders.corrections import CorrectedSighting, Corrections, parse_corrections
from recorders.messages import Box
from replay.correcting.names import Names


@dataclass
class Presence:
    """A track's frames in order, in each whether it was seen, and its box."""

    frames: list[int] = field(default_factory=list)
    seen: list[bool] = field(default_factory=list)
    boxes: list[Box] = field(default_factory=list)

    def add(self, frame: int, seen: bool, box: Box) -> None:
        """Take the next frame."""
        self.frames.append(frame)
        self.seen.append(seen)
        self.boxes.append(box)

    def witness(self, track: int, at: int) -> CorrectedSighting:
        """Where it was, as a correction records it."""
        x, y, w, h = (round(v, 1) for v in self.boxes[at])
        return CorrectedSighting(track, self.frames[at], x, y, w, h)


@dataclass
class Book:
    """An annotated log's tracks.

    Attributes:
        times: every frame's time in seconds, by frame.
        tracks: by id as the log has it.
        joined: by id: the forward ids of the fragments that hindsight joined into it.
        applied: the corrections that the log was made with.
    """

    times: dict[int, float] = field(default_factory=dict)
    tracks: dict[int, Presence] = field(default_factory=dict)
    joined: dict[int, list[int]] = field(default_factory=dict)
    applied: Corrections | None = None

    @classmethod
    def of(cls, log: AnnotatedLog) -> Book:
        """Read a log once."""
        book = cls()
        text = log.facts.get(CORRECTIONS)
        if text is not None:
            book.applied = parse_corrections(text, log.path)
        for frame in log.frames(("tracks", "events")):
            book.times[frame.index] = (frame.time_ns - log.start_ns) / 1e9
            for t in frame.tracks:
                if t.present:
                    book.tracks.setdefault(t.id, Presence()).add(
                        frame.index, t.observed, t.box
                    )
            for e in frame.events:
                later = e.evidence.get("fragment")
                if e.kind == "track_recovered" and isinstance(later, int):
                    book.joined.setdefault(e.subjects[0], []).append(later)
        return book

    def under(self, names: Names) -> Book:
        """The same tracks as they are after corrections that the log was not made with."""
        rows: dict[int, dict[int, tuple[bool, Box]]] = {}
        for track, there in self.tracks.items():
            for frame, seen, box in zip(there.frames, there.seen, there.boxes, strict=True):
                name = names.at(track, frame).name
                if name is None:
                    continue
                own = rows.setdefault(name, {})
                if seen or frame not in own:
                    own[frame] = seen, box
        made = Book(self.times, {}, self.joined, self.applied)
        for track in sorted(rows):
            presence = made.tracks[track] = Presence()
            for frame in sorted(rows[track]):
                presence.add(frame, *rows[track][frame])
        return made

    def frame_at(self, t: float) -> int | None:
        """The first frame at or after a time in seconds, None after the last one."""
        frames = list(self.times)
        # A time that was read off an answer is rounded.
        place = bisect_left(frames, t - 0.0051, key=lambda f: self.times[f])
        return frames[place] if place < len(frames) else None

    def span(self, track: int) -> str:
        """From when to when a track is there, in words."""
        frames = self.tracks[track].frames
        return f"from {self.times[frames[0]]:.2f} to {self.times[frames[-1]]:.2f} s"
