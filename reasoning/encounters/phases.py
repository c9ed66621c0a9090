"""The parts of an encounter with what was measured in each of them: approach; meeting, moving
and contact, which are the time together; separation, the parting.

*Contact* is JOINT, or abrupt against one another at touching distance: candidates for a fight.
From pixels two are JOINT whenever one walks before the other, and two who merely pass are abrupt
for a moment; so *abrupt* stretches are found on their own, without JOINT: those that do not go
through. Who passes goes from one side of the other to the other, so the way from the first to the
last moment is a straight line at the speed that was measured; two who fight hold on to their
place.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from reasoning.encounters.pair import Bools, Floats, Ints, Pair, frame_step, length, spans
from reasoning.encounters.parameters import EncounterParameters

KINDS = ("meeting", "moving", "contact", "separation", "approach")
TOGETHER_KINDS = KINDS[:3]
PHASES: Mapping[str, str] = {
    **dict.fromkeys(TOGETHER_KINDS, "together"),
    "separation": "parting",
    "approach": "approach",
}
"""The phase of an encounter that a kind belongs to."""
SAME_WAY = 0.5
Span = tuple[int, int]


@dataclass(frozen=True)
class Phase:
    """A part of an encounter of one kind, frames and seconds, ends included; lengths in body sizes.

    Attributes:
        kind: one of `KINDS`.
        distance, relative_speed, agitation: medians over its frames.
        slower: median of the slower one's speed.
        heading: median cosine between the two motions.
        end_distance: in its last frame.
        abrupt_s: time in it at touching distance and abrupt.
    """

    kind: str
    start_frame: int
    end_frame: int
    start_s: float
    end_s: float
    distance: float
    relative_speed: float
    agitation: float
    slower: float
    heading: float
    end_distance: float
    abrupt_s: float


@dataclass(frozen=True)
class Abrupt:
    """A time in which two at touching distance were abrupt against one another and did not go
    through.

    Attributes:
        abrupt_s: time in it that is so by itself; the rest are lulls.
        distance, agitation: medians over the moments that are so by themselves, body sizes (per
            second).
        through: the way from the first to the last moment, as a share of a straight line at that
            agitation.
    """

    start_frame: int
    end_frame: int
    start_s: float
    end_s: float
    abrupt_s: float
    distance: float
    agitation: float
    through: float


def cut(
    pair: Pair,
    span: Span,
    together: Span,
    parameters: EncounterParameters,
    joint: Sequence[Span],
) -> tuple[Phase, ...]:
    """The phases of an encounter, in order, without gaps.

    Args:
        pair: the two over time.
        span: the encounter, first and last index.
        together: first and last index of the time together.
        parameters: thresholds.
        joint: closed frame intervals in which the two were JOINT.
    """
    start, _ = span
    sudden = _sudden(pair, parameters)
    return tuple(
        _phase(pair, KINDS[code], start + s, start + e, sudden)
        for code, s, e in _parts(pair, span, together, parameters, joint, sudden)
    )


def abrupt_stretches(
    pair: Pair, span: Span, together: Span, parameters: EncounterParameters
) -> tuple[Abrupt, ...]:
    """What would be the contacts of an encounter without any JOINT, those left out that go
    through.
    """
    start, _ = span
    sudden = _sudden(pair, parameters)
    found = [
        _abrupt(pair, start + s, start + e, sudden)
        for code, s, e in _parts(pair, span, together, parameters, (), sudden)
        if KINDS[code] == "contact"
    ]
    return tuple(a for a in found if a.through <= parameters.through_share)


def _sudden(pair: Pair, parameters: EncounterParameters) -> Bools:
    """(N,) at touching distance, abrupt against one another, and not walking the same way."""
    found: Bools = (
        (pair.distance <= parameters.touch_sizes)
        & (pair.agitation >= parameters.abrupt_sizes_per_s)
        & ~_moving(pair, parameters)
    )
    return found


def _moving(pair: Pair, parameters: EncounterParameters) -> Bools:
    walking = (pair.speed_a >= parameters.walk_sizes_per_s) & (
        pair.speed_b >= parameters.walk_sizes_per_s
    )
    found: Bools = walking & (pair.heading >= SAME_WAY)
    return found


def _parts(
    pair: Pair,
    span: Span,
    together: Span,
    parameters: EncounterParameters,
    joint: Sequence[Span],
    sudden: Bools,
) -> list[tuple[int, int, int]]:
    """(index into `KINDS`, first, last), indices from the encounter's first."""
    start, end = span
    part = slice(start, end + 1)
    moving = _moving(pair, parameters)[part]
    contact = _contact(pair, part, parameters, joint, moving, sudden[part].copy())
    code = np.where(contact, 2, np.where(moving, 1, 0))
    first, last = together[0] - start, together[1] - start
    code[first : last + 1] = _steady(
        code[first : last + 1],
        pair.times_s[start + first : start + last + 1],
        parameters.window_s,
    )
    code[:first], code[last + 1 :] = 4, 3
    cuts = [0, *(np.flatnonzero(np.diff(code)) + 1).tolist(), len(code)]
    return [(int(code[s]), s, e - 1) for s, e in pairwise(cuts)]


