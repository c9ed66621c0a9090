"""What a target is: the class that its sightings voted for.

A detector says of each box what it shows (person, car), and is wrong now and then. In every frame
in which a target is observed, the detection that lies over it best gives its class one vote, as
heavy as its score; the target is what has most of them so far.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_CLASS, Detections, Target

Floats = NDArray[np.float64]
MIN_OVERLAP = 0.4
"""Least intersection over union of a target's box and the detection that votes for its class."""


class ClassBook:
    """The votes of every target that was ever seen with a class."""

    def __init__(self) -> None:
        self._votes: dict[int, dict[str, float]] = {}

    def step(self, targets: Sequence[Target], detections: Detections) -> None:
        """Take the next frame's targets, by id, and what was detected in it."""
        told = [
            index for index, name in enumerate(detections.labels) if name not in NO_CLASS
        ]
        seen = [target for target in targets if target.observed and target.present]
        if not told or not seen:
            return
        overlap = _overlaps(
            np.array([t.box for t in seen], np.float64),
            np.array([detections.boxes[k] for k in told], np.float64),
        )
        # One vote a detection: it goes to the target that it lies over best, the first of equals.
        mine, theirs = overlap.argmax(axis=1), overlap.argmax(axis=0)
        for row, target in enumerate(seen):
            column = int(mine[row])
            if theirs[column] != row or overlap[row, column] < MIN_OVERLAP:
                continue
            name = detections.labels[told[column]]
            score = detections.scores[told[column]] if detections.scores else 1.0
            votes = self._votes.setdefault(target.id, {})
            votes[name] = votes.get(name, 0.0) + max(0.0, score)

    def of(self, target: int) -> str | None:
        """The class with most votes so far, of equals the first voted for; None without a vote."""
        votes = self._votes.get(target)
        return None if not votes else max(votes, key=votes.__getitem__)

    def state(self) -> list[Any]:
        """All votes as plain data, in the order in which they came first."""
        return [
            [target, [[name, weight] for name, weight in votes.items()]]
            for target, votes in self._votes.items()
        ]

    def restore(self, state: Sequence[Any]) -> None:
        """Continue from what `state` gave."""
        self._votes = {target: _weights(votes) for target, votes in state}


def _weights(votes: Sequence[Any]) -> dict[str, float]:
    return {str(name): float(weight) for name, weight in votes}


def _overlaps(a: Floats, b: Floats) -> Floats:
    """Intersection over union of boxes (N, 4) and (M, 4), (N, M)."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, :2] + a[:, None, 2:], b[None, :, :2] + b[None, :, 2:])
    size = np.maximum(high - low, 0.0)
    inside = size[..., 0] * size[..., 1]
    areas = (a[:, 2] * a[:, 3])[:, None] + (b[:, 2] * b[:, 3])[None, :]
    return np.asarray(inside / np.maximum(areas - inside, 1e-12))
