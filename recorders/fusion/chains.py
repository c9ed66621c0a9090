"""Hypotheses followed from frame to frame: what is seen again at nearly the same place is one
chain.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np

from recorders.detectors.suppression import overlaps
from recorders.fusion.hypotheses import Hypothesis, corners_of
from recorders.messages import Box

LEAST_OVERLAP = 0.25
"""Least intersection over union of a chain's expected box with what goes on with it."""
LONGEST_GAP_S = 0.5
REMEMBERED_S = 3.0
"""Where a chain ended not longer ago, one that begins goes on with how far that one had come: who
came and stands still is not always seen.
"""
HALF = 0.5
"""A chain's speed is half its last step and half what it was before."""


@dataclass
class Chain:
    """Hypotheses that follow one another.

    Attributes:
        box: the last one's.
        dx, dy: its speed, px per frame.
        last: the frame of the last one.
        first, began: where and when it began, or the one that it goes on.
        reach: how far it was from there at most, by its own size.
        frames, signs, sizes: of each frame since the first, gaps included: its number, the sign
            and the size class that it showed (see `recorders.fusion.belief`).
        past: the last boxes of the masks and of the detector with their frames, for how steady
            they are.
    """

    box: Box
    last: int
    first: Box
    began: int
    reach: float = 0.0
    dx: float = 0.0
    dy: float = 0.0
    frames: list[int] = field(default_factory=list)
    signs: list[int] = field(default_factory=list)
    sizes: list[int] = field(default_factory=list)
    past: tuple[list[tuple[int, Box]], list[tuple[int, Box]]] = field(
        default_factory=lambda: ([], [])
    )

    def expected(self, frame: int) -> Box:
        """Its box in a later frame."""
        x, y, w, h = self.box
        steps = frame - self.last
        return x + self.dx * steps, y + self.dy * steps, w, h

    def go_on(self, frame: int, hypothesis: Hypothesis) -> None:
        """Take the next hypothesis."""
        x, y, w, h = hypothesis.box
        steps = max(1, frame - self.last)
        before = self.box
        dx = (x + w / 2 - before[0] - before[2] / 2) / steps
        dy = (y + h / 2 - before[1] - before[3] / 2) / steps
        self.dx, self.dy = HALF * (self.dx + dx), HALF * (self.dy + dy)
        self.box, self.last = hypothesis.box, frame
        self.reach = max(self.reach, _apart(self.first, self.box))

    def forget(self, before: int) -> None:
        """Drop what lies before a frame."""
        many = sum(frame < before for frame in self.frames)
        del self.frames[:many], self.signs[:many], self.sizes[:many]


def _apart(a: Box, b: Box) -> float:
    """How far the centres of two boxes are apart, by their mean side."""
    across = a[0] + a[2] / 2 - b[0] - b[2] / 2
    down = a[1] + a[3] / 2 - b[1] - b[3] / 2
    size = math.sqrt(math.sqrt(a[2] * a[3] * b[2] * b[3]))
    return math.hypot(across, down) / max(1.0, size)


class Chains:
    """The chains that are alive."""

    def __init__(self, fps: float) -> None:
        self._gap = max(1, round(LONGEST_GAP_S * fps))
        self._remembered = round(REMEMBERED_S * fps)
        self._over: list[Chain] = []
        self.alive: list[Chain] = []

    def link(self, frame: int, found: list[Hypothesis]) -> list[Chain]:
        """The chain of each hypothesis of the next frame, begun where there is none; the best
        overlap first, of equals the older chain, then the first hypothesis.
        """
        self._over += [c for c in self.alive if frame - c.last > self._gap]
        self._over = [c for c in self._over if frame - c.last <= self._remembered]
        self.alive = [c for c in self.alive if frame - c.last <= self._gap]
        expected = corners_of([c.expected(frame) for c in self.alive])
        overlap = overlaps(expected, corners_of([h.box for h in found]))
        rows, columns = np.nonzero(overlap >= LEAST_OVERLAP)
        order = np.argsort(-overlap[rows, columns], kind="stable")
        mine: dict[int, Chain] = {}
        used: list[int] = []
        for k in order.tolist():
            row, column = int(rows[k]), int(columns[k])
            if row in used or column in mine:
                continue
            used.append(row)
            mine[column] = self.alive[row]
        chains = []
        for column, hypothesis in enumerate(found):
            chain = mine.get(column)
            if chain is None:
                chain = self._begin(frame, hypothesis.box)
                self.alive.append(chain)
            else:
                chain.go_on(frame, hypothesis)
            chains.append(chain)
        return chains

    def _begin(self, frame: int, box: Box) -> Chain:
        """A new chain; where one ended not long ago it has come from where that one came from."""
        overlap = overlaps(corners_of([box]), corners_of([c.box for c in self._over]))[0]
        near = [c for c, o in zip(self._over, overlap, strict=True) if o >= LEAST_OVERLAP]
        before = max(near, key=lambda c: c.reach, default=None)
        if before is None:
            return Chain(box, frame, box, frame)
        return Chain(box, frame, before.first, before.began, before.reach)
