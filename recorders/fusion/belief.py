"""How far each source is to be believed in this recording.

In every frame a chain of hypotheses shows a sign: whether the masks have it, and how sure the
detector is of it, if at all. A chain is a body, or something that the masks alone take for one
(reflections, flicker, pieces), or something that the detector alone does (posters, doubles). What
the two take for bodies by mistake is the same everywhere: the other source sees it by chance. How
often either sees bodies differs from recording to recording, and from body to body, and is learnt
as the recording goes on from how far each chain was believed (stepwise expectation maximisation:
O. Cappe, E. Moulines, "On-line expectation-maximization algorithm for latent data models", 2009),
beginning with what is usual. As bodies differ, a chain's glances are no independent proofs: so many
hits of so many glances are as likely as a beta-binomial distribution says.

Sizes, scores and how far chains go are learnt likewise, for all three.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.fusion.heights import UNKNOWN
from recorders.fusion.hypotheses import SCORE_STEPS, Hypothesis

Floats = NDArray[np.float64]

STEPS = len(SCORE_STEPS) + 2  # no box, and one step more than there are limits
GAP = 2 * STEPS
"""The sign of a frame in which neither source shows the chain."""
SIGNS = 2 * STEPS + 1
MASKED = np.array([False] * STEPS + [True] * STEPS + [False])
STEP = np.array([*range(STEPS), *range(STEPS), 0])
"""What each sign says: the masks have it; the detector's step."""

# What is usual: of bodies, of what only the masks take for one, of what only the detector does.
SHOWN = np.array([(0.7, 0.6), (0.8, 0.04), (0.04, 0.8)])
"""In what share of its glances the masks have it, and the detector."""
ALIKE = np.array([[2.0], [5.0], [5.0]])
"""How alike they are in that: the beta distributions' a + b."""
SCORES = np.array(
    [
        (0.08, 0.12, 0.20, 0.30, 0.30),
        (0.36, 0.30, 0.18, 0.10, 0.06),
        (0.40, 0.33, 0.15, 0.08, 0.04),
    ]
)
"""Its scores' steps, where the detector has it."""
SIZES = np.array([(0.06, 0.86, 0.08), (0.55, 0.30, 0.15), (0.40, 0.40, 0.20)])
WAYS = np.array(
    [(0.10, 0.12, 0.18, 0.60), (0.45, 0.20, 0.15, 0.20), (0.60, 0.15, 0.10, 0.15)]
)
"""How far it went at most, by its own size: within the limits `WAY_STEPS`."""
WAY_STEPS = (0.25, 0.5, 1.0)
UNTOLD = len(WAY_STEPS) + 1
"""A chain that is too short to say how far it goes."""
SHOWN_WEIGHT, USUAL_WEIGHT = 10.0, 30.0
"""What is usual counts as much as so many glances at this recording: little for how often bodies
are seen, which differs most.
"""
LEARNS = np.array([1.0, 0.0, 0.3])
"""How fast scores are learnt: those of bodies; hardly those of what the detector takes for one, or
a recording's standing people would count among them.
"""
CHAIN_WEIGHT = 0.25
"""Each of a chain's frames tells again how far it goes: it counts less."""

BODIES_FIRST = -0.8
"""Log odds of a new chain being a body, and not what one of the sources takes for one."""
MASKS_ALONE = 2.0
"""The same where only the masks can have taken it for one, and the detector knows nothing."""
GLANCE_S = 0.2
"""Frames nearer together than this are one glance: what is wrong in one is so in the next."""
TOLD_S = 1.0
"""Of whom was seen for less it is not known how far he goes, unless he has gone far."""
BLIND = 0.05
"""A detector that is sure of fewer bodies than this in a frame knows nothing of what is here."""
SURE_STEP = 3
"""From this step on the detector is sure."""
SCORE, MOST_SCORES = 0.5, 4.0
"""A detector's scores of a body are alike: what each is worth, and what all of them are at most."""
MOST = 3.0
"""A chain's size, and how far it went, are worth no more than this."""
CHAIN = 2.0
"""However long a chain, its log odds are no more than this for a single frame of it."""
MISSED = 0.75
"""Not to be seen by a source in one frame takes no more than this from them."""
COVERED = 1.5
"""The detector's box within a body that both sources have is the less likely another."""


