"""What hindsight believes of a life: that it is somebody, and that it is one and the same.

Existence. A life's log-odds are the mean of those of the detections that it was seen in
(`replay.trackers.belief`): ten looks at one poster are not ten proofs. A frame's `confidence` is
that of the life and of the frame's own detection together; where it was not seen, the frame says
nothing.

Of a life that was seen as pixels alone no detection's score speaks: what is asked is whether it
ever went anywhere. A boot lid that opens, a stain of light, whom the background had taken up: they
come up within the picture and stay. Looked at in eight recordings: who went by his own size is
somebody; who went by less than half of it, and was not there from the start, was a thing each of
five times; in between were far people and things alike. How surely somebody is found where he is
said to be depends on the recording, by the pieces that bodies lie in, and on the frame.

A detector's post or poster has a middling score in every frame. Who stays in one place may be
waiting; but for that the score is no better for being repeated, and fewer wait the longer it lasts.

Identity. Of those who come back after a gap without colours to know them by, e^(-(gap /
`FORGOTTEN_S`)^1.5) are who they were, as measured on five recordings: a short gap costs little.
(ETH-Bahnhof is not one of them: its truth gives a new number to who comes back.) Where colours are
known they count as the likelihood ratio that they are. The odds of being somebody else by now add
up over every gap, join and passing (`replay.hindsight.passing`); what is left is the life's
`identity` from there on; the other reading is that somebody else begins there.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from recorders.messages import Notice, Target, Targets, Withheld
from replay.hindsight.crossings import Crossing
from replay.hindsight.fragments import Fragment, reach, wandering
from replay.hindsight.joining import UNKNOWN, Join
from replay.hindsight.parameters import HindsightParameters

FORGOTTEN_S = 6.0
"""In such a gap the share of those who are who they were falls to 1/e, where there are no colours."""
_STEEP = 1.5
SEEING = 5.0
"""Who is followed in pictures is known for so many times longer."""
TELLING = 6.0
"""Log likelihood ratio of colours that are entirely the same to strangers' is so many times
`UNKNOWN`.
"""
STAYED = 0.5
"""Who went by so many of his sizes at most is as likely somebody, far away or waiting, as a thing."""
WHOLE, BROKEN = 3.2, 0.8
"""Log-odds that a life seen as pixels is somebody where it went anywhere: with bodies in one piece,
and what they lose with the logarithm of how many pieces bodies lie in, in this recording.
"""
UNSURE = 0.5
"""Where it went anywhere they are no less than this."""
SHARED = 1.2
"""And what they lose in a frame in which it shares a region with others, or is not seen."""
GOING = 6.0
"""And by how much they grow with a size of way."""
TELLS_S = 2.0
"""Who was seen for less, as the recording ended, may not have had the time to go anywhere."""
AROUND, ROAMING = 0.85, 0.3
"""Detections that lie within so many sizes are at one place; with so much less there is no doubt of
it.
"""
WAITS_S = 5.0
"""Who stays in one place for longer is a thing the likelier the longer it lasts."""
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

    @property
    def odds(self) -> float:
        """The odds that somebody else goes on."""
        return 1.0 / max(self.same, 1e-9) - 1.0


@dataclass(frozen=True, slots=True)
class CrossingDoubt:
    """Somebody was at one place with ``other`` (a final id, None where nothing is told of that one),
    nearest at frame ``at`` of the stream.
    """

    at: int
    other: int | None
    crossing: Crossing

    @property
    def odds(self) -> float:
        """The odds that he is somebody else by now."""
        return self.crossing.odds


def mean_odds(parts: Sequence[Fragment]) -> float | None:
    """The log-odds of a life being somebody; None where no detection's score speaks of it."""
    judged = sum(part.judged for part in parts)
    return math.fsum(part.odds for part in parts) / judged if judged else None


@dataclass(frozen=True, slots=True)
class Whole:
    """What is known of a whole life.

    Attributes:
        seconds: its length; ``from_start``, ``to_end``: it was there in the recording's first, its
            last frame.
        seen: the share of its frames in which it was observed.
        reach: how far it went at most, in sizes.
        odds: log-odds that it is somebody; None: nothing speaks of it.
        still: it is hardly somebody because, seen as pixels, it never went anywhere.
    """

    seconds: float
    from_start: bool
    to_end: bool
    seen: float
    reach: float
    odds: float | None
    still: bool


def whole(
    parts: Sequence[Fragment],
    seconds: float,
    from_start: bool,
    to_end: bool,
    moving: float | None,
) -> Whole:
    """What a life's fragments, and its length in seconds, say of it; ``moving``: the log-odds of
    who is seen as pixels and went anywhere, None where that is not asked.
    """
    frames = sum(f.last.at - f.first.at + 1 for f in parts)
    seen, odds = sum(f.hits for f in parts) / frames, mean_odds(parts)
    far = reach(parts) if odds is None else wandering(parts)
    still = False
    if odds is not None:
        one_place = min(1.0, max(0.0, (AROUND - far) / ROAMING))
        odds -= one_place * math.log(max(1.0, seconds / (WAITS_S * parts[0].second)))
    elif moving is not None:
        untold = from_start or (to_end and seconds < TELLS_S * parts[0].second)
        odds = moving if untold else min(moving, max(-moving, GOING * (far - STAYED)))
        still = parts[0].told and odds < 0
    return Whole(seconds, from_start, to_end, seen, far, odds, still)


