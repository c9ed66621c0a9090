"""What speaks, frame by frame, for a target being somebody else by now: others who go by, and a
size that changes.

Two who come to one place and part again may have exchanged their identities, and nothing else in
their paths tells. What counts is how far they move past one another, not for how long they are
near: company that walks side by side is not mistaken. A box that grows or shrinks as it goes
has come to lie on somebody else, or on more and more of a scene that rushes by. Where there is
foreground, neither counts while somebody is seen alone in a region.

Each adds to the odds that it is not the same any more, so that identity is 1 / (1 + sum) and falls
ever more slowly: tracks differ in how easily they are mistaken. Fitted to who was who in six
recordings with detectors' boxes, each left out in turn.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass

from recorders.messages import Notice, Target
from replay.hindsight.verdicts import SURE, keeps, lessened

NEAR = 1.5
"""Two centres within so many sizes of the larger one are near one another."""
PASSED = 0.056
"""Odds of being another, by way in sizes that another one went by, without colours."""
ASKED = 0.5
"""So much of that where crossings are asked about one by one (`replay.hindsight.crossings`)."""
GREW = 0.3
"""And by the logarithm of height that was gained and lost."""
GROWTH_S = 0.5
"""Heights are taken as their mean over about so long."""
APART_S = 0.5
"""Who was apart for less is still in the same passing."""


@dataclass(slots=True)
class Passed:
    """The passing that somebody is in: with whom, since and until when, the way that they went by
    one another (sizes), the odds that it adds.
    """

    others: list[int]
    since_ns: int
    last_ns: int
    way: float = 0.0
    odds: float = 0.0
    told: bool = False


class Passing:
    """Follows who goes by whom, and whose size changes, frame by frame.

    Args:
        seeing: there are pictures to know people by.
        masks: there is foreground: who is seen alone in a region of it is mistaken for nobody.
    """

    def __init__(self, *, seeing: bool, masks: bool) -> None:
        self._less = 1.0 / keeps(1.0, seeing=seeing)
        self._passed = PASSED * self._less * (1.0 if seeing or masks else ASKED)
        self._masks = masks
        self._now: dict[int, Passed] = {}
        self._places: dict[int, tuple[float, float]] = {}
        self._heights: dict[int, float] = {}

    def step(
        self, targets: Sequence[Target], time_ns: int, dt: float
    ) -> dict[int, tuple[float, Notice | None]]:
        """A frame: by how much the odds grow that somebody is another, and what is to be told of
        that once.

        Args:
            targets: who is present.
            time_ns: the frame's capture time.
            dt: seconds since the frame before.
        """
        self._now = {
            k: p for k, p in self._now.items() if time_ns - p.last_ns <= APART_S * 1e9
        }
        alone = {t.id for t in targets if self._masks and t.mode == "motion"}
        found: dict[int, tuple[float, Notice | None]] = {
            identity: (GREW * self._less * grown, None)
            for identity, grown in self._growth(targets, dt).items()
            if identity not in alone
        }
        for identity, ways in sorted(self._went_by(targets, alone).items()):
            passed = self._now.setdefault(identity, Passed([], time_ns, time_ns))
            passed.others += [k for k in ways if k not in passed.others]
            passed.last_ns = time_ns
            way = math.fsum(ways.values())
            odds = self._passed * way
            passed.way, passed.odds = passed.way + way, passed.odds + odds
            notice = None
            if lessened(1.0, passed.odds) < SURE and not passed.told:
                passed.told = True
                notice = _notice(identity, passed)
            found[identity] = found[identity][0] + odds, notice
        return found

    def _growth(self, targets: Sequence[Target], dt: float) -> Mapping[int, float]:
        """By how much the logarithm of everybody's height has changed."""
        before, self._heights = self._heights, {}
        grown: dict[int, float] = {}
        for t in targets:
            height = math.log(max(t.box[3], 1.0))
            old = before.get(t.id, height)
            self._heights[t.id] = old + (height - old) * min(1.0, dt / GROWTH_S)
            grown[t.id] = abs(self._heights[t.id] - old)
        return grown

    def _went_by(
        self, targets: Sequence[Target], alone: Set[int]
    ) -> dict[int, dict[int, float]]:
        """Of whom somebody is near, and who is not alone: how far each of those went by him, in
        sizes.
        """
        before, self._places = self._places, {}
        steps: list[tuple[float, float] | None] = []
        sizes: list[float] = []
        for t in targets:
            x, y, w, h = t.box
            self._places[t.id] = here = x + w / 2, y + h / 2
            old = before.get(t.id)
            steps.append(None if old is None else (here[0] - old[0], here[1] - old[1]))
            sizes.append(math.sqrt(max(w * h, 1.0)))
        ways: dict[int, dict[int, float]] = {}
        places = list(self._places.items())
        for i, (one, (x, y)) in enumerate(places):
            for j, (other, (u, v)) in enumerate(places[:i]):
                if one in alone and other in alone:
                    continue
                larger = max(sizes[i], sizes[j])
                if math.hypot(u - x, v - y) < NEAR * larger:
                    way = _apart(steps[i], steps[j]) / larger
                    for a, b in ((one, other), (other, one)):
                        if a not in alone:
                            ways.setdefault(a, {})[b] = way
        return ways


def _apart(a: tuple[float, float] | None, b: tuple[float, float] | None) -> float:
    """By how much two steps differ; nothing where one is not known."""
    return 0.0 if a is None or b is None else math.hypot(a[0] - b[0], a[1] - b[1])


def _notice(identity: int, passed: Passed) -> Notice:
    others = sorted(passed.others)
    same = lessened(1.0, passed.odds)
    evidence = {
        "together_s": (passed.last_ns - passed.since_ns) * 1e-9,
        "way_sizes": passed.way,
        "with": others,
        "same": same,
        "same_under": SURE,
        "alternative": "exchanged with one of them",
        "alternative_probability": 1.0 - same,
    }
    text = (
        f"Target {identity} and {' and '.join(map(str, others))} went by one another for"
        f" {passed.way:.1f} sizes: the same with {same:.2f}, else exchanged."
    )
    return Notice(
        "identity", [identity], "ours: how often a passing is survived", evidence, text
    )
