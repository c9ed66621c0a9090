"""Encounters: two targets who approach one another, stay or walk together; not two who pass.

The rule, in body sizes (mean diagonal of the two boxes: about a person's height) and seconds,
over the moments in which both are observed:

1. *Together for sure* in a moment: standing within ``near_sizes`` and moving at most
   ``pace_sizes_per_s`` against one another. Two who pass are as near, but fast against one
   another; two who walk together are not.
2. A stretch with at most ``far_gap_sizes`` of room between the boxes (gaps up to ``gap_s``
   closed) is an encounter if it holds at least ``least_s`` of such moments. Two who pass slowly
   (along the line of sight, all motion looks slow) hold them too, but go *through*: from the
   first to the last such moment they drift from one side of the other to the other, or their
   whole time together is one straight way. Two who are together keep their place to one another,
   so an encounter drifts at most ``drift_sizes_per_s``, and where it moves by ``moved_sizes`` that
   is at most ``through_share`` of its path.
   And one of them moves by ``moved_sizes`` while both are there: two who only stand or sit, from
   first to last sight, show nothing.
   (In hindsight; live, nobody can tell yet.)
3. Its phases: *approach*, until in a moment together for sure they close in on one another no
   more; *together*; *parting*, after the last such moment in which they do not yet draw away. Only
   the time together counts as such. Together they are *moving* (both walk, the same way), in
   *contact* (JOINT, or abrupt against one another at touching distance, and not moving), or
   else *meeting*: an encounter's kind is what lasted longest (`phases`).

Nothing is learnt but the thresholds.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from reasoning.encounters.ground import GroundSlope, ground_of
from reasoning.encounters.pair import (
    Floats,
    History,
    Ints,
    Pair,
    frame_step,
    length,
    pairs,
    spans,
    velocity,
)
from reasoning.encounters.parameters import EncounterParameters
from reasoning.encounters.phases import (
    TOGETHER_KINDS,
    Abrupt,
    Phase,
    abrupt_stretches,
    cut,
)

Span = tuple[int, int]
_HALF_S = 0.5


@dataclass(frozen=True)
class Encounter:
    """Two targets a < b who met: from ``start_frame`` to ``end_frame``, both included, with
    approach and parting; together from ``together_frame`` to ``apart_frame``, both included.

    Attributes:
        kind: what lasted longest of the time together: meeting, moving or contact.
        confidence: how sure it is, in [0, 1]; see `confidence`.
        seen_share: share of the frames together in which both were seen.
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
    together_frame: int
    apart_frame: int
    together_s: float
    apart_s: float
    confidence: float
    seen_share: float
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
    ground: GroundSlope | None = None,
) -> list[Encounter]:
    """All encounters of a recording, by start frame, then a, then b.

    Args:
        histories: boxes over time of each target, by id.
        parameters: thresholds.
        joint: closed frame intervals in which a pair (a < b) was JOINT, for the contact phases.
        live: use only the past at each moment, and do not back-date the onset.
        ground: of the recording; None: as the targets' boxes tell.
    """
    p = parameters or EncounterParameters()
    found: list[Encounter] = []
    stretch = None if live else (ground or ground_of(histories)).stretch
    for a, b in side_by_side(histories):
        stretches = pairs(histories[a], histories[b], p.window_s, p.gap_s, live, stretch)
        touching = (joint or {}).get((a, b), ())
        found += [e for pair in stretches for e in _of_pair(a, b, pair, p, touching, live)]
    return sorted(found, key=lambda e: (e.start_frame, e.a, e.b))


def side_by_side(histories: Mapping[int, History]) -> Iterator[tuple[int, int]]:
    """Pairs (a < b) whose lives overlap: a sweep over the first frames, not the full product."""
    lives = sorted(
        (int(history.frames[0]), int(history.frames[-1]), i)
        for i, history in histories.items()
        if len(history.frames)
    )
    alive: list[tuple[int, int]] = []
    for first, last, i in lives:
        alive = [(end, j) for end, j in alive if end >= first]
        for _, j in sorted(alive, key=lambda x: x[1]):
            yield min(i, j), max(i, j)
        alive.append((last, i))


def _of_pair(
    a: int,
    b: int,
    pair: Pair,
    encounter_parameters: EncounterParameters,
    joint: Sequence[Span],
    live: bool,
) -> Iterator[Encounter]:
    sure = (pair.distance <= encounter_parameters.near_sizes) & (
        pair.relative_speed <= encounter_parameters.pace_sizes_per_s
    )
    step = frame_step(pair.times_s)
    for start, end in _closed(
        spans(pair.gap <= encounter_parameters.far_gap_sizes),
        pair,
        encounter_parameters.gap_s,
    ):
        near = np.flatnonzero(sure[start : end + 1]) + start
        least_s = encounter_parameters.live_s if live else encounter_parameters.least_s
        enough = max(1, round(least_s / step)) if step > 0 else 1
        if len(near) < enough:
            continue
        drifts = _drifts(pair, near)
        proven = enough - 1
        # live, the first moments cannot tell who goes through from who slows down to stay
        if not live:
            held = np.flatnonzero(drifts[proven:] <= encounter_parameters.drift_sizes_per_s)
            if drifts[-1] > encounter_parameters.drift_sizes_per_s or not _moved(
                pair, encounter_parameters
            ):
                continue
            proven += int(held[0])
        together = settled(pair, (start, end), near, encounter_parameters)
        if not live and _goes_through(pair, together, step, encounter_parameters):
            continue
        sure_at = int(near[proven])
        found = _Evidence(
            (sure_at if live else start, end),
            (max(sure_at, together[0]), max(sure_at, together[1])) if live else together,
            near,
            float(drifts[-1]),
            sure_at,
            step,
        )
        yield _encounter((a, b), pair, found, encounter_parameters, joint)


