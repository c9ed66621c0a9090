"""Encounters: two targets who approach one another, stay or walk together; not two who pass.

The rule, in body sizes (mean diagonal of the two boxes: about a person's height) and seconds:

1. *Together for sure* in a moment: distance at most ``near_sizes`` and relative speed at most ``pace_sizes_per_s``.
   Two who pass are as near, but fast against one another; two who walk together are not.
2. A stretch with distance at most ``far_sizes`` (gaps up to ``gap_s`` closed) is an encounter if it holds at least
   ``least_s`` of such moments. So onset and end are back-dated: to the time when they had come within ``far_sizes``
   and until they leave it. Live, the onset is the moment at which the evidence suffices.
   Two who pass slowly (along the line of sight, all motion looks slow) hold it too, but go *through*: from the first
   to the last such moment they drift from one side of the other to the other. Two who are together keep their place to
   one another, so an encounter drifts at most ``drift_sizes_per_s`` (in hindsight; live, nobody can tell yet).
3. Every encounter is cut into phases: *moving* (both walk, the same way), *contact* (JOINT, or abrupt against one
   another at touching distance, and not moving), *separation* (the last way apart), else *meeting*. Its kind is the
   phase that lasted longest.

Distance with hysteresis and duration are the two cues that carry most (on CAVIAR, never-labelled episodes of nearness
last 24 frames, labelled ones 190, medians); relative speed is the third. Nothing is learnt but the thresholds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from reasoning.encounters.pair import Bools, Floats, History, Ints, Pair, length, pairs, spans
from recorders.parameters import Parameters, param

KINDS = ("meeting", "moving", "contact", "separation")
Span = tuple[int, int]


@dataclass(frozen=True)
class EncounterParameters(Parameters):
    """Thresholds of the encounters. A body size is the mean diagonal of the two boxes."""

    near_sizes: float = param(1.0, "together for sure within this distance", unit="body sizes", low=0.1, high=10)
    far_sizes: float = param(2.0, "an encounter begins and ends at this distance", unit="body sizes", low=0.1, high=20)
    pace_sizes_per_s: float = param(
        0.6, "together for sure up to this relative speed", unit="body sizes/s", low=0.05, high=20
    )
    drift_sizes_per_s: float = param(
        0.3,
        "mean relative velocity from the first to the last moment together for sure, at most",
        unit="body sizes/s",
        low=0.01,
        high=20,
    )
    least_s: float = param(1.5, "least time together for sure", unit="s", low=0.0, high=60)
    live_s: float = param(0.4, "live, an encounter is announced after this time", unit="s", low=0.0, high=60)
    gap_s: float = param(1.0, "gaps up to this long are closed", unit="s", low=0.0, high=60)
    window_s: float = param(0.5, "distances are median filtered over this time", unit="s", low=0.0, high=10)
    walk_sizes_per_s: float = param(0.15, "who walks is at least this fast", unit="body sizes/s", low=0.0, high=10)
    touch_sizes: float = param(0.6, "touching distance", unit="body sizes", low=0.05, high=5)
    abrupt_sizes_per_s: float = param(
        0.4,
        "abrupt: relative speed over half a second of two who touch, from here",
        unit="body sizes/s",
        low=0.05,
        high=20,
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.far_sizes < self.near_sizes:
            object.__setattr__(self, "far_sizes", self.near_sizes)


@dataclass(frozen=True)
class Phase:
    """A part of an encounter of one kind, frames and seconds, ends included."""

    kind: str
    start_frame: int
    end_frame: int
    start_s: float
    end_s: float


@dataclass(frozen=True)
class Encounter:
    """Two targets a < b who were together from ``start_frame`` to ``end_frame``, both included.

    Attributes:
        kind: one of `KINDS`, the phase that lasted longest.
        confidence: in [0, 1): grows with the time together for sure, falls with relative speed and distance.
        near_s: time together for sure.
        distance: median distance of the moments together for sure, body sizes.
        relative_speed: their median relative speed, body sizes per second.
        drift: mean relative velocity from the first to the last of them, body sizes per second.
        sure_frame: the frame at which the evidence sufficed; the onset is back-dated from there.
        phases: the parts, in order, without gaps.
    """

    a: int
    b: int
    kind: str
    start_frame: int
    end_frame: int
    start_s: float
    end_s: float
    confidence: float
    near_s: float
    distance: float
    relative_speed: float
    drift: float
    sure_frame: int
    phases: tuple[Phase, ...]


def find_encounters(
    histories: Mapping[int, History],
    parameters: EncounterParameters | None = None,
    *,
    joint: Mapping[tuple[int, int], Sequence[Span]] | None = None,
    live: bool = False,
) -> list[Encounter]:
    """All encounters of a recording, by start frame, then a, then b.

    Args:
        histories: boxes over time of each target, by id.
        parameters: thresholds.
        joint: closed frame intervals in which a pair (a < b) was JOINT, for the contact phases.
        live: use only the past at each moment, and do not back-date the onset.
    """
    p = parameters or EncounterParameters()
    found: list[Encounter] = []
    for a, b in side_by_side(histories):
        stretches = pairs(histories[a], histories[b], p.window_s, p.gap_s, causal=live)
        touching = (joint or {}).get((a, b), ())
        found += [e for pair in stretches for e in _of_pair(a, b, pair, p, touching, live)]
    return sorted(found, key=lambda e: (e.start_frame, e.a, e.b))


def side_by_side(histories: Mapping[int, History]) -> Iterator[tuple[int, int]]:
    """Pairs (a < b) whose lives overlap: a sweep over the first frames, not the full product."""
    lives = sorted((int(h.frames[0]), int(h.frames[-1]), i) for i, h in histories.items() if len(h.frames))
    alive: list[tuple[int, int]] = []
    for first, last, i in lives:
        alive = [(end, j) for end, j in alive if end >= first]
        for _, j in sorted(alive, key=lambda x: x[1]):
            yield min(i, j), max(i, j)
        alive.append((last, i))


def _of_pair(
    a: int, b: int, pair: Pair, p: EncounterParameters, joint: Sequence[Span], live: bool
) -> Iterator[Encounter]:
    sure = (pair.distance <= p.near_sizes) & (pair.relative_speed <= p.pace_sizes_per_s)
    step = float(np.median(np.diff(pair.times_s)))
    for start, end in _closed(spans(pair.distance <= p.far_sizes), pair, p.gap_s):
        near = np.flatnonzero(sure[start : end + 1]) + start
        least_s = p.live_s if live else p.least_s
        enough = max(1, round(least_s / step)) if step > 0 else 1
        if len(near) < enough:
            continue
        drifts = _drifts(pair, near)
        proven = enough - 1
        if not live:  # live, the first moments cannot tell who goes through from who slows down to stay
            held = np.flatnonzero(drifts[proven:] <= p.drift_sizes_per_s)
            if drifts[-1] > p.drift_sizes_per_s:
                continue
            proven += int(held[0])
        sure_at = int(near[proven])
        found = _Evidence((sure_at if live else start, end), near, float(drifts[-1]), sure_at, step)
        yield _encounter((a, b), pair, found, p, joint)


def _drifts(pair: Pair, near: Ints) -> Floats:
    """(N,) mean relative velocity from the first moment to each, body sizes per second; 0 at the first."""
    moved = length(pair.apart[near] - pair.apart[near[:1]])
    seconds = pair.times_s[near] - pair.times_s[near[:1]]
    drift: Floats = np.where(seconds > 0, moved / np.where(seconds > 0, seconds, 1.0), 0.0)
    return drift


def _closed(found: list[Span], pair: Pair, gap_s: float) -> list[Span]:
    out: list[Span] = []
    for start, end in found:
        if out and pair.times_s[start] - pair.times_s[out[-1][1]] <= gap_s:
            out[-1] = (out[-1][0], end)
        else:
            out.append((start, end))
    return out


@dataclass(frozen=True)
class _Evidence:
    """Where an encounter lies in its pair: index span, moments together for sure, the one that proved it."""

    span: Span
    near: Ints
    drift: float
    proven: int
    step_s: float


def _encounter(
    ids: tuple[int, int], pair: Pair, found: _Evidence, p: EncounterParameters, joint: Sequence[Span]
) -> Encounter:
    near, step, (start, end) = found.near, found.step_s, found.span
    phases = _phases(pair, found.span, int(near[-1]), p, joint)
    seconds = {k: sum(x.end_s - x.start_s + step for x in phases if x.kind == k) for k in KINDS}
    near_s = len(near) * step
    distance, pace = float(np.median(pair.distance[near])), float(np.median(pair.relative_speed[near]))
    support = near_s / (near_s + p.least_s) if near_s + p.least_s > 0 else 0.0
    doubt = 0.25 * min(1.0, pace / p.pace_sizes_per_s) + 0.25 * min(1.0, distance / p.near_sizes)
    return Encounter(
        a=ids[0], b=ids[1], kind=max(KINDS, key=lambda k: (seconds[k], -KINDS.index(k))),
        start_frame=int(pair.frames[start]), end_frame=int(pair.frames[end]),
        start_s=float(pair.times_s[start]), end_s=float(pair.times_s[end]),
        confidence=round(support * (1 - doubt), 4), near_s=near_s, distance=distance, relative_speed=pace,
        drift=found.drift,
        sure_frame=int(pair.frames[found.proven]), phases=phases,
    )  # fmt: skip


def _phases(pair: Pair, span: Span, last_near: int, p: EncounterParameters, joint: Sequence[Span]) -> tuple[Phase, ...]:
    start, end = span
    part = slice(start, end + 1)
    walking = (pair.speed_a[part] >= p.walk_sizes_per_s) & (pair.speed_b[part] >= p.walk_sizes_per_s)
    moving = walking & (pair.heading[part] >= 0.5)
    contact = _contact(pair, part, p, joint, moving)
    apart = np.zeros(end - start + 1, bool)
    if pair.distance[end] > p.near_sizes:
        apart[max(0, last_near + 1 - start) :] = True
    code = np.where(contact, 2, np.where(apart, 3, np.where(moving, 1, 0)))
    code = _steady(code, pair.times_s[part], p.window_s)
    cuts = [0, *(np.flatnonzero(np.diff(code)) + 1).tolist(), len(code)]
    return tuple(
        Phase(
            KINDS[int(code[s])],
            int(pair.frames[start + s]),
            int(pair.frames[start + e - 1]),
            float(pair.times_s[start + s]),
            float(pair.times_s[start + e - 1]),
        )
        for s, e in pairwise(cuts)
    )


def _contact(pair: Pair, part: slice, p: EncounterParameters, joint: Sequence[Span], moving: Bools) -> Bools:
    """Not walking the same way, and JOINT or abrupt against one another at touching distance; lulls are closed."""
    times = pair.times_s[part]
    contact = (pair.distance[part] <= p.touch_sizes) & (pair.agitation[part] >= p.abrupt_sizes_per_s) & ~moving
    found = spans(contact)
    for (_, end), (start, _) in pairwise(found):
        if times[start] - times[end] <= p.gap_s:
            contact[end:start] = True
    frames = pair.frames[part]
    for first, last in joint:
        contact |= (frames >= first) & (frames <= last) & ~moving
    return contact


def _steady(code: Ints, times_s: Floats, least_s: float) -> Ints:
    """Phases shorter than ``least_s`` go to the phase before them (the first one to the phase after it)."""
    out = code.copy()
    cuts = [0, *(np.flatnonzero(np.diff(out)) + 1).tolist(), len(out)]
    for s, e in pairwise(cuts):
        if times_s[e - 1] - times_s[s] < least_s and len(cuts) > 2:
            out[s:e] = out[s - 1] if s > 0 else out[min(e, len(out) - 1)]
    return out
