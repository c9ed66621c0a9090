"""How much the same person's features differ in this recording (PARTS 2.2).

The models of the matching case are fitted to other recordings. Strong compression, noise, small
pictures and other frame rates make the same person differ more than there: his features would
then speak against him. Who is alone in a blob of his size can be nobody else, so what he differs
by is measured, and differences are taken in units of what is usual here, never of less than in
the fit. (Ours.)
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from replay.trackers.parts.features import FEATURES, FURTHEST
from replay.trackers.parts.regions import PARTS

Ints = NDArray[np.int64]
SHAPE = (len(PARTS), len(FEATURES))
TRUSTED = 64
"""So many sightings the fit counts for."""


class Typical:
    """Mean differences of those who are alone, by part and feature.

    Args:
        usual: (5, 6) the fit's mean differences, in 1 / `ONE`.
    """

    def __init__(self, usual: Ints) -> None:
        self._usual = np.maximum(usual, 1)
        self._sums: Ints = np.zeros(SHAPE, np.int64)
        self._counts: Ints = np.zeros(SHAPE, np.int64)

    def take(self, differences: Ints, known: NDArray[np.bool_]) -> None:
        """Learn from differences (M, 5, 6) of those who are alone, where ``known``, the same
        shape.
        """
        self._sums += np.where(known, differences, 0).sum(axis=0)
        self._counts += known.sum(axis=0)

    def scaled(self, differences: Ints) -> Ints:
        """Differences (N, 5, 6) in units of what is usual, in [0, `FURTHEST`]."""
        expected = self._usual * (TRUSTED + self._counts)
        found = np.maximum(self._usual * TRUSTED + self._sums, expected)
        return np.asarray(np.minimum(differences * expected // found, FURTHEST))

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"sums": self._sums.copy(), "counts": self._counts.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._sums = np.array(state["sums"], np.int64).reshape(SHAPE)
        self._counts = np.array(state["counts"], np.int64).reshape(SHAPE)