def _moved(pair: Pair, encounter_parameters: EncounterParameters) -> bool:
    """Whether one of the two ever gets away from where it was at first."""
    ways = (length(x - x[:1]) for x in (pair.place_a, pair.place_b))
    return any(float(way.max()) >= encounter_parameters.moved_sizes for way in ways)


def _goes_through(
    pair: Pair, together: Span, step: float, encounter_parameters: EncounterParameters
) -> bool:
    """Whether all their time together is one straight, steady way past one another: most of
    the time it is under way, so that who stops to talk does not.
    """
    first, last = together
    way = float(length(pair.apart[last : last + 1] - pair.apart[first : first + 1])[0])
    speeds = pair.relative_speed[first : last + 1]
    steady = float(np.median(speeds)) * len(speeds) * step >= way / 2
    straight = way > encounter_parameters.through_share * float(np.sum(speeds)) * step
    return way >= encounter_parameters.moved_sizes and straight and steady


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
    """Where an encounter lies in its pair: index span, that of the time together, moments
    together for sure, the one that proved it.
    """

    span: Span
    together: Span
    near: Ints
    drift: float
    proven: int
    step_s: float


def _encounter(
    ids: tuple[int, int],
    pair: Pair,
    found: _Evidence,
    encounter_parameters: EncounterParameters,
    joint: Sequence[Span],
) -> Encounter:
    near, step, (start, end) = found.near, found.step_s, found.span
    first, last = found.together
    phases = cut(pair, found.span, (first, last), encounter_parameters, joint)
    whole = slice(start, end + 1)
    seconds = {
        k: sum(phase.end_s - phase.start_s + step for phase in phases if phase.kind == k)
        for k in TOGETHER_KINDS
    }
    near_s = len(near) * step
    distance, pace = (
        float(np.median(pair.distance[near])),
        float(np.median(pair.relative_speed[near])),
    )
    held = np.searchsorted(pair.held, pair.frames[[first, last]])
    seen = pair.held_seen[int(held[0]) : int(held[1]) + 1]
    return Encounter(
        a=ids[0], b=ids[1],
        kind=max(TOGETHER_KINDS, key=lambda k: (seconds[k], -TOGETHER_KINDS.index(k))),
        start_frame=int(pair.frames[start]), end_frame=int(pair.frames[end]),
        start_s=float(pair.times_s[start]), end_s=float(pair.times_s[end]),
        together_frame=int(pair.frames[first]), apart_frame=int(pair.frames[last]),
        together_s=float(pair.times_s[first]), apart_s=float(pair.times_s[last]),
        confidence=confidence(
            min(near_s, float(pair.times_s[last] - pair.times_s[first]) + step), distance
        ),
        seen_share=round(int(np.count_nonzero(seen)) / len(seen), 4),
        near_s=near_s, distance=distance, relative_speed=pace, drift=found.drift,
        sure_frame=int(pair.frames[found.proven]), phases=phases,
        all_distance=float(np.median(pair.distance[whole])),
        all_relative_speed=float(np.median(pair.relative_speed[whole])),
        abrupt=abrupt_stretches(pair, found.span, (first, last), encounter_parameters),
    )  # fmt: skip


def settled(
    pair: Pair, span: Span, near: Ints, encounter_parameters: EncounterParameters
) -> Span:
    """First and last moment together: near without closing in on one another any more, or
    drawing away already, on from the moments together for sure.
    """
    opening = _opening(pair)
    stays = (
        opening > -encounter_parameters.walk_sizes_per_s,
        opening < encounter_parameters.walk_sizes_per_s,
    )
    firm = [near[stay[near]] for stay in stays]
    first = int(firm[0][0] if len(firm[0]) else near[0])
    last = int(firm[1][-1] if len(firm[1]) else near[-1])
    if first > last:
        return int(near[0]), int(near[-1])
    close = pair.distance <= encounter_parameters.near_sizes
    while first > span[0] and close[first - 1] and stays[0][first - 1]:
        first -= 1
    while last < span[1] and close[last + 1] and stays[1][last + 1]:
        last += 1
    return first, last


def _opening(pair: Pair) -> Floats:
    """(N,) body sizes per second by which the distance grows around each moment."""
    step = frame_step(pair.times_s)
    half = max(1, round(_HALF_S / step)) if step > 0 else 1
    along = np.stack([pair.distance, np.zeros_like(pair.distance)], axis=1)
    opening: Floats = velocity(along, pair.times_s, half)[:, 0]
    return opening


def confidence(together_s: float, distance: float) -> float:
    """How often two who looked like this were together, in [0, 1).

    The odds are so many times the seconds together, and fall with the median distance in body
    sizes: a logistic function fitted to all encounters that the rule finds in the places that it
    was chosen on; relative speed and drift add nothing to these two.
    """
    odds = 12.0 * together_s * math.exp(-4.6 * distance)
    return round(odds / (1.0 + odds), 4)
