"""Differences in what happens: events by kind, subjects and time; relations and groups by their
intervals.
"""

from __future__ import annotations

import re
from bisect import bisect_left, bisect_right
from collections.abc import Iterator, Sequence
from typing import Any

from replay.compare import words
from replay.compare.content import NANOS, Content, Happening, Lasting
from replay.compare.difference import Difference
from replay.compare.intervals import Interval, intersect
from replay.compare.matching import TrackMatching
from replay.first_difference import shorten_apart

Key = tuple[str, tuple[int, ...]]
_DIGITS = re.compile(r"\d+")


class Happenings:
    """Compares what happens in two logs, as far as both can know of it.

    What happens in a frame that the other log has not is looked for in the frames beside it,
    within the tolerance. Where the other log has no frame so near, or has not begun or has ended,
    it is no difference.
    """

    def __init__(
        self,
        a: Content,
        b: Content,
        shared: Sequence[Interval],
        matching: TrackMatching,
        tolerance_s: float,
        strict: bool,
    ) -> None:
        self.a, self.b = a, b
        self._shared = shared
        self._matching = matching
        self._tolerance_ns = round(tolerance_s * NANOS)
        self._strict = strict
        self._same_numbers = all(x == y for x, y in matching.partner.items())
        # Frames of one number may have another time in either log; frames of one time have none.
        self._lag_ns = b.time_ns(shared[0][0]) - a.time_ns(shared[0][0]) if shared else 0

    def _in_a(self, tracks: Sequence[int], frame: int) -> tuple[int, ...]:
        then = sorted(self._matching.translated(track, frame) for track in tracks)
        if len(set(then)) < len(then):
            # Two of B on one of A's places: then their usual partners say who they are.
            then = sorted(self._matching.back.get(track, -1 - track) for track in tracks)
        return tuple(then)

    def _time_ns(self, content: Content, frame: int) -> int:
        """A frame's time by A's clock."""
        return content.time_ns(frame) - (self._lag_ns if content is self.b else 0)

    def _known(self, content: Content, frame: int) -> bool:
        """Whether the other log could know what happens in a frame of this one."""
        other, lag = (
            (self.b, self._lag_ns) if content is self.a else (self.a, -self._lag_ns)
        )
        return (
            0
            <= other.distance_ns(frame, content.time_ns(frame) + lag)
            <= self._tolerance_ns
        )

    @staticmethod
    def names(tracks: Sequence[int]) -> list[str]:
        """Tracks of A by their numbers; those that A has not, as `Matching.translated` gives
        them, as B's.
        """
        return [str(track) for track in tracks if track >= 0] + [
            f"B's {-1 - track}" for track in reversed(tracks) if track < 0
        ]

    # -- events
    # ----------------------------------------------------------------------------------------------------

    def events(self) -> Iterator[Difference]:
        """Events by kind and subjects, each matched to the nearest in time."""
        left: dict[Key, list[Happening]] = {}
        right: dict[Key, list[Happening]] = {}
        for event in self.a.events:
            left.setdefault((event.kind, tuple(sorted(event.subjects))), []).append(event)
        for event in self.b.events:
            right.setdefault(
                (event.kind, self._in_a(event.subjects, event.frame)), []
            ).append(event)
        for key in [*left, *(k for k in right if k not in left)]:
            yield from self._events(key, left.get(key, []), right.get(key, []))

    def _events(
        self, key: Key, ours: list[Happening], theirs: list[Happening]
    ) -> Iterator[Difference]:
        kind, subjects = key
        left, right = (
            [self._time_ns(content, event.frame) for event in es]
            for content, es in ((self.a, ours), (self.b, theirs))
        )
        pairs, lost, new = nearest(left, right, self._tolerance_ns)
        # Paired before they are left out: what one log lacks at the very time it may have beside
        # it.
        for i, j in pairs:
            if self._known(self.a, ours[i].frame) or self._known(self.b, theirs[j].frame):
                yield from self._pair(kind, subjects, ours[i], theirs[j])
        for i in (i for i in lost if self._known(self.a, ours[i].frame)):
            a, t = ours[i], self.a.seconds(ours[i].frame)
            who, one = words.subject(
                self.names(subjects), [str(group) for group in a.groups]
            )
            text = f"{who} {words.verb(kind, one, 'no longer')} at {t:.1f} s"
            details = {"kind": kind, "event_a": a.id, "groups_a": list(a.groups)}
            yield Difference(
                "event", "vanished", a.frame, t, list(a.subjects), text, details
            )
        for j in (j for j in new if self._known(self.b, theirs[j].frame)):
            b, t = theirs[j], self.b.seconds(theirs[j].frame)
            who, one = words.subject(
                self.names(subjects), [f"{group} of B" for group in b.groups]
            )
            text = f"{who} {words.verb(kind, one, 'now')} at {t:.1f} s"
            details = {
                "kind": kind,
                "event_b": b.id,
                "groups_b": list(b.groups),
                "subjects_b": list(b.subjects),
            }
            yield Difference(
                "event", "appeared", b.frame, t, self._shown(subjects), text, details
            )

    @staticmethod
    def _shown(subjects: Sequence[int]) -> list[int]:
        return [subject if subject >= 0 else -1 - subject for subject in subjects]

    def _pair(
        self, kind: str, subjects: tuple[int, ...], a: Happening, b: Happening
    ) -> Iterator[Difference]:
        who, one = words.subject(self.names(subjects), [str(group) for group in a.groups])
        ta, tb = self.a.seconds(a.frame), self.b.seconds(b.frame)
        details: dict[str, Any] = {"kind": kind, "event_a": a.id, "event_b": b.id}
        if a.frame != b.frame:
            text = f"{who} {words.verb(kind, one)} at {tb:.2f} s, no longer at {ta:.2f} s"
            details |= {
                "frame_a": self.a.number(a.frame),
                "frame_b": self.b.number(b.frame),
            }
            yield Difference(
                "event",
                "moved",
                min(a.frame, b.frame),
                min(ta, tb),
                list(subjects),
                text,
                details,
            )
        elif self._strict and a.whole != b.whole:
            found = self._unequal_events(a, b)
            if found is not None:
                place, x, y = found
                text = (
                    f"{who} {words.verb(kind, one)} at {ta:.1f} s as before, but with"
                    f" {place} {y}, not {x}"
                )
                details |= {"field": place, "a": x, "b": y}
                yield Difference(
                    "event", "changed", a.frame, ta, list(subjects), text, details
                )

    def _unequal_events(self, a: Happening, b: Happening) -> tuple[str, str, str] | None:
        """The first of their values that differs, and not by numbers of tracks and groups alone."""
        x, y = a.event(), b.event()
        for name in ("rule", "evidence", "text"):
            for place, p, q in _leaves(getattr(x, name), getattr(y, name), name):
                if self._same_numbers or not self._renumbered(p, q, (a, b)):
                    return place, *shorten_apart(p, q)
        return None

    def _renumbered(self, x: Any, y: Any, events: tuple[Happening, Happening]) -> bool:
        """Whether two values may differ only in how tracks and groups are numbered."""
        if isinstance(x, str) and isinstance(y, str):
            return _DIGITS.sub("#", x) == _DIGITS.sub("#", y)
        if isinstance(x, list) and isinstance(y, list):
            return len(x) == len(y)
        a, b = events
        whole = type(x) is int and type(y) is int
        return whole and (
            self._matching.partner.get(x) == y or (x in a.groups and y in b.groups)
        )

    # -- relations and groups
    # --------------------------------------------------------------------------------------

    def relations(self) -> Iterator[Difference]:
        """Relations by their intervals."""

        def name(state: str, members: Sequence[str], _: Sequence[Lasting]) -> str:
            return f"{state} of {words.tracks(members)}"

        yield from self._lasting(
            "relation", self.a.relations, self.b.relations, name, by_label=True
        )

    def groups(self) -> Iterator[Difference]:
        """Groups by members; their labels are only names."""

        def name(_: str, members: Sequence[str], lives: Sequence[Lasting]) -> str:
            return words.group(lives[0].label, members)

        yield from self._lasting(
            "group", self.a.groups, self.b.groups, name, by_label=False
        )

    def encounters(self) -> Iterator[Difference]:
        """Encounters by who was together, and as what."""

        def name(kind: str, members: Sequence[str], _: Sequence[Lasting]) -> str:
            return f"{words.tracks(members)} together ({kind})"

        yield from self._lasting(
            "encounter", self.a.encounters, self.b.encounters, name, by_label=True
        )

    def _lasting(
        self,
        what: str,
        ours: Sequence[Lasting],
        theirs: Sequence[Lasting],
        name: Any,
        by_label: bool,
    ) -> Iterator[Difference]:
        left: dict[Key, list[Lasting]] = {}
        right: dict[Key, list[Lasting]] = {}
        for life in ours:
            left.setdefault((life.label if by_label else "", life.members), []).extend(
                self._clipped(self.a, life)
            )
        for life in theirs:
            members = self._in_a(life.members, life.first)
            right.setdefault((life.label if by_label else "", members), []).extend(
                self._clipped(self.b, life)
            )
        for key in [*left, *(k for k in right if k not in left)]:
            lives = left.get(key) or right.get(key) or []
            if lives:
                for side in (left, right):
                    if key in side:
                        side[key] = _joined(side[key])
                words_for = name(key[0], self.names(key[1]), lives)
                if not left.get(key) and not by_label:
                    words_for = words_for.replace("group ", "B's group ", 1)
                yield from self._spans(
                    what, words_for, key[1], left.get(key, []), right.get(key, [])
                )

    def _clipped(self, content: Content, life: Lasting) -> list[Lasting]:
        """What of it lies in the frames that both logs have: where one log ends is no difference.

        One that no such frame has stays whole where the other log could know of it.
        """
        spans = intersect([(life.first, life.last)], self._shared)
        if not spans and (
            self._known(content, life.first) or self._known(content, life.last)
        ):
            return [life]
        return (
            [Lasting(life.label, life.members, spans[0][0], spans[-1][1])] if spans else []
        )

    @staticmethod
    def _numbers_of(content: Content, life: Lasting) -> list[int]:
        return [content.number(life.first), content.number(life.last)]

    def _spans(
        self,
        what: str,
        name: str,
        members: tuple[int, ...],
        ours: list[Lasting],
        theirs: list[Lasting],
    ) -> Iterator[Difference]:
        left, right = (
            [self._time_ns(content, span.first) for span in spans]
            for content, spans in ((self.a, ours), (self.b, theirs))
        )
        pairs, lost, new = nearest(left, right, self._tolerance_ns)
        subjects = self._shown(members)
        for i, j in pairs:
            a, b = ours[i], theirs[j]
            if (a.first, a.last) != (b.first, b.last):
                then = f"{self.a.seconds(a.first):.2f} to {self.a.seconds(a.last):.2f} s"
                now = f"{self.b.seconds(b.first):.2f} to {self.b.seconds(b.last):.2f} s"
                frame = (
                    min(a.first, b.first) if a.first != b.first else min(a.last, b.last) + 1
                )
                details = {
                    "a": self._numbers_of(self.a, a),
                    "b": self._numbers_of(self.b, b),
                }
                text = f"{name}: now from {now}, no longer from {then}"
                yield Difference(
                    what, "moved", frame, self.a.seconds(frame), subjects, text, details
                )
        for i in lost:
            a = ours[i]
            t, end = self.a.seconds(a.first), self.a.seconds(a.last)
            text = f"{name}: no longer from {t:.1f} to {end:.1f} s"
            yield Difference(
                what,
                "vanished",
                a.first,
                t,
                subjects,
                text,
                {"a": self._numbers_of(self.a, a)},
            )
        for j in new:
            b = theirs[j]
            t, end = self.b.seconds(b.first), self.b.seconds(b.last)
            text = f"{name}: now from {t:.1f} to {end:.1f} s"
            yield Difference(
                what,
                "appeared",
                b.first,
                t,
                subjects,
                text,
                {"b": self._numbers_of(self.b, b)},
            )


