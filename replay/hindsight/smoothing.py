"""Rauch-Tung-Striebel smoothing of many paths at once, in closed form.

Every component (centre x, centre y, width, height) is its own constant-velocity filter, as in
`replay.trackers.kalman`; filterpy's `rts_smoother` is the reference that the tests hold this
against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.trackers.kalman import KalmanBank

Floats = NDArray[np.float64]
LONGEST_STEP_S = 600.0
"""A longer time between two frames counts as this."""


def smooth(
    measured: Floats,
    seen: NDArray[np.bool_],
    steps_s: Floats,
    variance: Floats,
    acceleration: Floats,
    rate: Floats,
) -> tuple[Floats, Floats]:
    """Smooth N paths of D components over T frames.

    Args:
        measured: (T, N, D) measurements, anything where not seen; in a row's first seen frame,
            its start.
        seen: (T, N) where there is a measurement. A row is started at its first; before it, it is
            not defined.
        steps_s: (T,) seconds since the frame before (the first is not used).
        variance: (N, D) measurement variances.
        acceleration: (N, D) variances of the white acceleration noise.
        rate: (N, D) variances of the rates at the start.

    Returns:
        Smoothed values and rates, (T, N, D) each; rows before their first measurement hold that
        measurement.
    """
    return filtered(measured, seen, steps_s, variance, acceleration, rate).smoothed()[:2]


def likelihood(
    measured: Floats,
    seen: NDArray[np.bool_],
    steps_s: Floats,
    variance: Floats,
    acceleration: Floats,
    rate: Floats,
) -> Floats:
    """Log likelihood of each path and component under the filter, (N, D), constants left out; as
    for `smooth`.
    """
    return filtered(measured, seen, steps_s, variance, acceleration, rate).likelihood(
        measured, seen, variance
    )


@dataclass(frozen=True)
class Filtered:
    """What a filter made of N paths of D components over T frames.

    Attributes:
        after, before: (5, T, N, D) value, rate, p00, p01, p11 after and before each frame's
            measurements.
        first: (N,) each path's first frame.
        steps_s: (T,) seconds since the frame before.
    """

    after: Floats
    before: Floats
    first: NDArray[np.intp]
    steps_s: Floats

    def likelihood(
        self, measured: Floats, seen: NDArray[np.bool_], variance: Floats
    ) -> Floats:
        """Log likelihood of each path and component, (N, D), constants left out."""
        later = seen & (np.arange(len(measured))[:, None] > self.first)
        spread = self.before[2] + variance
        residual = measured - self.before[0]
        return np.asarray(
            np.where(
                later[:, :, None], -0.5 * (residual * residual / spread + np.log(spread)), 0
            ).sum(axis=0)
        )

    def components(self, chosen: NDArray[np.intp]) -> Filtered:
        """Only some of the components: (N, d), which of its D components each path keeps."""
        at = chosen[None, None]
        after, before = (
            np.take_along_axis(table, at, axis=3) for table in (self.after, self.before)
        )
        return Filtered(after, before, self.first, self.steps_s)

    def smoothed(self) -> tuple[Floats, Floats, Floats]:
        """Smoothed values and rates, and the variances of the values, (T, N, D) each.

        x_t + C (x_t+1|T - x_t+1|t), C = P_t F' P_t+1|t^-1 and
        P_t|T = P_t + C (P_t+1|T - P_t+1|t) C', the two-by-two products written out.
        """
        value, rate, s00, s01, s11 = (table.copy() for table in self.after)
        if len(value) < 2:
            return value, rate, s00
        dt = self.steps_s[1:, None, None]
        p00, p01, p11 = self.after[2:, :-1]
        q00, q01, q11 = self.before[2:, 1:]
        determinant = q00 * q11 - q01 * q01
        a, b = p00 + dt * p01, p01 + dt * p11
        to_value = (a * q11 - p01 * q01), (p01 * q00 - a * q01)
        to_rate = (b * q11 - p11 * q01), (p11 * q00 - b * q01)
        gain_value = to_value[0] / determinant, to_value[1] / determinant
        gain_rate = to_rate[0] / determinant, to_rate[1] / determinant
        (a, b), (c, d) = gain_value, gain_rate
        of_s00 = np.stack([a * a, 2 * a * b, b * b])
        of_s01 = np.stack([a * c, a * d + b * c, b * d])
        of_s11 = np.stack([c * c, 2 * c * d, d * d])
        started = (self.first[None, :] <= np.arange(len(value) - 1)[:, None])[:, :, None]
        all_started: list[bool] = np.asarray(started.all(axis=(1, 2))).tolist()
        for t in range(len(value) - 2, -1, -1):
            dv = value[t + 1] - self.before[0, t + 1]
            dr = rate[t + 1] - self.before[1, t + 1]
            steps = [
                (to_value[0][t] * dv + to_value[1][t] * dr) / determinant[t],
                (to_rate[0][t] * dv + to_rate[1][t] * dr) / determinant[t],
            ]
            d00, d01, d11 = (
                s[t + 1] - p[t] for s, p in ((s00, q00), (s01, q01), (s11, q11))
            )
            for of in (of_s00, of_s01, of_s11):
                steps.append(of[0, t] * d00 + of[1, t] * d01 + of[2, t] * d11)
            if not all_started[t]:
                steps = [np.where(started[t], step, 0.0) for step in steps]
            for table, step in zip((value, rate, s00, s01, s11), steps, strict=True):
                table[t] += step
        return value, rate, s00


def filtered(
    measured: Floats,
    seen: NDArray[np.bool_],
    steps_s: Floats,
    variance: Floats,
    acceleration: Floats,
    rate: Floats,
) -> Filtered:
    """Run the filter forwards over N paths; as for `smooth`."""
    # After a gap of days nothing of a motion is left to be known, but powers of its length would
    # cancel one another out.
    steps_s = np.minimum(steps_s, LONGEST_STEP_S)
    frames, count, components = measured.shape
    first = np.argmax(seen, axis=0)
    bank = KalmanBank(components)
    bank.add(measured[first, np.arange(count)], variance, rate)
    after, before = np.empty((5, *measured.shape)), np.empty((5, *measured.shape))
    # The bank's tables as one, so that a frame's are kept with one copy.
    state = np.stack([bank.value, bank.rate, bank.p00, bank.p01, bank.p11])
    bank.value, bank.rate, bank.p00, bank.p01, bank.p11 = state
    begun = first[None, :] < np.arange(frames)[:, None]
    measuring = begun & seen
    predicting, updating = begun.sum(axis=1).tolist(), measuring.sum(axis=1).tolist()
    for t, dt in enumerate(steps_s.tolist()):
        if predicting[t]:
            rows = slice(None) if predicting[t] == count else np.flatnonzero(begun[t])
            bank.predict(dt, acceleration[rows], rows)
        before[:, t] = state
        if updating[t]:
            rows = slice(None) if updating[t] == count else np.flatnonzero(measuring[t])
            bank.update(rows, measured[t, rows], variance[rows])
        after[:, t] = state
    return Filtered(after, before, first, steps_s)
