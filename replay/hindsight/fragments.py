"""The first reading: what the forward pass left of each identity, in bounded space per identity."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from operator import add

from recorders.messages import Box, Notice, Targets

GAP_S = 0.2
"""Who is not seen for longer may be another one afterwards."""
_NOWHERE = (math.inf, math.inf, -math.inf, -math.inf)
_SUREST = 0.001
"""No sighting is surer than that."""
ENDS_S = 1.0
"""The path's ends, over which its speed is measured, in seconds."""
_MOST_ENDS = 64
_MOST_FRAMES = 4096
"""Frames before a confirmation that it may still name."""


@dataclass(frozen=True, slots=True)
class FragmentSighting:
    """An observation: position in the stream of frames, time in ns, box."""

    at: int
    time_ns: int
    box: Box


class Path:
    """Sightings in order, held as bare numbers: every fragment of a recording is kept until its
    end is known, and as objects they would take five times the space.
    """

    __slots__ = ("_boxes", "_when")

    def __init__(self, sightings: Iterable[FragmentSighting] = ()) -> None:
        self._when = array("q")
        self._boxes = array("d")
        for sighting in sightings:
            self.add(sighting.at, sighting.time_ns, sighting.box)

    def __len__(self) -> int:
        return len(self._when) // 2

    def __getitem__(self, k: int) -> FragmentSighting:
        k += len(self) if k < 0 else 0
        x, y, w, h = self._boxes[4 * k : 4 * k + 4]
        return FragmentSighting(self._when[2 * k], self._when[2 * k + 1], (x, y, w, h))

    def __iter__(self) -> Iterator[FragmentSighting]:
        return (self[k] for k in range(len(self)))

    @property
    def first_ns(self) -> int:
        """The first one's time."""
        return self._when[1]

    def add(self, at: int, time_ns: int, box: Box) -> None:
        """Append one."""
        self._when.extend((at, time_ns))
        self._boxes.extend(box)

    @property
    def last_when(self) -> tuple[int, int]:
        """The last one's position in the stream and time."""
        return self._when[-2], self._when[-1]

    def keep_end(self, span_ns: float) -> None:
        """Forget what is earlier than the last one by more than a time, or by `_MOST_ENDS`."""
        when = self._when
        last, count = when[-1], len(when) // 2
        first = max(0, count - _MOST_ENDS)
        while last - when[2 * first + 1] > span_ns:
            first += 1
        if first:
            del when[: 2 * first], self._boxes[: 4 * first]


