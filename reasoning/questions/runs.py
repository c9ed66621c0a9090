"""What holds frame by frame as intervals, each with how well it was seen and how sure it is.

An interval rests on its frames: the share of them in which everybody whom it names was seen
(observed, or wholly hidden by another of them who is), how likely they exist, how likely they are
who they are said to be, and the events in which tracks were joined.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from reasoning.geometry import hidden_by
from recorders.messages import Box, Event, Track

Interval = tuple[int, int, float, float]
Belief = tuple[float, float, float, list[int]]
"""seen_share, existence, identity, joins: the columns of `schema.BELIEF`."""

JOINS = ("identity", "track_recovered")
"""Kinds of events after which a track may be somebody else."""


class Sight(NamedTuple):
    """Some targets in one frame: all seen, the least existence and identity, joins of theirs."""

    seen: bool
    existence: float
    identity: float
    joins: tuple[int, ...] = ()


UNTOLD = Sight(False, 0.0, 0.0)
"""Of nobody who is there, or where nobody asks."""


class SeenTarget(NamedTuple):
    """One target in one frame."""

    box: Box
    observed: bool
    existence: float
    identity: float
    joins: tuple[int, ...] = ()


def sight(targets: Mapping[int, SeenTarget], ids: Sequence[int]) -> Sight:
    """Some targets of a frame together.

    Who is not observed counts as seen where he lies wholly within another of them who is; of one
    target alone, within anybody (SHELLS 2.3: the hidden one is somewhere in its occluder).
    """
    own = [targets[identity] for identity in ids if identity in targets]
    if len(own) < len(ids) or not own:
        return UNTOLD
    if len(own) == 1 and own[0].observed:
        return Sight(
            True, own[0].existence, own[0].identity, tuple(sorted({*own[0].joins}))
        )
    seen = all(
        s.observed or _hidden(identity, s, targets, ids)
        for identity, s in zip(ids, own, strict=True)
    )
    joins = tuple(sorted({join for s in own for join in s.joins}))
    return Sight(seen, min(s.existence for s in own), min(s.identity for s in own), joins)


def _hidden(
    i: int, behind: SeenTarget, targets: Mapping[int, SeenTarget], ids: Sequence[int]
) -> bool:
    others = targets if len(ids) == 1 else ids
    return any(
        targets[other].observed and hidden_by(behind.box, targets[other].box)
        for other in others
        if other != i
    )


@dataclass
class _Open:
    """A run of frames in which something stayed the same."""

    value: Hashable
    start_frame: int
    start_t: float
    end_frame: int
    end_t: float
    frames: int = 0
    seen: int = 0
    existence: float = 0.0
    unseen_existence: float = 0.0
    identity: float = 1.0
    joins: list[int] = field(default_factory=list)

    @property
    def interval(self) -> Interval:
        return self.start_frame, self.end_frame, self.start_t, self.end_t

    def add(self, s: Sight) -> None:
        self.frames += 1
        self.identity = min(self.identity, s.identity)
        if s.seen:
            self.seen += 1
            self.existence += s.existence
        else:
            self.unseen_existence += s.existence
        if s.joins:
            self.joins += [join for join in s.joins if join not in self.joins]

    @property
    def belief(self) -> Belief:
        """Existence is the mean over the frames in which it was seen, if it ever was."""
        if not self.frames:
            return 0.0, 0.0, 0.0, []
        mean = (
            self.existence / self.seen if self.seen else self.unseen_existence / self.frames
        )
        share = self.seen / self.frames
        return round(share, 4), round(mean, 4), round(self.identity, 4), self.joins


class HeldInterval(NamedTuple):
    """An interval that is over: what it is of, what held, when, and how sure it is."""

    key: Hashable
    value: Hashable
    interval: Interval
    belief: Belief


class Runs:
    """Turns what holds frame by frame into intervals: a run ends with the first frame in which it
    does not hold.
    """

    def __init__(self) -> None:
        self._open: dict[Hashable, _Open] = {}

    def step(
        self,
        frame: int,
        t: float,
        now: Mapping[Hashable, Hashable],
        told: Callable[[Hashable, Hashable], Sight],
    ) -> list[HeldInterval]:
        """Take what holds in this frame (key to value) and how it was seen; the runs that are
        over.
        """
        over = [
            self._close(k)
            for k in [k for k, r in self._open.items() if k not in now or now[k] != r.value]
        ]
        for key, value in now.items():
            held = self._open.get(key)
            if held is None:
                held = self._open[key] = _Open(value, frame, t, frame, t)
            else:
                held.end_frame, held.end_t = frame, t
            held.add(told(key, value))
        return over

    def _close(self, key: Hashable) -> HeldInterval:
        run = self._open.pop(key)
        return HeldInterval(key, run.value, run.interval, run.belief)

    def close(self) -> list[HeldInterval]:
        """All runs that are still open, as `step` gives them."""
        return [self._close(key) for key in list(self._open)]


def seen_targets(tracks: Sequence[Track], events: Sequence[Event]) -> dict[int, SeenTarget]:
    """A frame's targets as they were seen, with the joins that were told in it."""
    joins: dict[int, tuple[int, ...]] = {}
    for event in events:
        if event.kind in JOINS:
            for subject in event.subjects:
                joins[subject] = (*joins.get(subject, ()), event.id)
    return {track.id: _seen(track, joins.get(track.id, ())) for track in tracks}


def _seen(track: Track, joins: tuple[int, ...]) -> SeenTarget:
    observed = track.observed and track.present
    return SeenTarget(track.box, observed, track.confidence, track.identity, joins)


def pair_of(value: Hashable) -> tuple[Any, Any]:
    """A key or value of two."""
    assert isinstance(value, tuple)
    return value[0], value[1]


def ids_of(value: Hashable) -> tuple[int, ...]:
    """A key or value of tracks."""
    assert isinstance(value, tuple)
    return value
