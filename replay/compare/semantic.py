"""Compare two annotated logs by what they say happened."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import LogReader
from recorders.messages import Event
from replay.chain import recorded_frames
from replay.compare.content import Content, GroupLife, Span, read_content
from replay.compare.difference import Comparison, Difference
from replay.compare.matching import TrackMatch, match_tracks
from replay.facts import facts_of


@dataclass(frozen=True)
class CompareOptions:
    """What counts as the same.

    Attributes:
        tolerance_px: a matched track's box may be off by so much on each side. 0: any difference counts.
        tolerance_s: an event or an interval's end may be off by so much and still counts as moved, not as another one.
    """

    tolerance_px: float = 0.0
    tolerance_s: float = 1.0


def compare(
    a: str | Path, b: str | Path, options: CompareOptions | None = None, limits: Limits = DEFAULT_LIMITS
) -> Comparison:
    """Compare log B with log A.

    Tracks are matched by place, so other numbers are no difference; events by kind, subjects and time; relations and
    groups by their intervals.

    Raises:
        RecordingError: one of them is not an annotated log, or is damaged.
    """
    options = options or CompareOptions()
    if _same_digests(a, b, limits):
        frames = len(read_content(a, limits).times)
        return Comparison(str(a), str(b), True, frames, {}, [])
    left, right = read_content(a, limits), read_content(b, limits)
    matched = match_tracks(left, right)
    comparer = _Comparer(left, right, matched, options)
    found = [*comparer.frames(), *comparer.tracks(), *comparer.events(), *comparer.relations(), *comparer.groups()]
    found.sort(key=lambda d: (d.frame, d.what, d.change, d.subjects, d.text))
    shared = len(set(left.times) & set(right.times))
    return Comparison(str(a), str(b), False, shared, matched.partner, found)


def _same_digests(a: str | Path, b: str | Path, limits: Limits) -> bool:
    with LogReader(a, limits) as left, LogReader(b, limits) as right:
        cameras = [facts_of(log).camera for log in (left, right)]
        theirs = recorded_frames(right, cameras[1])
        for ours in recorded_frames(left, cameras[0]):
            other = next(theirs, None)
            # The payloads themselves: a log that was edited still carries its old digests.
            if other is None or (ours.time_ns, ours.payloads) != (other.time_ns, other.payloads):
                return False
        return next(theirs, None) is None


class _Comparer:
    def __init__(self, a: Content, b: Content, matched: TrackMatch, options: CompareOptions) -> None:
        self.a, self.b = a, b
        self.matched = matched
        self.options = options
        self.back = {other: track for track, other in matched.partner.items()}
        self.shared = set(a.times) & set(b.times)

    def _translated(self, tracks: Sequence[int]) -> tuple[int, ...]:
        """Tracks of B by their numbers in A; an unmatched one by a negative number, which no track has."""
        return tuple(sorted(self.back.get(track, -1 - track) for track in tracks))

    # -- frames and tracks -----------------------------------------------------------------------------------------

    def frames(self) -> Iterator[Difference]:
        """Frames that only one log has."""
        for content, other, change in ((self.a, self.b, "vanished"), (self.b, self.a, "appeared")):
            alone = sorted(set(content.times) - set(other.times))
            if alone:
                name = "A" if change == "vanished" else "B"
                text = f"{len(alone)} frames are in {name} only, from frame {alone[0]} to frame {alone[-1]}"
                yield Difference("frames", change, alone[0], content.seconds(alone[0]), [], text)

    def tracks(self) -> Iterator[Difference]:
        """Tracks without a partner, tracks that change it, tracks that lie elsewhere."""
        yield from self._alone(self.a, set(self.matched.partner), "vanished", "track {} is not in B")
        yield from self._alone(self.b, set(self.back), "appeared", "track {} of B is not in A")
        for frame, track, other in self.matched.swaps:
            partner = self.matched.partner.get(track)
            if partner is None:
                continue
            text = f"track {track} (B's {partner}) is B's track {other} at {self.a.seconds(frame):.1f} s"
            yield Difference(
                "identity", "changed", frame, self.a.seconds(frame), [track], text, {"partner": partner, "other": other}
            )
        for track, rows in self.matched.places.items():
            yield from self._moved(track, rows)

    def _alone(self, content: Content, known: set[int], change: str, text: str) -> Iterator[Difference]:
        boxes = content.boxes
        mine = boxes[np.isin(boxes[:, 0], sorted(self.shared))]
        ids, first, count = np.unique(mine[:, 1].astype(int), return_index=True, return_counts=True)
        for track, at, frames in zip(ids.tolist(), first.tolist(), count.tolist(), strict=True):
            if track not in known:
                frame = int(mine[at, 0])
                t = content.seconds(frame)
                words = f"{text.format(track)}: {frames} frames from {t:.1f} s"
                yield Difference("track", change, frame, t, [track], words, {"frames": frames})

    def _moved(self, track: int, rows: np.ndarray) -> Iterator[Difference]:
        boxes_a, boxes_b = self.a.boxes, self.b.boxes
        ours, theirs = boxes_a[rows[:, 0]], boxes_b[rows[:, 1]]
        off = np.abs(ours[:, 2:] - theirs[:, 2:])
        corner = np.abs(ours[:, 2:4] + ours[:, 4:] - theirs[:, 2:4] - theirs[:, 4:])
        worst = np.maximum(off[:, :2], corner).max(axis=1, initial=0.0)
        far = worst > self.options.tolerance_px
        if far.any():
            first = int(ours[far][0, 0])
            t = self.a.seconds(first)
            text = (
                f"track {track} lies elsewhere in {int(far.sum())} of {len(rows)} frames, "
                f"by up to {worst.max():.2f} px, first at {t:.1f} s"
            )
            details = {"frames": int(far.sum()), "largest_px": float(worst.max())}
            yield Difference("track", "moved", first, t, [track], text, details)
        both = [self.a.boxes[self.a.boxes[:, 1] == track, 0], self._frames_of_b(self.matched.partner.get(track, -1))]
        missing = sorted(self.shared & (set(both[0].astype(int).tolist()) ^ set(both[1].astype(int).tolist())))
        if missing and track in self.matched.partner:
            t = self.a.seconds(missing[0])
            text = f"track {track} is in {len(missing)} frames of one log only, first at {t:.1f} s"
            yield Difference("track", "changed", missing[0], t, [track], text, {"frames": len(missing)})

    def _frames_of_b(self, track: int) -> np.ndarray:
        frames: np.ndarray = self.b.boxes[self.b.boxes[:, 1] == track, 0]
        return frames

    # -- events ----------------------------------------------------------------------------------------------------

    def events(self) -> Iterator[Difference]:
        """Events by kind and subjects, each matched to the nearest in time."""
        left: dict[tuple[str, tuple[int, ...]], list[Event]] = {}
        right: dict[tuple[str, tuple[int, ...]], list[Event]] = {}
        for e in self.a.events:
            if e.frame in self.shared:
                left.setdefault((e.kind, tuple(sorted(e.subjects))), []).append(e)
        for e in self.b.events:
            if e.frame in self.shared:
                right.setdefault((e.kind, self._translated(e.subjects)), []).append(e)
        for key in [*left, *(k for k in right if k not in left)]:
            yield from self._event_kind(key[0], left.get(key, []), right.get(key, []))

    def _event_kind(self, kind: str, ours: list[Event], theirs: list[Event]) -> Iterator[Difference]:
        pairs, lost, new = _nearest([e.time_ns for e in ours], [e.time_ns for e in theirs], self.options.tolerance_s)
        for i, j in pairs:
            a, b = ours[i], theirs[j]
            if a.frame != b.frame:
                ta, tb = self.a.seconds(a.frame), self.b.seconds(b.frame)
                text = f"{_subject(a)} {_verb(kind)} at {tb:.2f} s, no longer at {ta:.2f} s"
                details = {"frame_a": a.frame, "frame_b": b.frame, "event_a": a.id, "event_b": b.id}
                yield Difference("event", "moved", min(a.frame, b.frame), min(ta, tb), list(a.subjects), text, details)
        for i in lost:
            a = ours[i]
            t = self.a.seconds(a.frame)
            text = f"{_subject(a)} no longer {_verb(kind)} at {t:.1f} s"
            yield Difference("event", "vanished", a.frame, t, list(a.subjects), text, {"kind": kind, "event_a": a.id})
        for j in new:
            b = theirs[j]
            t = self.b.seconds(b.frame)
            text = f"{_subject(b)} (B) now {_verb(kind)} at {t:.1f} s"
            yield Difference("event", "appeared", b.frame, t, list(b.subjects), text, {"kind": kind, "event_b": b.id})

    # -- relations and groups --------------------------------------------------------------------------------------

    def relations(self) -> Iterator[Difference]:
        """Relations by their intervals."""
        theirs = {(*self._translated(key[:2]), key[2]): (key, spans) for key, spans in self.b.relations.items()}
        for key, spans in self.a.relations.items():
            other = theirs.pop(key, (key, []))[1]
            yield from self._spans(f"{key[2]} of {key[0]} and {key[1]}", "relation", list(key[:2]), spans, other)
        for key, spans in theirs.values():
            yield from self._spans(f"{key[2]} of {key[0]} and {key[1]} (B)", "relation", list(key[:2]), [], spans)

    def groups(self) -> Iterator[Difference]:
        """Groups by members; their labels are only names."""
        ours, theirs = _by_members(self.a.groups), _by_members(self.b.groups, self._translated)
        names = {self._translated(g.members): g for g in self.b.groups}
        for members in [*ours, *(m for m in theirs if m not in ours)]:
            known = ours.get(members)
            label = f"group of {', '.join(map(str, members if known else names[members].members))}"
            text = label if known else f"{label} (B)"
            yield from self._spans(text, "group", list(members), known or [], theirs.get(members, []))

    def _spans(
        self, name: str, what: str, subjects: list[int], ours: Sequence[Span], theirs: Sequence[Span]
    ) -> Iterator[Difference]:
        ours = [s for s in ours if s.first in self.shared or s.last in self.shared]
        theirs = [s for s in theirs if s.first in self.shared or s.last in self.shared]
        left = [self.a.times[s.first] for s in ours]
        right = [self.b.times[s.first] for s in theirs]
        pairs, lost, new = _nearest(left, right, self.options.tolerance_s)
        for i, j in pairs:
            a, b = ours[i], theirs[j]
            if (a.first, a.last) != (b.first, b.last) and not self._cut(a, b):
                text = (
                    f"{name} lasts from {self.b.seconds(b.first):.2f} to {self.b.seconds(b.last):.2f} s, "
                    f"no longer from {self.a.seconds(a.first):.2f} to {self.a.seconds(a.last):.2f} s"
                )
                details = {"a": [a.first, a.last], "b": [b.first, b.last]}
                frame = min(a.first, b.first) if a.first != b.first else min(a.last, b.last)
                yield Difference(what, "moved", frame, self.a.seconds(frame), subjects, text, details)
        for i in lost:
            a = ours[i]
            t = self.a.seconds(a.first)
            text = f"{name} no longer from {t:.1f} to {self.a.seconds(a.last):.1f} s"
            yield Difference(what, "vanished", a.first, t, subjects, text, {"a": [a.first, a.last]})
        for j in new:
            b = theirs[j]
            t = self.b.seconds(b.first)
            text = f"{name} now from {t:.1f} to {self.b.seconds(b.last):.1f} s"
            yield Difference(what, "appeared", b.first, t, subjects, text, {"b": [b.first, b.last]})

    def _cut(self, a: Span, b: Span) -> bool:
        """Whether they differ only where one log ends."""
        edges = {min(self.shared, default=0), max(self.shared, default=0)}
        return (a.first == b.first or max(a.first, b.first) in edges) and (
            a.last == b.last or min(a.last, b.last) in edges
        )


def _by_members(groups: Sequence[GroupLife], translate: object = None) -> dict[tuple[int, ...], list[GroupLife]]:
    out: dict[tuple[int, ...], list[GroupLife]] = {}
    for group in groups:
        key = translate(group.members) if callable(translate) else group.members
        out.setdefault(key, []).append(group)
    return out


def _nearest(
    ours: Sequence[int], theirs: Sequence[int], tolerance_s: float
) -> tuple[list[tuple[int, int]], list[int], list[int]]:
    """Pair times of two lists, closest first (ties: earlier first), within a tolerance; then who is left of each."""
    limit = tolerance_s * 1e9
    near = sorted((abs(a - b), i, j) for i, a in enumerate(ours) for j, b in enumerate(theirs) if abs(a - b) <= limit)
    taken_a: set[int] = set()
    taken_b: set[int] = set()
    pairs = []
    for _, i, j in near:
        if i not in taken_a and j not in taken_b:
            taken_a.add(i)
            taken_b.add(j)
            pairs.append((i, j))
    lost = [i for i in range(len(ours)) if i not in taken_a]
    return sorted(pairs), lost, [j for j in range(len(theirs)) if j not in taken_b]


_VERBS = {
    "track_confirmed": "is confirmed", "track_lost": "is lost", "track_recovered": "is recovered",
    "track_removed": "is removed", "entering": "is entering", "entered": "has entered", "exiting": "is exiting",
    "returned": "returns", "exited": "exits", "interaction_started": "begin to interact", "joined": "join",
    "separated": "separate", "interaction_ended": "end their interaction", "grouping": "groups",
    "grouped": "is grouped",
    "splitting": "splits", "single": "is single", "group_formed": "forms a group", "group_changed": "changes its group",
    "group_ended": "ends its group", "group_entered_scene": "enter as a group", "mode_changed": "changes its mode",
    "disagreement": "is in disagreement", "anomaly": "shows an anomaly", "zone_entered": "enters a zone",
    "zone_left": "leaves a zone",
}  # fmt: skip


def _verb(kind: str) -> str:
    return _VERBS.get(kind, kind)


def _subject(event: Event) -> str:
    if event.groups and event.kind.startswith("group"):
        return "group " + ", ".join(map(str, event.groups))
    return " and ".join(map(str, event.subjects)) if event.subjects else "the scene"
