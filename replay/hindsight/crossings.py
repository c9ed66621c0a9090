"""Who is who after two were at one place, where nothing but their paths can tell.

A tracker has to say at once who comes out of a crossing where. Once the recording is over, the
second before and the second after say it better, both readings as a whole: each went on as himself,
or each as the other. A reading's price is how far the straight paths out of both sides miss one
another, how much the speed and the size change, in standard deviations that grow with the time
between. What decides is the difference of the two readings, and only where it is plain: within
`MARGIN` the tracker's word stands.

What is between is the whole time that the two were near, or, of two who walk side by side, a time
in which one of them was not seen; of these the one at which the readings differ most.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

from msgspec.structs import replace

from recorders.messages import Box, Target, Targets
from replay.hindsight.fragments import GAP_S, End, FragmentSighting, end_of

NEAR = 0.7
"""Two centres within so many sizes of the larger one are at one place."""
APART_S = 0.3
"""Who was apart for less is still in the same crossing."""
WINDOW_S = 1.0
"""Paths are fitted over so long, before and after."""
AROUND_S = 2.0
"""Nobody seen so long before or after belongs to it, too."""
LONGEST_S = 10.0
"""Two who stay near for longer are asked about anew."""
MARGIN = 1.0
"""By so much (log likelihood) the exchange is likelier where it is believed."""
NEITHER = 10.0
"""The price of a third reading: somebody else came out."""
CROSSED = 0.1
"""Odds of being somebody else after a crossing of which another reading is as likely as the one that
is told: fitted to who was who in seven recordings of boxes, each left out in turn.
"""
_MOST_ODDS, _LEAST_ODDS = 3.0, 0.001
"""No reading is so much likelier that it adds more than so many times that; less is not kept."""
_NOISE = 0.1
"""Standard deviation of a place that a path is fitted to, in sizes."""
_MISS, _MISS_RATE = 0.15, 0.4
_TURN, _TURN_RATE = 0.4, 0.3
"""Standard deviations of where a path goes on, in sizes, and of its speed, in sizes per second, and
their growth with every second between.
"""
_HEIGHT, _WIDTH = 0.12, 0.2
"""Standard deviations of the logarithms of a body's height and width from side to side."""
_MOST = 4.5
"""No term says more than three standard deviations do."""
_LEAST = 2
"""Sightings on each side without which nothing can be told."""


@dataclass(frozen=True, slots=True)
class Crossing:
    """Two forward identities that were at one place.

    Attributes:
        a, b: they, a < b.
        at: position in the stream at which they were nearest: there they were exchanged, if they were.
        straight, across: the prices of each going on as himself, and as the other one.
    """

    a: int
    b: int
    at: int
    straight: float
    across: float

    @property
    def exchanged(self) -> bool:
        """Whether it is plain that the tracker took them for one another."""
        return self.across < self.exchanged_under

    @property
    def exchanged_under(self) -> float:
        """The price under which the exchange is believed."""
        return min(self.straight, NEITHER) - MARGIN

    @property
    def odds(self) -> float:
        """The odds that either is somebody else by now, by what the other readings cost."""
        told, other = self.straight, self.across
        if self.exchanged:
            told, other = other, told
        return CROSSED * math.fsum(
            min(_MOST_ODDS, math.exp(told - price)) for price in (other, NEITHER)
        )


@dataclass(frozen=True, slots=True)
class Side:
    """One side of a crossing: the path's end, and how unsure its speed is, in standard deviations
    of a place by second.
    """

    end: End
    unsure: float


@dataclass(slots=True)
class _Meeting:
    a: int
    b: int
    first_ns: int
    last_ns: int


@dataclass(frozen=True, slots=True)
class _Sighting(FragmentSighting):
    seen: bool