def _joined(lives: list[Lasting]) -> list[Lasting]:
    """Intervals that follow one another are one: only a number changed between them."""
    out: list[Lasting] = []
    for life in sorted(lives, key=lambda one: one.first):
        if out and life.first <= out[-1].last + 1:
            out[-1] = Lasting(
                out[-1].label, out[-1].members, out[-1].first, max(out[-1].last, life.last)
            )
        else:
            out.append(life)
    return out


def _leaves(x: Any, y: Any, place: str) -> Iterator[tuple[str, Any, Any]]:
    """Places where two plain values differ; lists of as many whole numbers, which may be tracks,
    stay together.
    """
    if isinstance(x, dict) and isinstance(y, dict):
        for key in [*x, *(k for k in y if k not in x)]:
            yield from _leaves(x.get(key), y.get(key), f"{place}.{key}")
    elif (
        isinstance(x, list)
        and isinstance(y, list)
        and len(x) == len(y)
        and not all(type(v) is int for v in x + y)
    ):
        for index, (p, q) in enumerate(zip(x, y, strict=True)):
            yield from _leaves(p, q, f"{place}[{index}]")
    elif x != y or type(x) is not type(y):
        yield place, x, y


def nearest(
    ours: Sequence[int], theirs: Sequence[int], limit: int
) -> tuple[list[tuple[int, int]], list[int], list[int]]:
    """Pair times of two ascending lists, closest first (ties: earlier first), within a limit;
    then who is left of each.

    >>> nearest([0, 10], [9, 30], 5)
    ([(1, 0)], [0], [1])
    """
    near = sorted(
        (abs(our - theirs[j]), index, j)
        for index, our in enumerate(ours)
        for j in range(bisect_left(theirs, our - limit), bisect_right(theirs, our + limit))
    )
    taken_a: set[int] = set()
    taken_b: set[int] = set()
    pairs = []
    for _, i, j in near:
        if i not in taken_a and j not in taken_b:
            taken_a.add(i)
            taken_b.add(j)
            pairs.append((i, j))
    lost = [index for index in range(len(ours)) if index not in taken_a]
    return (
        sorted(pairs),
        lost,
        [index for index in range(len(theirs)) if index not in taken_b],
    )
