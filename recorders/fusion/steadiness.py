"""Where a body is when both sources have a box of it: nearer to the one that is steadier.

Bodies move smoothly; a box that jumps from frame to frame was measured badly. A box's second
difference in time, relative to its size, is its error alone.
"""

from __future__ import annotations

from recorders.fusion.chains import Chain
from recorders.fusion.hypotheses import Hypothesis
from recorders.messages import Box

USUAL = 0.003
"""Square of the usual second difference, of the box's size."""
USUAL_WEIGHT = 20.0
MOST = 0.04
"""A larger one is a jump to something else, and counts as this."""


class Steadiness:
    """The errors of the masks' and the detector's boxes in this recording."""

    def __init__(self) -> None:
        self._sums = [USUAL * USUAL_WEIGHT] * 2
        self._counts = [USUAL_WEIGHT] * 2

    def take(self, chain: Chain, frame: int, hypothesis: Hypothesis) -> None:
        """Take in the next boxes of a chain."""
        past = chain.past
        for source, box in enumerate((hypothesis.masked, hypothesis.detected)):
            if box is None:
                past[source].clear()
                continue
            past[source].append((frame, box))
            del past[source][:-3]
            if hypothesis.masked is None or hypothesis.detected is None:
                continue
            if [f for f, _ in past[source]] == [frame - 2, frame - 1, frame]:
                self._count(source, [b for _, b in past[source]])

    def _count(self, source: int, boxes: list[Box]) -> None:
        sides = [(x, y, x + w, y + h) for x, y, w, h in boxes]
        size = boxes[1][2] + boxes[1][3]
        total = 0.0
        for a, b, c in zip(*sides, strict=True):
            total += ((a - 2 * b + c) / size) ** 2
        self._sums[source] += min(MOST, total)
        self._counts[source] += 1

    def box(self, hypothesis: Hypothesis) -> Box:
        """The box of a hypothesis."""
        if hypothesis.masked is None or hypothesis.detected is None:
            return hypothesis.box
        masks, detector = (s / n for s, n in zip(self._sums, self._counts, strict=True))
        share = detector / (masks + detector)
        x, y, w, h = (
            share * m + (1 - share) * d
            for m, d in zip(hypothesis.masked, hypothesis.detected, strict=True)
        )
        return x, y, w, h
