"""How abruptly the targets of a recording move, and how exact its detections are, learnt from
their own innovations.

People walk on, fish dash and turn: no one process noise suits both, and a filter that is too calm
loses whoever turns. Beside the tracker's own filter, each target's centre is therefore followed
by one filter for each of several accelerations, in body sizes, fed with the same detections. The
acceleration under which all targets' innovations so far are likeliest, where it was not ambiguous
whose a detection is, is the tracker's own from the next frame on, as hindsight chooses the
liveliness of its smoother. One choice for the whole recording: pooled, it is known soon, before
most targets have turned for the second time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from replay.trackers.kalman import KalmanBank

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]

AGILITIES = (1.0, 2.0, 4.0, 8.0, 16.0)
"""Times the acceleration that is assumed at first: none is calmer."""
SHARP = 0.5
"""Times the error of a detection that is assumed at first: what liveliness is judged by, and what
the lively get.

Judged by the whole error, turns pass for errors of detection. The calm keep the whole: followed
as closely as their detections are exact, people who pass one another change places.
"""
LIVELY = 8.0
"""Times the acceleration that is assumed at first, from which on targets are lively."""
ENOUGH = 40
"""Innovations from which on what they say is believed."""
_WORST = 16.0
"""Squared innovations count no more than this, in variances: a wrong association is no manoeuvre.
"""


class Liveliness:
    """A bank of filters of the centre: x and y of every acceleration after another, by the
    bodies' rows.

    Attributes:
        noise: standard deviation of a detected centre, sizes.
        agility: standard deviation of the acceleration, sizes per second squared.
    """

    def __init__(self, noise: float, agility: float, speed: float) -> None:
        self.noise, self.agility = noise, agility
        self._calm = noise, agility
        self._speed = speed
        self._tried = agility * np.repeat(AGILITIES, 2)
        self._bank = KalmanBank(2 * len(AGILITIES))
        self._likelihood = np.zeros(len(AGILITIES))
        self._count = 0

    def start(self, centre: tuple[float, float], size: float) -> None:
        """A new body, at a measured centre."""
        rate = np.array((size * self._speed) ** 2)
        self._bank.add(
            np.tile(centre, len(AGILITIES))[None], np.array(self._variance(size)), rate
        )

    def _variance(self, sizes: Any) -> Any:
        return (sizes * (SHARP * self._calm[0])) ** 2

    def keep(self, kept: Rows) -> None:
        """Keep the given rows, in that order."""
        self._bank.keep(kept)

    def predict(self, dt: float, sizes: Floats) -> None:
        """Advance all bodies by dt seconds."""
        self._bank.predict(dt, (sizes[:, None] * self._tried) ** 2)

    def see(
        self, rows: Rows, centres: Floats, sizes: Floats, telling: NDArray[np.bool_]
    ) -> None:
        """Take the detections of a frame.

        Args:
            rows: (N,) the bodies that they belong to.
            centres: (N, 2) pixels.
            sizes: (N,) pixels.
            telling: (N,) whether it is certain whose they are, and that one was seen a frame ago.
        """
        if not len(rows):
            return
        bank, measured = self._bank, np.tile(centres, (1, len(AGILITIES)))
        variance = self._variance(sizes)[:, None]
        if telling.any():
            spread = (bank.p00[rows] + variance)[telling]
            residual = (measured - bank.value[rows])[telling]
            worst = np.minimum(residual * residual / spread, _WORST)
            found = -0.5 * (worst + np.log(spread / (sizes[telling] ** 2)[:, None]))
            self._likelihood += found.sum(axis=0).reshape(-1, 2).sum(axis=1)
            self._count += int(np.count_nonzero(telling))
            self._choose()
        bank.update(rows, measured, variance)

    def _choose(self) -> None:
        if self._count < ENOUGH:
            return
        # Rounded, so that of accelerations that are all but equally likely the calmest is taken.
        best = AGILITIES[int(np.argmax(np.round(self._likelihood / self._count * 2.0**20)))]
        self.noise = self._calm[0] * (SHARP if best >= LIVELY else 1.0)
        self.agility = self._calm[1] * best

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {
            "bank": self._bank.state(),
            "likelihood": self._likelihood.copy(),
            "count": self._count,
            "now": [self.noise, self.agility],
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._bank.restore(state["bank"])
        self._likelihood = np.array(state["likelihood"], np.float64)
        self._count = int(state["count"])
        self.noise, self.agility = (float(v) for v in state["now"])
