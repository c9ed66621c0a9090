"""Whoever passes close to somebody may have been taken for him: what is left of an identity then.

Two who come to one place, or one before the other, and part again may have exchanged their
identities, and nothing else in their paths tells. Fitted to eleven recordings (two detectors'
boxes, and pixels): of identities, e^(-s / `PASSING_S`) are what they were after s seconds at one
place with somebody, without colours; what lasts longer than `MOST_S` is company, and costs no more.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from recorders.messages import Notice, Target
from replay.hindsight.verdicts import SURE, keeps
from replay.trackers.association import overlaps

PASSING_S = 5.0
"""After so many seconds at one place with others an identity's probability falls to 1/e, where
there are no colours.
"""
TOUCH = 0.2
"""Two are at one place where so much of the smaller box lies within the other."""
MOST_S, APART_S = 2.0, 0.5
"""One passing counts for so long at most; who was apart for less is still in the same."""


@dataclass(slots=True)
class Passed:
    """The passing that somebody is in: since when, with whom, seconds that counted, when last."""

    others: list[int]
    seconds: float
    last_ns: int
    told: bool = False


class Passing:
    """Follows who is at one place with whom, frame by frame.

    Args:
        seeing: there are pictures to know people by.
    """

    def __init__(self, *, seeing: bool) -> None:
        self._keeps = keeps(PASSING_S, seeing=seeing)
        self._now: dict[int, Passed] = {}

    def step(
        self, targets: Sequence[Target], time_ns: int, dt: float
    ) -> dict[int, tuple[float, Notice | None]]:
        """A frame: of whom is at one place with others, by which factor his identity falls, and
        what is to be told of that once.

        Args:
            targets: who is present.
            time_ns: the frame's capture time.
            dt: seconds since the frame before.
        """
        self._now = {
            k: p for k, p in self._now.items() if time_ns - p.last_ns <= APART_S * 1e9
        }
        found: dict[int, tuple[float, Notice | None]] = {}
        for identity, others in _touching(targets).items():
            passed = self._now.setdefault(identity, Passed([], 0.0, time_ns))
            passed.others += [k for k in others if k not in passed.others]
            passed.last_ns = time_ns
            counted = min(dt, MOST_S - passed.seconds)
            passed.seconds += counted
            same = math.exp(-passed.seconds / self._keeps)
            notice = None
            if same < SURE and not passed.told:
                passed.told = True
                notice = self._notice(identity, passed, same)
            found[identity] = math.exp(-counted / self._keeps), notice
        return found

    @staticmethod
    def _notice(identity: int, passed: Passed, same: float) -> Notice:
        others = sorted(passed.others)
        names = " and ".join(map(str, others))
        evidence = {
            "together_s": passed.seconds,
            "with": others,
            "same": same,
            "same_under": SURE,
            "alternative": "exchanged with one of them",
            "alternative_probability": 1.0 - same,
        }
        text = (
            f"Target {identity} was at one place with {names} for"
            f" {passed.seconds:.1f} s: the same with {same:.2f}, else exchanged."
        )
        return Notice(
            "identity", [identity], "ours: how often a passing is survived", evidence, text
        )


def _touching(targets: Sequence[Target]) -> dict[int, list[int]]:
    """Who is at one place with whom."""
    beside: dict[int, list[int]] = {}
    for i, j, inside in overlaps([t.box for t in targets]):
        (_, _, w, h), (_, _, wide, high) = targets[i].box, targets[j].box
        if inside >= TOUCH * min(max(w * h, 1.0), max(wide * high, 1.0)):
            beside.setdefault(i, []).append(j)
            beside.setdefault(j, []).append(i)
    return {
        targets[k].id: [targets[j].id for j in sorted(beside[k])] for k in sorted(beside)
    }