def _contact(
    pair: Pair,
    part: slice,
    parameters: EncounterParameters,
    joint: Sequence[Span],
    moving: Bools,
    contact: Bools,
) -> Bools:
    """Not walking the same way, and JOINT or abrupt against one another at touching distance;
    lulls are closed.
    """
    times = pair.times_s[part]
    found = spans(contact)
    for (_, end), (start, _) in pairwise(found):
        if times[start] - times[end] <= parameters.gap_s:
            contact[end:start] = True
    frames = pair.frames[part]
    for first, last in joint:
        contact |= (frames >= first) & (frames <= last) & ~moving
    return contact


def _steady(code: Ints, times_s: Floats, least_s: float) -> Ints:
    """Phases shorter than ``least_s`` go to the phase before them (the first one to the phase
    after it).
    """
    out = code.copy()
    cuts = [0, *(np.flatnonzero(np.diff(out)) + 1).tolist(), len(out)]
    for s, e in pairwise(cuts):
        if times_s[e - 1] - times_s[s] < least_s and len(cuts) > 2:
            out[s:e] = out[s - 1] if s > 0 else out[min(e, len(out) - 1)]
    return out


def _phase(pair: Pair, kind: str, first: int, last: int, sudden: Bools) -> Phase:
    part = slice(first, last + 1)
    return Phase(
        kind, int(pair.frames[first]), int(pair.frames[last]), float(pair.times_s[first]), float(pair.times_s[last]),
        distance=_median(pair.distance[part]), relative_speed=_median(pair.relative_speed[part]),
        agitation=_median(pair.agitation[part]), slower=_median(np.minimum(pair.speed_a[part], pair.speed_b[part])),
        heading=_median(pair.heading[part]), end_distance=float(pair.distance[last]),
        abrupt_s=int(np.count_nonzero(sudden[part])) * _step(pair),
    )  # fmt: skip


def _abrupt(pair: Pair, first: int, last: int, sudden: Bools) -> Abrupt:
    held = np.flatnonzero(sudden[first : last + 1]) + first
    # A contact may have taken in the short phase before or after it, but never consists of
    # nothing else.
    seconds = float(pair.times_s[last] - pair.times_s[first])
    agitation = _median(pair.agitation[held])
    moved = float(length(pair.apart[last : last + 1] - pair.apart[first : first + 1])[0])
    return Abrupt(
        int(pair.frames[first]), int(pair.frames[last]), float(pair.times_s[first]), float(pair.times_s[last]),
        abrupt_s=len(held) * _step(pair), distance=_median(pair.distance[held]), agitation=agitation,
        through=moved / (seconds * agitation) if seconds > 0 and agitation > 0 else 0.0,
    )  # fmt: skip


def _step(pair: Pair) -> float:
    return frame_step(pair.times_s)


def _median(values: Floats) -> float:
    return float(np.median(values))
