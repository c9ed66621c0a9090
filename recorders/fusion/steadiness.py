"""Where a body is: between the boxes of the two sources, nearer to the one that is steadier.

Bodies move smoothly; a box that jumps from frame to frame was measured badly. A side's second
difference in time, relative to the box's size, is its error alone, and how large it is on the
average over the recording says how much the source's boxes count. Sources also differ in what they
take for the body's outline (feet, shadow, a bicycle): that difference is learnt where both have a
box, and a box of one source alone is moved to where both together would have put it. Where a side
differs by much, masks have a part of the body, or its shadow: there the outline is the detector's.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recorders.fusion.chains import Chain
from recorders.fusion.hypotheses import Hypothesis
from recorders.messages import Box

Floats = NDArray[np.float64]
USUAL = 0.03
"""Usual second difference, of the box's size."""
USUAL_WEIGHT = 20.0
MASKS, DETECTOR = 0, 1
ALIKE, APART = 0.15, 0.25
"""From these differences on, of the box's size, the outline begins to be, and is, the detector's."""


class Steadiness:
    """The errors of the masks' and the detector's boxes in this recording, across and down, and
    how they differ.
    """

    def __init__(self) -> None:
        self._jumps = np.full((2, 2), USUAL_WEIGHT * USUAL)
        self._counts = np.full(2, USUAL_WEIGHT)
        self._offset = np.zeros(4)
        self._pairs = USUAL_WEIGHT

    def take(self, chain: Chain, frame: int, hypothesis: Hypothesis) -> None:
        """Take in the next boxes of a chain."""
        boxes = hypothesis.masked, hypothesis.detected
        for source, box in enumerate(boxes):
            past = chain.past[source]
            if box is None:
                past.clear()
                continue
            past.append((frame, box))
            del past[:-3]
            if None not in boxes and [f for f, _ in past] == [frame - 2, frame - 1, frame]:
                self._count(source, [b for _, b in past])
        if hypothesis.masked is not None and hypothesis.detected is not None:
            masked, detected = _sides(hypothesis.masked), _sides(hypothesis.detected)
            self._offset += (detected - masked) / _size(hypothesis.masked)
            self._pairs += 1

    def _count(self, source: int, boxes: list[Box]) -> None:
        before, now, after = map(_sides, boxes)
        jump = (before - 2 * now + after) / _size(boxes[1])
        squares = (jump * jump).reshape(2, 2).mean(axis=0)
        self._jumps[source] += np.sqrt(squares)
        self._counts[source] += 1

    def shares(self) -> Floats:
        """What the masks' box counts, of 1, for each side (4,)."""
        errors = (self._jumps / self._counts[:, None]) ** 2
        share = errors[DETECTOR] / errors.sum(axis=0)
        return np.concatenate([share, share])

    def box(self, hypothesis: Hypothesis) -> Box:
        """The box of a hypothesis."""
        share = self.shares()
        offset = self._offset / self._pairs
        apart = np.clip((np.abs(offset) - ALIKE) / (APART - ALIKE), 0.0, 1.0) * offset
        if hypothesis.detected is None:
            box = hypothesis.box
            sides = _sides(box) + (apart + (1 - share) * (offset - apart)) * _size(box)
        elif hypothesis.masked is None:
            box = hypothesis.box
            sides = _sides(box) - share * (offset - apart) * _size(box)
        else:
            masked = hypothesis.masked
            sides = share * (_sides(masked) + apart * _size(masked))
            sides += (1 - share) * _sides(hypothesis.detected)
        left, top, right, bottom = sides.tolist()
        return left, top, right - left, bottom - top


def _sides(box: Box) -> Floats:
    x, y, w, h = box
    return np.array([x, y, x + w, y + h])


def _size(box: Box) -> Floats:
    return np.array([box[2], box[3]] * 2)
