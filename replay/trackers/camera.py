"""How the camera moved since the last frame, told by the detections alone.

A camera that turns or shakes moves everybody by nearly the same number of pixels, near or far;
people move each by his own. So every pair of a target and a detection of its size is a vote for
the displacement that would bring the one onto the other, and the camera's is the one that makes
all that is seen most likely: each target is where it is expected after it, give or take a step of
its own, or not to be told (a mixture), and a camera that was at rest so far will be now.

Three people who start off together in a calm scene are therefore no pan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import sizes_of
from replay.trackers.belief import LIKELY
from replay.trackers.life import Living

Floats = NDArray[np.float64]
REACH = 1.5
"""Furthest displacement that is voted for, in sizes of the target."""
ALIKE = 0.25
"""Largest difference (log) of the heights of a target and a detection that may be its."""
WIDTH = 0.1
"""Standard deviation of a vote, in sizes of the target: a detected centre, and a step of its own."""
ELSEWHERE = 0.05
"""Likelihood, beside that of the best place, of a target that is not to be told."""
CALM, _FRAMES = 0.025, 20.0
"""Standard deviation, in sizes, that a camera at rest seems to have, by steps that people take in
common; and for how many frames a recording's camera is held to be at rest.
"""


class CameraMotion:
    """The camera's motion from frame to frame, and how restless it is."""

    def __init__(self) -> None:
        self._squares: Floats = np.zeros(2)
        self._frames = 0.0

    def follow(
        self, items: Sequence[Living], boxes: Floats, found: Floats, likely: Floats
    ) -> Floats:
        """By how much all targets go with the camera, by those that were seen in the last frame.

        Args:
            items: the targets, by row; not yet observed in this frame.
            boxes: (N, 4) where they are expected by their own motion, in pixels.
            found: (M, 4) a frame's boxes.
            likely: (M,) the probability that each is somebody.

        Returns:
            (2,) pixels.
        """
        last = max((t.seen_ns for t in items), default=0)
        rows = [k for k, t in enumerate(items) if t.hits >= 2 and t.seen_ns == last]
        return self.shift(boxes[rows], found[likely >= LIKELY])

    def shift(self, expected: Floats, found: Floats) -> Floats:
        """By how much everybody is further than expected.

        Args:
            expected: (N, 4) boxes x, y, w, h of the targets by their own motion, in pixels.
            found: (M, 4) a frame's boxes.

        Returns:
            (2,) pixels.
        """
        if len(expected) < 2 or not len(found):
            return np.zeros(2)
        sizes = sizes_of(expected)
        calm = (CALM * median(sizes.tolist())) ** 2
        usual = (self._squares + _FRAMES * calm) / (self._frames + _FRAMES)
        told, weight = _likeliest(expected, sizes, found, usual)
        if weight > 0:
            self._squares += np.maximum(told * told - 1.0 / weight, 0.0)
            self._frames += 1.0
        moving = np.maximum(usual - calm, 0.0) * weight
        return np.asarray(told * moving / (1.0 + moving))

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"squares": self._squares.copy(), "frames": self._frames}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._squares = np.array(state["squares"], np.float64)
        self._frames = float(state["frames"])


def _likeliest(
    expected: Floats, sizes: Floats, found: Floats, usual: Floats
) -> tuple[Floats, float]:
    """The displacement (2,) that the votes tell, and one over its variance.

    ``sizes``: of the expected boxes (N,); ``usual``: variance of the camera's motion (2,).
    """
    middles = expected[:, :2] + expected[:, 2:] / 2
    away = (found[:, :2] + found[:, 2:] / 2)[None] - middles[:, None]
    near = np.add.reduce(away * away, axis=2) <= (REACH * sizes[:, None]) ** 2
    ratio = np.log(
        np.maximum(found[None, :, 3], 1.0) / np.maximum(expected[:, None, 3], 1.0)
    )
    near &= np.abs(ratio) <= ALIKE
    # Each pair of a target and a detection near it: a displacement to be tried, and to be seen
    # under every other one. Of a crowd's pairs these are few.
    target, _ = near.nonzero()
    votes = away[near]
    tried = np.concatenate([np.zeros((1, 2)), votes])
    width = WIDTH * sizes
    square = width * width
    apart = np.add.reduce((tried[:, None] - votes[None]) ** 2, axis=2)
    worth = np.exp(-0.5 * apart / square[target])
    most = np.zeros((len(tried), len(expected)))
    if len(votes):
        first = _firsts(target)
        most[:, target[first]] = np.maximum.reduceat(worth, first, axis=1)
    total = np.add.reduce(np.log(most + ELSEWHERE), axis=1)
    total = total - 0.5 * np.add.reduce(tried * tried / usual, axis=1)
    winner = int(total.argmax())
    best = most[winner]
    weight = np.where(best > 0, best / (best + ELSEWHERE) / square, 0.0)
    own = np.zeros((len(expected), 2))
    chosen = (worth[winner] == best[target]).nonzero()[0]
    chosen = chosen[_firsts(target[chosen])]  # the first of equals
    own[target[chosen]] = votes[chosen]
    sure = float(np.add.reduce(weight))
    told = np.add.reduce(weight[:, None] * own, axis=0) / max(sure, 1e-12)
    return told, sure


def _firsts(rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """Where each of ascending numbers stands first."""
    new = np.ones(len(rows), bool)
    new[1:] = rows[1:] != rows[:-1]
    return new.nonzero()[0]