class Belief:
    """The frequencies of signs, sizes and ways, of bodies and of what either source takes for one,
    and what they make believe.

    Args:
        fps: frames per second.
        sure_rate: of how many bodies in a frame the detector is sure, on the average over this
            recording.
    """

    def __init__(self, fps: float, sure_rate: float) -> None:
        self._glance = min(1.0, 1.0 / (GLANCE_S * fps))
        knows = sure_rate / (sure_rate + BLIND)
        self._shown = SHOWN_WEIGHT * SHOWN[0] * np.array([1.0, knows])
        self._seen = SHOWN_WEIGHT
        self._first = np.array(
            [knows * BODIES_FIRST + (1.0 - knows) * MASKS_ALONE, BODIES_FIRST]
        )
        self._steps = USUAL_WEIGHT * SCORES
        self._sizes = USUAL_WEIGHT * SIZES
        self._ways = USUAL_WEIGHT * WAYS
        self._worth: _Worth | None = None

    @property
    def worth(self) -> _Worth:
        """What each thing is worth now."""
        if self._worth is None:
            shown = np.vstack([self._shown / self._seen, SHOWN[1:]])
            unknown = np.zeros((2, 1))
            self._worth = _Worth(
                np.clip(shown, 0.01, 0.99),
                np.hstack([unknown, _ratios(self._steps)]),
                np.hstack([np.clip(_ratios(self._sizes), -MOST, MOST), unknown]),
                np.hstack([np.clip(_ratios(self._ways), -MOST, MOST), unknown]),
            )
        return self._worth

    def of(
        self,
        signs: NDArray[np.intp],
        sizes: NDArray[np.intp],
        way: int,
        weights: Floats,
    ) -> Floats:
        """(2,) log odds that a chain is a body and not what the masks, or the detector, takes for
        one.

        Args:
            signs: (N,) of its frames.
            sizes: (N,) likewise.
            way: how far it went.
            weights: (N,) how much each frame counts.
        """
        worth = self.worth
        glances = self._glance * weights
        masked, step = MASKED[signs], STEP[signs]
        hits = np.array([glances[masked].sum(), glances[step > 0].sum()])
        shown = _shares(hits, float(glances.sum()), worth.shown)
        scores = SCORE * (worth.steps[:, step] * glances).sum(axis=1)
        size = (worth.sizes[:, sizes] * weights).sum(axis=1) / weights.sum()
        return np.asarray(
            self._first
            + shown
            + np.clip(scores, -MOST_SCORES, MOST_SCORES)
            + size
            + worth.ways[:, way]
        )

    def now(self, odds: Floats, sign: int, size: int, covered: bool) -> float:
        """The probability that what a chain shows in one frame is a body: the chain's own, of
        which the frame may be a bad one; ``covered``: it lies within what both sources show.
        """
        worth = self.worth
        there = np.array([MASKED[sign], STEP[sign] > 0])
        logs = np.log(np.where(there, worth.shown, 1.0 - worth.shown)).sum(axis=1)
        own = np.maximum(logs[0] - logs[1:], -MISSED)
        own += worth.steps[:, STEP[sign]] + worth.sizes[:, size] - COVERED * covered
        return probability(np.clip(odds, -CHAIN, CHAIN) + own)

    def learn(self, sign: int, size: int, way: int, odds: Floats) -> None:
        """Take in what a frame of a chain showed of which so much is believed."""
        against = np.exp(-np.clip(odds, -40.0, 40.0))
        shares = self._glance * np.append(1.0, against) / (1.0 + against.sum())
        step = int(STEP[sign])
        self._shown += shares[0] * np.array([MASKED[sign], step > 0])
        self._seen += float(shares[0])
        if step:
            self._steps[:, step - 1] += LEARNS * shares
        if size != UNKNOWN:
            self._sizes[:, size] += shares
        if way != UNTOLD:
            self._ways[:, way] += CHAIN_WEIGHT * shares
        self._worth = None


@dataclass(frozen=True)
class _Worth:
    """What is believed of bodies, of what only the masks, and of what only the detector takes for
    one.

    Attributes:
        shown: (3, 2) in what share of the glances masks and detector have it.
        steps, sizes, ways: (2, N) log likelihood ratios of bodies against the two others.
    """

    shown: Floats
    steps: Floats
    sizes: Floats
    ways: Floats


def probability(odds: Floats) -> float:
    """Of a body, by its log odds (2,) against two others."""
    return float(1.0 / (1.0 + np.exp(-np.clip(odds, -40.0, 40.0)).sum()))


def sign_of(hypothesis: Hypothesis) -> int:
    """What a hypothesis shows."""
    return hypothesis.step + (STEPS if hypothesis.masked is not None else 0)


def way_of(reach: float, seconds: float) -> int:
    """How far a chain went at most in its life, by its own size: one of the classes of
    `WAYS`, or `UNTOLD`.
    """
    far = sum(reach >= least for least in WAY_STEPS)
    return far if seconds >= TOLD_S or far == len(WAY_STEPS) else UNTOLD


def _shares(hits: Floats, glances: float, usual: Floats) -> Floats:
    """(2,) log likelihood ratios of so many hits (2,) in so many glances: bodies differ in how
    often they are shown (beta-binomial).
    """
    a, b = ALIKE * usual, ALIKE * (1.0 - usual)
    missed = glances - hits
    logs = [
        sum(
            _beta(a[row, k] + hits[k], b[row, k] + missed[k]) - _beta(a[row, k], b[row, k])
            for k in range(2)
        )
        for row in range(3)
    ]
    return np.array([logs[0] - logs[1], logs[0] - logs[2]])


def _beta(a: float, b: float) -> float:
    return math.lgamma(a) + math.lgamma(b) - math.lgamma(a + b)


def _ratios(counts: Floats) -> Floats:
    share = (counts + 0.1) / (counts + 0.1).sum(axis=1, keepdims=True)
    return np.asarray(np.log(share[0]) - np.log(share[1:]))
