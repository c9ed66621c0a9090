"""What is believed of detections: how likely each is somebody real, whatever the detector's
scale.

Detectors differ in what their scores mean: one gives .99 where another gives .85. What they have
in common is that the log-odds of being right grow in proportion to the score's own log-odds,
measured by those that the detector's best detections reach in the same recording:

    logit p(s) = steepness * (r(s) - half),   r(s) = 1 + (l(s) - l(q)) / max(l(q), 1)

with l(s) = log(s / (1 - s)) and q the 90th percentile of the scores so far, each weighted by
itself, so that it is the same however much of its rubbish a detector gives out. `STEEPNESS` and
`HALF` are fitted to the truth of eight recordings with two detectors; left out in turn, each is
met by what the others say within .03 to .13 (`tests/benchmarks/bench_mot15.py`).

The sightings of one track are not independent of one another: a poster is found as poster in
every frame. So the belief in a track is the mean of its sightings' log-odds, not their sum.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from recorders.messages import Detections, Targets
from replay.trackers.association import iou

Floats = NDArray[np.float64]
STEEPNESS = 5.3
HALF = 0.455
LIKELY = 0.5
"""More likely than not."""
_BEST = 0.9
_SAME = 0.5
_FINE, _REACH = 16, 5
"""Bins to one unit of log-odds, and the log-odds at which scores are cut."""
_EDGE = 1.0 / (1.0 + np.exp(_REACH))


def logit(share: Floats) -> Floats:
    """Log-odds of probabilities (N,), cut at +-5 (.007 and .993).

    >>> logit(np.array([0.5, 1.0])).tolist()
    [0.0, 5.0]
    """
    inside = np.minimum(np.maximum(share, _EDGE), 1.0 - _EDGE)
    odds = np.log(inside / (1.0 - inside))
    return np.asarray(np.minimum(np.maximum(odds, -_REACH), _REACH))


def probability(log_odds: Floats) -> Floats:
    """The probabilities of log-odds, (N,) each.

    >>> probability(np.array([0.0])).tolist()
    [0.5]
    """
    return np.asarray(1.0 / (1.0 + np.exp(-log_odds)))


class DetectionScores:
    """What a recording's scores so far say of the next ones."""

    def __init__(self) -> None:
        self._weights: Floats = np.zeros(2 * _FINE * _REACH + 1)

    @property
    def best(self) -> float:
        """The log-odds that the detector's best detections reach."""
        total = self._weights.cumsum()
        return float(total.searchsorted(_BEST * total[-1])) / _FINE - _REACH

    def take(self, detections: Detections) -> Floats:
        """Learn from a frame's detections, and judge them.

        Returns:
            (N,) the probability that each is somebody. Detections without scores count as 1; the
            scores of fused ones are probabilities.
        """
        count = len(detections.boxes)
        given = detections.scores or [1.0] * count
        if not count:
            return np.zeros(0)
        scores = np.asarray(given, np.float64)
        if detections.fused:  # the fusion has judged them by the recording already
            return scores
        odds = logit(scores)
        bins = np.rint((odds + _REACH) * _FINE).astype(np.intp)
        self._weights += np.bincount(bins, np.maximum(scores, 1e-6), len(self._weights))
        best = self.best
        reached = 1.0 + (odds - best) / max(best, 1.0)
        return probability(STEEPNESS * (reached - HALF))

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"weights": self._weights.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._weights = np.array(state["weights"], np.float64)


def stamped(answer: Targets, boxes: Floats, likely: Floats) -> Targets:
    """Say of every observed target how likely the detection is that it was observed in.

    Args:
        answer: a tracker's.
        boxes: (N, 4) the frame's detections.
        likely: (N,) as `Scores.take` gives it.
    """
    rows = [k for k, t in enumerate(answer.targets) if t.observed]
    if not rows or not len(boxes):
        return answer
    told = list(answer.targets)
    overlap = iou(np.array([told[k].measured or told[k].box for k in rows]), boxes)
    best = overlap.argmax(axis=1).tolist()
    sure = likely.tolist()
    for k, column, most in zip(rows, best, overlap.max(axis=1).tolist(), strict=True):
        if most >= _SAME:
            told[k] = replace(told[k], likely=sure[column])
    return replace(answer, targets=told)