def moving_odds(pieces: float) -> float:
    """Log-odds that somebody is who is seen as pixels and went anywhere, where bodies lie in so
    many pieces: fitted to the truth of seven recordings and seven generated scenes, each left out in turn.
    """
    return max(UNSURE, WHOLE - BROKEN * math.log(max(1.0, pieces)))


def likelihood(odds: float) -> float:
    """The probability of log-odds."""
    return 1.0 / (1.0 + math.exp(-min(max(odds, -50.0), 50.0)))


def why_not(
    parts: Sequence[Fragment], life: Whole, least_s: float, p: HindsightParameters
) -> str:
    """Why a life is not told, "" where it is; its fragments ``parts``."""
    if not parts[0].told:
        return "followed aside: the tracker never told of it"
    if life.odds is not None and life.odds < 0:
        sure = f"somebody with {likelihood(life.odds):.2f}, under 0.50"
        scores = mean_odds(parts)
        if scores is None or scores >= 0:
            return f"unlikely: it went by {life.reach:.2f} of its size at most: {sure}"
        return f"unlikely: its detections are {sure}"
    if life.seconds < least_s:
        return f"short: {life.seconds:.2f} s, under {least_s:.2f} s"
    if life.seen < p.min_support:
        return f"hardly seen: in {life.seen:.2f} of its frames, under {p.min_support:.2f}"
    return ""


def keeps(seconds: float, *, seeing: bool) -> float:
    """For how long an identity is known that is known so long without pictures."""
    return seconds * (SEEING if seeing else 1.0)


def lessened(identity: float, odds: float) -> float:
    """What is left of an identity once the odds of being somebody else have grown by so much.

    >>> lessened(0.5, 1.0)
    0.3333333333333333
    """
    return 1.0 / (1.0 / max(identity, 1e-9) + odds)


def survived(gap_s: float, *, seeing: bool) -> float:
    """How likely who is seen again after a gap is who he was, by the gap alone."""
    return math.exp(-((gap_s / keeps(FORGOTTEN_S, seeing=seeing)) ** _STEEP))


def doubts(
    parts: Sequence[Fragment], joins: Sequence[Join], has_images: bool
) -> list[Doubt]:
    """All that a life's identity rests on, in order."""
    found = [
        Doubt(int(at), gap, survived(gap / part.second, seeing=has_images))
        for part in parts
        for at, gap in part.gaps
    ]
    for f, join in zip(parts[1:], joins, strict=True):
        same = survived(join.gap_s / f.second, seeing=False)
        if join.appearance is not None:
            ratio = math.exp(TELLING * (UNKNOWN - join.appearance))
            same = same * ratio / (same * ratio + 1.0 - same)
        found.append(Doubt(f.first.at, join.gap_s, same, join))
    return sorted(found, key=lambda d: d.at)


def confidence(odds: float, target: Target, judged: bool) -> float:
    """The probability that a target of a life with such log-odds is somebody in this frame;
    ``judged``: by its detections' scores.
    """
    if not judged:
        return likelihood(odds if target.mode == "motion" else odds - SHARED)
    own = 0.0
    if target.observed and target.likely is not None:
        inside = min(max(target.likely, 0.001), 0.999)
        own = math.log(inside / (1.0 - inside))
    return likelihood(WITNESS * (odds + own))


def told_crossing(identity: int, doubt: CrossingDoubt, left: float) -> Notice | None:
    """The notice of a crossing that is worth one: nothing was exchanged without a word, nor is kept
    where that is unsure; ``left``: the life's identity after it.
    """
    crossing, same = doubt.crossing, lessened(1.0, doubt.odds)
    if same >= SURE and not crossing.exchanged:
        return None
    others = [] if doubt.other is None else [doubt.other]
    evidence = {
        "with": others,
        "price_as_themselves": crossing.straight,
        "price_exchanged": crossing.across,
        "same": same,
    }
    if crossing.exchanged:
        evidence["price_exchanged_under"] = crossing.exchanged_under
        evidence["alternative"] = "each is himself"
    else:
        evidence["same_under"] = SURE
        evidence["alternative"] = "exchanged, or somebody else"
    evidence |= {"identity": left, "alternative_probability": 1.0 - same}
    whom = f"target {others[0]}" if others else "another one"
    what = "exchanged with him" if crossing.exchanged else "he goes on as himself"
    text = (
        f"Target {identity} and {whom} were at one place: by the paths before and after {what},"
        f" with {same:.2f}."
    )
    rule = "ours: the paths before and after a crossing, as a whole"
    return Notice("identity", [identity], rule, evidence, text)


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
