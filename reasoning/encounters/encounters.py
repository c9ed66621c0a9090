"""Encounters: two targets who approach one another, stay or walk together; not two who pass.

The rule, in body sizes (mean diagonal of the two boxes: about a person's height) and seconds:

1. *Together for sure* in a moment: distance at most ``near_sizes`` and relative speed at most
   ``pace_sizes_per_s``. Two who pass are as near, but fast against one another; two who walk
   together are not.
2. A stretch with distance at most ``far_sizes`` (gaps up to ``gap_s`` closed) is an encounter if
   it holds at least ``least_s`` of such moments. So onset and end are back-dated: to the time
   when they had come within ``far_sizes`` and until they leave it. Live, the onset is the moment
   at which the evidence suffices. Two who pass slowly (along the line of sight, all motion looks
   slow) hold it too, but go *through*: from the first to the last such moment they drift from one
   side of the other to the other. Two who are together keep their place to one another, so an
   encounter drifts at most ``drift_sizes_per_s`` (in hindsight; live, nobody can tell yet).
3. Every encounter is cut into phases: *moving* (both walk, the same way), *contact* (JOINT, or
   abrupt against one another at touching distance, and not moving), *separation* (the last way
   apart), else *meeting*. Its kind is the phase that lasted longest (`phases`).

Distance with hysteresis and duration are the two cues that carry most (on CAVIAR, never-labelled
episodes of nearness last 24 frames, labelled ones 190, medians); relative speed is the third.
Nothing is learnt but the thresholds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reasoning.encounters.pair import Floats, History, Ints, Pair, length, pairs, spans
from reasoning.encounters.parameters import EncounterParameters
from reasoning.encounters.phases import KINDS, Abrupt, Phase, abrupt_stretches, cut

Span = tuple[int, int]


@dataclass(frozen=True)
class Encounter:
    """Two targets a < b who were together from ``start_frame`` to ``end_frame``, both included.

    Attributes:
        kind: one of `KINDS`, the phase that lasted longest.
        confidence: in [0, 1): grows with the time together for sure, falls with relative speed
            and distance.
        near_s: time together for sure.
        distance: median distance of the moments together for sure, body sizes.
        relative_speed: their median relative speed, body sizes per second.
        drift: mean relative velocity from the first to the last of them, body sizes per second.
        sure_frame: the frame at which the evidence sufficed; the onset is back-dated from there.
        phases: the parts, in order, without gaps.
        all_distance, all_relative_speed: the medians over all of its frames.
        abrupt: when the two were abrupt against one another (see `phases`).
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
    all_distance: float = 0.0
    all_relative_speed: float = 0.0
    abrupt: tuple[Abrupt, ...] = ()


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
    lives = sorted(
        (int(h.frames[0]), int(h.frames[-1]), i)
        for i, h in histories.items()
        if len(h.frames)
    )
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
        # live, the first moments cannot tell who goes through from who slows down to stay
        if not live:
            held = np.flatnonzero(drifts[proven:] <= p.drift_sizes_per_s)
            if drifts[-1] > p.drift_sizes_per_s:
                continue
            proven += int(held[0])
        sure_at = int(near[proven])
        found = _Evidence(
            (sure_at if live else start, end), near, float(drifts[-1]), sure_at, step
        )
        yield _encounter((a, b), pair, found, p, joint)


def _drifts(pair: Pair, near: Ints) -> Floats:
    """(N,) mean relative velocity from the first moment to each, body sizes per second; 0 at the
    first.
    """
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
    """Where an encounter lies in its pair: index span, moments together for sure, the one that
    proved it.
    """

    span: Span
    near: Ints
    drift: float
    proven: int
    step_s: float


def _encounter(
    ids: tuple[int, int],
    pair: Pair,
    found: _Evidence,
    p: EncounterParameters,
    joint: Sequence[Span],
) -> Encounter:
    near, step, (start, end) = found.near, found.step_s, found.span
    phases = cut(pair, found.span, int(near[-1]), p, joint)
    whole = slice(start, end + 1)
    seconds = {
        k: sum(x.end_s - x.start_s + step for x in phases if x.kind == k) for k in KINDS
    }
    near_s = len(near) * step
    distance, pace = (
        float(np.median(pair.distance[near])),
        float(np.median(pair.relative_speed[near])),
    )
    support = near_s / (near_s + p.least_s) if near_s + p.least_s > 0 else 0.0
    doubt = 0.25 * min(1.0, pace / p.pace_sizes_per_s) + 0.25 * min(
        1.0, distance / p.near_sizes
    )
    return Encounter(
        a=ids[0], b=ids[1], kind=max(KINDS, key=lambda k: (seconds[k], -KINDS.index(k))),
        start_frame=int(pair.frames[start]), end_frame=int(pair.frames[end]),
        start_s=float(pair.times_s[start]), end_s=float(pair.times_s[end]),
        confidence=round(support * (1 - doubt), 4), near_s=near_s, distance=distance, relative_speed=pace,
        drift=found.drift,
        sure_frame=int(pair.frames[found.proven]), phases=phases,
        all_distance=float(np.median(pair.distance[whole])),
        all_relative_speed=float(np.median(pair.relative_speed[whole])),
        abrupt=abrupt_stretches(pair, found.span, int(near[-1]), p),
    )  # fmt: skip
