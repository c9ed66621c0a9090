"""How far each source is to be believed in this recording.

In every frame a chain of hypotheses shows a sign: whether the masks have it, and how sure the
detector is of it, if at all. Bodies and everything else (reflections, pieces, doubles) show signs
with different frequencies, which differ from recording to recording: a detector that misses
nothing makes what only the masks show doubtful, masks that miss who stands still make what only
the detector shows believable. The frequencies are learnt as the recording goes on, from how far
each hypothesis was believed (a mixture of two multinomials, by stepwise expectation
maximisation: O. Cappe, E. Moulines, "On-line expectation-maximization algorithm for latent data
models", 2009), and begin with what is usual.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from recorders.fusion.hypotheses import SCORE_STEPS, Hypothesis

Floats = NDArray[np.float64]

STEPS = len(SCORE_STEPS) + 2  # no box, and one step more than there are limits
GAP = 2 * STEPS
"""The sign of a frame in which neither source shows the chain."""
SIGNS = 2 * STEPS + 1
SMALL, USUAL, LARGE, UNKNOWN = range(4)

# No box, then the steps of the score: first where the masks have nothing, then where they do; last
# the gap.
BODY = (0.0, 0.03, 0.03, 0.05, 0.08, 0.08, 0.10, 0.04, 0.06, 0.10, 0.18, 0.20, 0.05)
OTHER = (0.0, 0.36, 0.12, 0.06, 0.02, 0.01, 0.25, 0.03, 0.02, 0.015, 0.01, 0.005, 0.10)
BODY_SIZES = (0.06, 0.86, 0.08)
OTHER_SIZES = (0.55, 0.30, 0.15)
USUAL_WEIGHT = 30.0
"""What is usual counts as much as so many glances at this recording."""
BODIES_FIRST = -1.5
"""Logit of a new chain being a body."""
GLANCE_S = 0.2
"""Frames nearer together than this are one glance: what is wrong in one is so in the next."""
SMALLEST, LARGEST = 0.6, 1.6
"""Heights between these, of the usual height at a place, are usual."""
BLIND = 0.05
"""A detector that is sure of fewer bodies than this in a frame knows nothing of what is here."""
SURE_STEP = 3
"""From this step on the detector is sure."""
MASKS_ALONE = 1.0
"""What a glance at a hypothesis of the masks is worth where the detector knows nothing."""


CHAIN = 2.0
"""However long a chain, its logit is no more than this for a single frame of it."""
SIZE = 3.0
"""A chain's size is one glance, however long the chain, and worth no more than this."""
OWN = 1.0
"""What a frame's own sign and size count beside the chain."""


class Belief:
    """The frequencies of signs, of bodies and of everything else, and what they make believe.

    Args:
        fps: frames per second.
        sure_rate: of how many bodies in a frame the detector is sure, on the average over this
            recording.
    """

    def __init__(self, fps: float, sure_rate: float) -> None:
        self._glance = min(1.0, 1.0 / (GLANCE_S * fps))
        self._body = USUAL_WEIGHT * np.array(BODY)
        self._other = USUAL_WEIGHT * np.array(OTHER)
        self._body_sizes = USUAL_WEIGHT * np.array(BODY_SIZES)
        self._other_sizes = USUAL_WEIGHT * np.array(OTHER_SIZES)
        self._knows = sure_rate / (sure_rate + BLIND)
        self._worth: tuple[Floats, Floats] | None = None

    @property
    def worth(self) -> tuple[Floats, Floats]:
        """Log likelihood ratios of a glance, body against everything else: (SIGNS,) of the signs
        and (4,) of the sizes.
        """
        if self._worth is None:
            signs = _ratio(self._body, self._other)
            alone = signs[STEPS]
            signs[STEPS] = self._knows * alone + (1 - self._knows) * MASKS_ALONE
            sizes = np.append(_ratio(self._body_sizes, self._other_sizes), 0.0)
            sizes = np.clip(sizes, -SIZE, SIZE)
            self._worth = signs, sizes
        return self._worth

    def of(
        self, signs: NDArray[np.intp], sizes: NDArray[np.intp], weights: Floats
    ) -> float:
        """The logit of the probability that a chain is a body.

        Args:
            signs: (N,) of its frames.
            sizes: (N,) likewise.
            weights: (N,) how much each frame counts.
        """
        of_signs, of_sizes = self.worth
        shown = self._glance * float((of_signs[signs] * weights).sum())
        size = float((of_sizes[sizes] * weights).sum() / weights.sum())
        return BODIES_FIRST + shown + size

    def now(self, logit: float, sign: int, size: int) -> float:
        """The probability that what a chain shows in one frame is a body: the chain's own, of
        which the frame may be a bad one.
        """
        of_signs, of_sizes = self.worth
        own = OWN * float(of_signs[sign] + of_sizes[size])
        return sigmoid(min(CHAIN, max(-CHAIN, logit)) + own)

    def learn(self, sign: int, size: int, probability: float) -> None:
        """Take in what a frame of a chain showed that is a body with a probability."""
        mine = self._glance * probability
        theirs = self._glance - mine
        self._body[sign] += mine
        self._other[sign] += theirs
        if size != UNKNOWN:
            self._body_sizes[size] += mine
            self._other_sizes[size] += theirs
        self._worth = None


def sigmoid(logit: float) -> float:
    """1 / (1 + exp(-logit))."""
    return 1 / (1 + math.exp(-min(40.0, max(-40.0, logit))))


def sign_of(hypothesis: Hypothesis) -> int:
    """What a hypothesis shows."""
    return hypothesis.step + (STEPS if hypothesis.masked is not None else 0)


def _ratio(a: Floats, b: Floats) -> Floats:
    p, q = a + 0.1, b + 0.1
    return np.asarray(np.log(p / p.sum()) - np.log(q / q.sum()))


class Heights:
    """The usual height of bodies by the place of their feet: a line through what both sources
    agree on, whose slope is held flat while little is known.
    """

    FLAT = 0.02
    """Worth of a flat line, in bodies times the picture's height squared."""
    FEWEST = 5.0

    def __init__(self, height: int) -> None:
        self._height = float(height)
        self._n = self._y = self._h = self._yy = self._yh = 0.0

    def learn(self, foot: float, height: float, weight: float) -> None:
        """Take in a body."""
        y, h = foot / self._height, height
        self._n += weight
        self._y += weight * y
        self._h += weight * h
        self._yy += weight * y * y
        self._yh += weight * y * h

    def size_of(self, foot: float, height: float) -> int:
        """`SMALL`, `USUAL` or `LARGE` for a body with its feet there; `UNKNOWN` while nothing is
        known.
        """
        if self._n < self.FEWEST:
            return UNKNOWN
        y, h = self._y / self._n, self._h / self._n
        spread = self._yy / self._n - y * y + self.FLAT
        slope = max(0.0, (self._yh / self._n - y * h) / spread)
        usual = max(0.3 * h, h + slope * (foot / self._height - y))
        share = height / usual
        return SMALL if share < SMALLEST else LARGE if share > LARGEST else USUAL