@dataclass(slots=True)
class Fragment:
    """An identity's life as the forward pass saw it.

    Attributes:
        id: the forward pass's identity.
        earlier: sightings before the confirmation, in order.
        head, tail: the first and the last observations, at most `ENDS_S` long.
        hits: number of observations.
        sizes: sum of the observations' sizes.
        odds: sum of the log-odds that the detections it was observed in are somebody, of
            ``judged`` observations.
        left: it went out of the scene: whoever comes in later is not held to be the same by the
            path alone.
        signature: sum of the appearance signatures, of ``signatures`` frames.
        extent: least and greatest x and y that its centre was seen at, pixels.
        moments: sums of x, y, x^2 and y^2 of its centre, from its first one.
        gaps: (position in the stream, seconds) of every observation that came after a gap.
        second: what counts for a second in this recording, in seconds: more in time lapse.
        told: the tracker held it present at some time. Of who was only ever followed aside
            nothing is told, but such a fragment may be where somebody else's life goes on.
    """

    id: int
    earlier: Path = field(default_factory=Path)
    head: Path = field(default_factory=Path)
    tail: Path = field(default_factory=Path)
    hits: int = 0
    signature: array[float] = field(default_factory=lambda: array("d"))
    signatures: int = 0
    born_of_split: bool = False
    left: bool = False
    sizes: float = 0.0
    odds: float = 0.0
    judged: int = 0
    extent: tuple[float, float, float, float] = _NOWHERE
    moments: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    origin: tuple[float, float] | None = None
    gaps: list[tuple[int, float]] = field(default_factory=list)
    told: bool = False
    second: float = 1.0

    @property
    def size(self) -> float:
        """Mean size of its observations: square root of the box's area, pixels."""
        return self.sizes / max(1, self.hits)

    @property
    def first(self) -> FragmentSighting:
        """The first observation."""
        return self.head[0]

    @property
    def last(self) -> FragmentSighting:
        """The last observation."""
        return self.tail[-1]

    def add(self, at: int, time_ns: int, box: Box) -> None:
        """Take the next observation."""
        if len(self.tail):
            last_at, last_ns = self.tail.last_when
            gap = (time_ns - last_ns) * 1e-9
            if at > last_at + 1 and gap > GAP_S * self.second:
                self.gaps.append((at, gap))
        self.hits += 1
        self.sizes += math.sqrt(max(box[2] * box[3], 1.0))
        self._stand(box)
        head = self.head
        if not len(head) or (
            time_ns - head.first_ns <= ENDS_S * self.second * 1e9 and len(head) < _MOST_ENDS
        ):
            head.add(at, time_ns, box)
        self.tail.add(at, time_ns, box)
        self.tail.keep_end(ENDS_S * self.second * 1e9)

    def _stand(self, box: Box) -> None:
        """Take note of a place."""
        x, y = box[0] + box[2] / 2, box[1] + box[3] / 2
        left, top, right, bottom = self.extent
        if not (left <= x <= right and top <= y <= bottom):
            self.extent = min(left, x), min(top, y), max(right, x), max(bottom, y)
        if self.origin is None:
            self.origin = x, y
        u, v = x - self.origin[0], y - self.origin[1]
        a, b, c, d = self.moments
        self.moments = a + u, b + v, c + u * u, d + v * v

    def judge(self, likely: float) -> None:
        """Take the probability that what it was observed in is somebody."""
        inside = min(max(likely, _SUREST), 1.0 - _SUREST)
        self.odds += math.log(inside / (1.0 - inside))
        self.judged += 1

    def forget(self) -> None:
        """Keep no more of the ends than the first and the last sighting: the joins are made."""
        self.head, self.tail = Path([self.first]), Path([self.last])
        self.signature = array("d")

    def sign(self, signature: Sequence[int]) -> None:
        """Take an appearance signature of the same length as the others."""
        if not self.signature:
            self.signature = array("d", [0.0]) * len(signature)
        if len(signature) == len(self.signature):
            self.signature = array("d", map(add, self.signature, signature))
            self.signatures += 1


@dataclass(frozen=True, slots=True)
class End:
    """A path's state at one of its ends: centre, velocity (pixels per second), size, width,
    height, time.
    """

    x: float
    y: float
    vx: float
    vy: float
    w: float
    h: float
    time_ns: int

    @property
    def size(self) -> float:
        """Square root of the area."""
        return math.sqrt(max(self.w * self.h, 1.0))


def end_of(sightings: Sequence[FragmentSighting], at_start: bool) -> End:
    """Fit a straight path to sightings by least squares, its state at the first or the last of
    them.
    """
    n = len(sightings)
    origin = sightings[0 if at_start else -1].time_ns
    t = [(sighting.time_ns - origin) * 1e-9 for sighting in sightings]
    x = [sighting.box[0] + sighting.box[2] / 2 for sighting in sightings]
    y = [sighting.box[1] + sighting.box[3] / 2 for sighting in sightings]
    mean = math.fsum(t) / n
    spread = math.fsum((u - mean) ** 2 for u in t)
    mx, my = math.fsum(x) / n, math.fsum(y) / n
    vx = (
        math.fsum((u - mean) * v for u, v in zip(t, x, strict=True)) / spread
        if spread > 0.01
        else 0.0
    )
    vy = (
        math.fsum((u - mean) * v for u, v in zip(t, y, strict=True)) / spread
        if spread > 0.01
        else 0.0
    )
    w = math.fsum(sighting.box[2] for sighting in sightings) / n
    h = math.fsum(sighting.box[3] for sighting in sightings) / n
    return End(mx - mean * vx, my - mean * vy, vx, vy, w, h, origin)