class Crossings:
    """Follows a forward pass, and asks about every crossing once it is over.

    Args:
        times: capture times in ns of the k-th answer, there when that is read.
        second: what counts for a second in this recording, in seconds.
    """

    def __init__(self, times: Sequence[int], second: float = 1.0) -> None:
        self._times = times
        self._ns = second * 1e9
        self._paths: dict[int, deque[_Sighting]] = {}
        self._open: dict[tuple[int, int], _Meeting] = {}
        self._over: list[_Meeting] = []
        self.found: list[Crossing] = []

    def watch(self, stream: Iterable[Targets]) -> Iterator[Targets]:
        """Pass a forward pass on, taking note."""
        for at, answer in enumerate(stream):
            self._take(at, answer.targets)
            yield answer
        self._ask([*self._over, *self._open.values()])
        self.found.sort(key=lambda c: (c.at, c.a, c.b))

    def _take(self, at: int, targets: Sequence[Target]) -> None:
        now, wait = self._times[at], int((AROUND_S + WINDOW_S) * self._ns)
        since: dict[int, int] = {}
        for m in (*self._over, *self._open.values()):
            for identity in (m.a, m.b):
                since[identity] = min(since.get(identity, now), m.first_ns)
        boxes: list[tuple[int, Box]] = []
        for t in targets:
            box = t.measured or t.box
            path = self._paths.setdefault(t.id, deque())
            path.append(_Sighting(at, now, box, t.observed))
            while path[0].time_ns < since.get(t.id, now) - wait:
                path.popleft()
            boxes.append((t.id, box))
        if len(self._paths) > 2 * len(targets) + 8:
            self._paths = {
                k: p
                for k, p in self._paths.items()
                if k in since or p[-1].time_ns >= now - wait
            }
        for a, b in near(boxes):
            known = self._open.get((a, b))
            if known is None or now - known.first_ns > LONGEST_S * self._ns:
                self._over += [] if known is None else [known]
                known = self._open[a, b] = _Meeting(a, b, now, now)
            known.last_ns = now
        for pair, meeting in list(self._open.items()):
            if now - meeting.last_ns > APART_S * self._ns:
                self._over.append(self._open.pop(pair))
        due = [m for m in self._over if now - m.last_ns > wait]
        if due:
            self._over = [m for m in self._over if now - m.last_ns <= wait]
            self._ask(due)

    def _ask(self, meetings: Iterable[_Meeting]) -> None:
        for meeting in meetings:
            tried = (self._between(meeting, *times) for times in self._cores(meeting))
            told = [crossing for crossing in tried if crossing is not None]
            if told:
                plainest = max(
                    told, key=lambda c: round(abs(c.straight - c.across) * 2**20)
                )
                if plainest.exchanged or plainest.odds >= _LEAST_ODDS:
                    self.found.append(plainest)

    def _cores(self, m: _Meeting) -> list[tuple[int, int]]:
        """From when until when the two could be mistaken: while they were near, and while one of
        them was not seen about then.
        """
        cores = [(m.first_ns, m.last_ns)]
        around = AROUND_S * self._ns
        for identity in (m.a, m.b):
            seen = [
                s.time_ns
                for s in self._paths[identity]
                if s.seen and m.first_ns - around <= s.time_ns <= m.last_ns + around
            ]
            cores += [
                (before, after)
                for before, after in pairwise(seen)
                if after - before > GAP_S * self._ns
                and after >= m.first_ns
                and before <= m.last_ns
            ]
        return cores

    def _between(self, m: _Meeting, begin: int, end: int) -> Crossing | None:
        """What the second before ``begin`` and the second after ``end`` say."""
        window = WINDOW_S * self._ns
        outs: list[Side] = []
        intos: list[Side] = []
        for identity in (m.a, m.b):
            path = [s for s in self._paths[identity] if s.seen]
            before = [s for s in path if begin - window <= s.time_ns <= begin]
            after = [s for s in path if end <= s.time_ns <= end + window]
            if min(len(before), len(after)) < _LEAST:
                return None
            outs.append(Side(end_of(before, False), _spread(before)))
            intos.append(Side(end_of(after, True), _spread(after)))
        size = math.exp(math.fsum(math.log(s.end.size) for s in (*outs, *intos)) / 4)
        second = self._ns * 1e-9
        straight, across = (
            dearness(outs[0], intos[k], size, second)
            + dearness(outs[1], intos[1 - k], size, second)
            for k in (0, 1)
        )
        return Crossing(m.a, m.b, self._nearest(m, begin, end), straight, across)

    def _nearest(self, m: _Meeting, begin: int, end: int) -> int:
        """Where in the stream the two were nearest to one another."""
        one, other = (
            {s.at: s.box for s in self._paths[k] if begin <= s.time_ns <= end}
            for k in (m.a, m.b)
        )
        return min(
            sorted(one.keys() & other.keys()), key=lambda at: _apart(one[at], other[at])
        )


