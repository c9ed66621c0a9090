"""What hindsight believes of a life: that it is somebody, and that it is one and the same.

Existence. A life's log-odds are the mean of those of the detections that it was seen in
(`replay.trackers.belief`): ten looks at one poster are not ten proofs. A frame's `confidence` is
that of the life and of the frame's own detection together; where it was not seen, the frame says
nothing. Of lives that were seen as pixels, not as detections, only their length and how much of
them was seen is asked.

Identity. Of those who come back after a gap without colours to know them by, e^(-gap / `FORGOTTEN_S`)
are who they were, as measured on eight recordings. Where colours are known they count as the
likelihood ratio that they are. What is left after every gap and join is the life's `identity`
from there on; the other reading is that somebody else begins there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from recorders.messages import Notice, Target, Targets, Withheld
from replay.hindsight.fragments import Fragment
from replay.hindsight.joining import UNKNOWN, Join
from replay.hindsight.parameters import HindsightParameters

FORGOTTEN_S = 1.9
"""In such a gap the share of those who are who they were falls to 1/e, where there are no colours."""
SEEING = 3.0
"""Who is followed in pictures is known for so many times longer."""
TELLING = 6.0
"""Log likelihood ratio of colours that are entirely the same to strangers' is so many times
`UNKNOWN`.
"""
WITNESS = 2 / 3
"""The life and the frame's own detection agree more often than not, so each counts for so much."""
SURE = 0.9
"""An identity that falls to less at once is told."""


@dataclass(frozen=True, slots=True)
class Doubt:
    """A gap in a life: it ended at frame ``at`` of the stream; ``same``: probability that it went
    on as the same.
    """

    at: int
    gap_s: float
    same: float
    join: Join | None = None


def mean_odds(parts: Sequence[Fragment]) -> float | None:
    """The log-odds of a life being somebody; None where no detection's score speaks of it."""
    judged = sum(part.judged for part in parts)
    return math.fsum(part.odds for part in parts) / judged if judged else None


def likelihood(odds: float) -> float:
    """The probability of log-odds."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -50.0), 50.0)))


def why_not(
    parts: Sequence[Fragment], seconds: float, least_s: float, p: HindsightParameters
) -> str:
    """Why a life is not told, "" where it is; its fragments ``parts``, its length in seconds."""
    if not parts[0].told:
        return "followed aside: the tracker never told of it"
    frames = sum(part.last.at - part.first.at + 1 for part in parts)
    seen = sum(part.hits for part in parts) / frames
    odds = mean_odds(parts)
    if odds is not None and odds < 0:
        return (
            f"unlikely: its detections are somebody with {likelihood(odds):.2f}, under 0.50"
        )
    if seconds < least_s:
        return f"short: {seconds:.2f} s, under {least_s:.2f} s"
    if seen < p.min_support:
        return f"hardly seen: in {seen:.2f} of its frames, under {p.min_support:.2f}"
    return ""


def doubts(
    parts: Sequence[Fragment], joins: Sequence[Join], has_images: bool
) -> list[Doubt]:
    """All that a life's identity rests on, in order."""
    keeps = FORGOTTEN_S * (SEEING if has_images else 1.0)
    found = [
        Doubt(int(at), gap, math.exp(-gap / keeps))
        for part in parts
        for at, gap in part.gaps
    ]
    for f, join in zip(parts[1:], joins, strict=True):
        same = math.exp(-join.gap_s / FORGOTTEN_S)
        if join.appearance is not None:
            ratio = math.exp(TELLING * (UNKNOWN - join.appearance))
            same = same * ratio / (same * ratio + 1.0 - same)
        found.append(Doubt(f.first.at, join.gap_s, same, join))
    return sorted(found, key=lambda d: d.at)


def confidence(odds: float, target: Target) -> float:
    """The probability that a target of a life with such log-odds is somebody in this frame."""
    own = 0.0
    if target.observed and target.likely is not None:
        inside = min(max(target.likely, 0.001), 0.999)
        own = math.log(inside / (1.0 - inside))
    return likelihood(WITNESS * (odds + own))


def told_doubt(identity: int, doubt: Doubt, left: float) -> Notice | None:
    """The notice of a doubt that is worth one; ``left``: the life's identity after it."""
    if doubt.same >= SURE:
        return None
    evidence = {
        "gap_s": doubt.gap_s,
        "same": doubt.same,
        "same_under": SURE,
        "identity": left,
        "alternative": "somebody else begins here",
        "alternative_probability": 1.0 - doubt.same,
    }
    if doubt.join is not None:
        evidence |= {"fragment": doubt.join.later, "after": doubt.join.earlier}
    text = (
        f"Target {identity} is seen again after {doubt.gap_s:.1f} s: the same with"
        f" {doubt.same:.2f}, else somebody else."
    )
    return Notice(
        "identity", [identity], "ours: how often a gap is survived", evidence, text
    )


def withheld(answer: Targets, reasons: Mapping[int, str]) -> list[Withheld]:
    """What of a forward answer is held back, by forward id."""
    return [
        Withheld(target.measured or target.box, reasons[target.id], target.likely)
        for target in answer.targets
        if target.observed and target.id in reasons
    ]