def size_of(parts: Sequence[Fragment]) -> float:
    """Mean size of a life of such fragments, pixels."""
    return sum(f.sizes for f in parts) / max(1, sum(f.hits for f in parts))


def reach(parts: Sequence[Fragment]) -> float:
    """How far a life of such fragments went at most, in units of its size."""
    left, top = (min(f.extent[k] for f in parts) for k in (0, 1))
    right, bottom = (max(f.extent[k] for f in parts) for k in (2, 3))
    return math.hypot(right - left, bottom - top) / size_of(parts)


def wandering(parts: Sequence[Fragment]) -> float:
    """How far it went most of the time, in sizes: the length of a way, gone evenly, that has the
    standard deviation of its places. Detectors' boxes jump too much for `reach`.
    """
    spread = 0.0
    count = sum(f.hits for f in parts)
    base = parts[0].origin or (0.0, 0.0)
    for k in (0, 1):
        first = second = 0.0
        for f in parts:
            off = (f.origin or base)[k] - base[k]
            first += f.moments[k] + f.hits * off
            second += f.moments[k + 2] + 2 * off * f.moments[k] + f.hits * off * off
        spread += max(0.0, second / count - (first / count) ** 2)
    return math.sqrt(12.0 * spread) / size_of(parts)


def gather(
    stream: Iterable[Targets], times: Sequence[int], second: float = 1.0
) -> dict[int, Fragment]:
    """Read the forward pass once: every identity's fragment, by id.

    Args:
        stream: the forward pass's answers in order; the k-th belongs to the k-th time.
        times: capture times in ns.
        second: see `Fragment`.
    """
    fragments: dict[int, Fragment] = {}
    at_frame: dict[int, int] = {}
    for at, answer in enumerate(stream):
        at_frame[answer.frame] = at
        if len(at_frame) > _MOST_FRAMES:
            del at_frame[next(iter(at_frame))]
        for target in answer.targets:
            fragment = fragments.get(target.id)
            if fragment is None:
                fragment = fragments[target.id] = Fragment(target.id, second=second)
            fragment.born_of_split |= target.born_of_split and not fragment.hits
            fragment.told |= target.present
            if target.observed:
                fragment.add(at, times[at], target.measured or target.box)
            if target.likely is not None:
                fragment.judge(target.likely)
            if target.signature:
                fragment.sign(target.signature)
        for notice in answer.notices:
            for identity in notice.subjects:
                if identity in fragments:
                    _take_note(fragments[identity], notice, at_frame, times)
    return {k: fragments[k] for k in sorted(fragments) if fragments[k].hits}


def _take_note(
    fragment: Fragment, notice: Notice, at_frame: dict[int, int], times: Sequence[int]
) -> None:
    """What the tracker said of a fragment's beginning and end."""
    if notice.kind == "track_confirmed":
        _back_date(fragment, notice, at_frame, times)
    elif notice.kind == "track_removed":
        fragment.left |= notice.left_scene


def _back_date(
    fragment: Fragment, notice: Notice, at_frame: dict[int, int], times: Sequence[int]
) -> None:
    """The sightings of the time before the confirmation, as the confirmation recorded them."""
    for sighting in notice.sightings:
        at = at_frame.get(sighting.frame)
        if at is not None and (not fragment.hits or at < fragment.first.at):
            fragment.earlier.add(at, times[at], sighting.box)
    if len(fragment.earlier) and fragment.hits:
        fragment.head = Path([*fragment.earlier, *fragment.head][:_MOST_ENDS])
        fragment.tail = Path([*fragment.earlier, *fragment.tail][-_MOST_ENDS:])
        fragment.hits += len(fragment.earlier)
        for s in fragment.earlier:
            fragment._stand(s.box)
        fragment.sizes += math.fsum(
            math.sqrt(max(s.box[2] * s.box[3], 1.0)) for s in fragment.earlier
        )