def dearness(before: Side, after: Side, size: float, second: float = 1.0) -> float:
    """What it costs to believe that who went out at ``before`` is who comes in at ``after``: minus
    log likelihood, constants left out.
    """
    out, into = before.end, after.end
    gap = max(0.0, (into.time_ns - out.time_ns) * 1e-9)
    miss = math.hypot(
        out.x + 0.5 * gap * out.vx - (into.x - 0.5 * gap * into.vx),
        out.y + 0.5 * gap * out.vy - (into.y - 0.5 * gap * into.vy),
    )
    turn = math.hypot(into.vx - out.vx, into.vy - out.vy)
    seconds = gap / second
    unsure = _NOISE * math.hypot(before.unsure, after.unsure)
    off = (
        miss / size / math.hypot(_MISS + _MISS_RATE * seconds, 0.5 * gap * unsure),
        turn / size / math.hypot((_TURN + _TURN_RATE * seconds) / second, unsure),
        math.log(max(into.h, 1.0) / max(out.h, 1.0)) / _HEIGHT,
        math.log(max(into.w, 1.0) / max(out.w, 1.0)) / _WIDTH,
    )
    return math.fsum(min(0.5 * z * z, _MOST) for z in off)


def _spread(sightings: Sequence[FragmentSighting]) -> float:
    """By how much a speed fitted to sightings is less sure than one of their places, 1/s."""
    times = [s.time_ns * 1e-9 for s in sightings]
    mean = math.fsum(times) / len(times)
    return 1.0 / math.sqrt(max(math.fsum((t - mean) ** 2 for t in times), 1e-4))


def near(boxes: Sequence[tuple[int, Box]]) -> list[tuple[int, int]]:
    """Pairs of identities (a, b), a < b, in order, whose boxes are at one place.

    >>> near([(2, (0.0, 0.0, 4.0, 4.0)), (1, (2.0, 0.0, 4.0, 4.0)), (3, (9.0, 0.0, 4.0, 4.0))])
    [(1, 2)]
    """
    rows = sorted(
        (x + w / 2, y + h / 2, math.sqrt(max(w * h, 1.0)), identity)
        for identity, (x, y, w, h) in boxes
    )
    widest = max((size for _, _, size, _ in rows), default=0.0)
    found: list[tuple[int, int]] = []
    for k, (x, y, size, one) in enumerate(rows):
        for u, v, other_size, other in rows[k + 1 :]:
            if u - x >= NEAR * widest:
                break
            if math.hypot(u - x, v - y) < NEAR * max(size, other_size):
                found.append((min(one, other), max(one, other)))
    found.sort()
    return found


def _apart(one: Box, other: Box) -> float:
    return math.hypot(
        one[0] + one[2] / 2 - other[0] - other[2] / 2,
        one[1] + one[3] / 2 - other[1] - other[3] / 2,
    )


def named(crossings: Sequence[Crossing]) -> list[Crossing]:
    """The same crossings by who they are held to be once the exchanged are exchanged."""
    name: dict[int, int] = {}
    found: list[Crossing] = []
    for c in crossings:
        a, b = name.get(c.a, c.a), name.get(c.b, c.b)
        found.append(Crossing(a, b, c.at, c.straight, c.across))
        if c.exchanged:
            name[c.a], name[c.b] = b, a
    return found


def uncrossed(
    stream: Iterable[Targets], crossings: Sequence[Crossing]
) -> Iterator[Targets]:
    """The answers with those who were taken for one another exchanged from there on.

    Args:
        stream: a forward pass's answers, in order.
        crossings: in the order of their places in the stream.
    """
    waiting = deque(c for c in crossings if c.exchanged)
    name: dict[int, int] = {}
    for at, answer in enumerate(stream):
        while waiting and waiting[0].at <= at:
            c = waiting.popleft()
            name[c.a], name[c.b] = name.get(c.b, c.b), name.get(c.a, c.a)
        yield _renamed(answer, name) if name else answer


def _renamed(answer: Targets, name: dict[int, int]) -> Targets:
    targets = [
        replace(target, id=name.get(target.id, target.id)) for target in answer.targets
    ]
    notices = [
        replace(notice, subjects=[name.get(k, k) for k in notice.subjects])
        for notice in answer.notices
    ]
    return replace(answer, targets=sorted(targets, key=lambda t: t.id), notices=notices)
