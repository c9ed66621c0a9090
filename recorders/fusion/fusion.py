"""The fusion of detector and masks: hypotheses, followed, believed, and decided on a little
later.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.detectors.suppression import overlaps
from recorders.fusion.belief import (
    GAP,
    SURE_STEP,
    Belief,
    sign_of,
    way_of,
)
from recorders.fusion.chains import Chain, Chains
from recorders.fusion.heights import UNKNOWN, Heights
from recorders.fusion.hypotheses import (
    Hypothesis,
    areas_of,
    corners_of,
    covered_ones,
    hypotheses,
    shared_areas,
)
from recorders.fusion.parameters import FusionParameters
from recorders.fusion.steadiness import Steadiness
from recorders.messages import Box, Detections

Floats = NDArray[np.float64]

AGREED = 0.9
"""Bodies believed this much, in which both sources agree, teach sizes."""
PIECE = 0.8
"""A box of the masks that shares this much of the smaller of the two with a detected body says
nothing new.
"""
DOUBLE = 0.6
"""Of decided boxes that overlap by this, the one believed more stays."""


@dataclass(frozen=True)
class Decided:
    """One detection of the fused set.

    Attributes:
        box: where.
        belief: the probability that it is a body.
        hypothesis: what it came from.
    """

    box: Box
    belief: float
    hypothesis: Hypothesis


@dataclass(frozen=True)
class _Waiting:
    frame: int
    found: list[Hypothesis]
    chains: list[Chain]
    spanned: list[Chain]


class Fusion:
    """One set of detections out of two, frame after frame, each decided on `ahead_s` later.

    Args:
        parameters: see there.
        height: of the pictures, px.
        fps: frames per second.
        sure_rate: of how many bodies in a frame the detector is sure (`sure_of`), on the average
            over this recording.
        masks_hold: the masks miss nobody, see `recorders.fusion.holding`.

    Attributes:
        ahead: a frame is decided on so many frames later.
    """

    def __init__(
        self,
        parameters: FusionParameters,
        height: int,
        fps: float,
        sure_rate: float,
        masks_hold: bool = False,
    ) -> None:
        self._p = parameters
        self._masks_hold = masks_hold
        self.ahead = round(parameters.ahead_s * fps)
        self._fps = fps
        self._memory = parameters.memory_s * fps
        self._chains = Chains(fps)
        self._belief = Belief(fps, sure_rate)
        self._heights = Heights(height)
        self._steady = Steadiness()
        self._waiting: deque[_Waiting] = deque()

    def add(
        self, frame: int, masked: Detections, detected: Detections
    ) -> list[list[Decided]]:
        """Take the next frame; the frames that are decided now, in order."""
        found = hypotheses(masked, detected)
        before = list(self._chains.alive)
        chains = self._chains.link(frame, found)
        for hypothesis, chain in zip(found, chains, strict=True):
            _, y, _, h = hypothesis.box
            for gap in range(chain.frames[-1] + 1 if chain.frames else frame, frame):
                _show(chain, gap, GAP, UNKNOWN)
            _show(chain, frame, sign_of(hypothesis), self._heights.size_of(y + h, h))
            self._steady.take(chain, frame, hypothesis)
        missed = [c for c in before if c.last < frame]
        self._waiting.append(_Waiting(frame, found, chains, missed))
        return self._ready(self.ahead)

    def finish(self) -> list[list[Decided]]:
        """The frames that were still waiting, in order."""
        return self._ready(0)

    def _ready(self, keep: int) -> list[list[Decided]]:
        decided = []
        while len(self._waiting) > keep:
            decided.append(self._decide(self._waiting.popleft()))
        return decided

    def _decide(self, at: _Waiting) -> list[Decided]:
        made: list[Decided] = []
        covered = covered_ones(at.found)
        for k, (hypothesis, chain) in enumerate(zip(at.found, at.chains, strict=True)):
            odds, way = self._believed(chain, at.frame)
            place = chain.frames.index(at.frame)
            sign, size = chain.signs[place], chain.sizes[place]
            belief = self._belief.now(odds, sign, size, k in covered)
            self._belief.learn(sign, size, way, odds)
            both = hypothesis.masked is not None and hypothesis.step >= SURE_STEP
            if both and belief >= AGREED:
                _, y, _, h = hypothesis.box
                self._heights.learn(y + h, h, belief)
            if belief >= self._p.min_belief:
                box = self._steady.box(hypothesis)
                made.append(Decided(box, belief, hypothesis))
        for chain in at.spanned:
            if at.frame in chain.frames:
                odds, way = self._believed(chain, at.frame)
                self._belief.learn(GAP, UNKNOWN, way, odds)
        return _without_doubles(made, self._masks_hold)

    def _believed(self, chain: Chain, frame: int) -> tuple[Floats, int]:
        """How far a chain is believed, and how far it went."""
        chain.forget(frame - round(3 * self._memory))
        distance = np.abs(np.array(chain.frames, np.float64) - frame)
        weights = np.exp(-distance / self._memory)
        signs, sizes = np.array(chain.signs, np.intp), np.array(chain.sizes, np.intp)
        way = way_of(chain.reach, (chain.last - chain.began) / self._fps)
        return self._belief.of(signs, sizes, way, weights), way


def sure_of(detected: Detections) -> int:
    """Of how many bodies in a frame a detector is sure."""
    nothing = Detections(detected.frame, detected.width, detected.height)
    return sum(hypothese.step >= SURE_STEP for hypothese in hypotheses(nothing, detected))


def _show(chain: Chain, frame: int, sign: int, size: int) -> None:
    chain.frames.append(frame)
    chain.signs.append(sign)
    chain.sizes.append(size)


def _without_doubles(made: list[Decided], masks_hold: bool) -> list[Decided]:
    """Without boxes of the detector alone that lie over others believed more, and boxes of the
    masks alone that say nothing new, unless masks hold. What the masks tell apart stays apart.
    """
    corners = corners_of([d.box for d in made])
    over = overlaps(corners, corners) >= DOUBLE
    detected = [index for index, d in enumerate(made) if d.hypothesis.detected is not None]
    kept = []
    for k, one in enumerate(made):
        rivals = [j for j in np.flatnonzero(over[k]).tolist() if j != k]
        if one.hypothesis.masked is None:
            double = any(
                (made[rival].belief, -rival) > (one.belief, -k) for rival in rivals
            )
        else:
            double = (
                not masks_hold
                and k not in detected
                and _explained(corners[k], corners[detected])
            )
        if not double:
            kept.append(one)
    return kept


def _explained(box: Floats, others: Floats) -> bool:
    """Whether a box of the masks alone is a piece of a detected body, or several run together."""
    if not len(others):
        return False
    shared = shared_areas(box[None], others)[0]
    smaller = np.minimum(areas_of(box[None]), areas_of(others))
    return bool((shared >= PIECE * smaller).any())
