"""Rauch-Tung-Striebel smoothing of many paths at once, in closed form.

Every component (centre x, centre y, width, height) is its own constant-velocity filter, as in
`replay.trackers.kalman`; filterpy's `rts_smoother` is the reference that the tests hold this against.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from replay.trackers.kalman import KalmanBank

Floats = NDArray[np.float64]
_NAMES = ("value", "rate", "p00", "p01", "p11")


def smooth(
    measured: Floats, seen: NDArray[np.bool_], steps_s: Floats, variance: Floats, acceleration: Floats, rate: Floats
) -> tuple[Floats, Floats]:
    """Smooth N paths of D components over T frames.

    Args:
        measured: (T, N, D) measurements, anything where not seen; in a row's first seen frame, its start.
        seen: (T, N) where there is a measurement. A row is started at its first; before it, it is not defined.
        steps_s: (T,) seconds since the frame before (the first is not used).
        variance: (N, D) measurement variances.
        acceleration: (N, D) variances of the white acceleration noise.
        rate: (N, D) variances of the rates at the start.

    Returns:
        Smoothed values and rates, (T, N, D) each; rows before their first measurement hold that measurement.
    """
    after, before, first = _forward(measured, seen, steps_s, variance, acceleration, rate)
    return _backward(after, before, steps_s, first)


def likelihood(
    measured: Floats, seen: NDArray[np.bool_], steps_s: Floats, variance: Floats, acceleration: Floats, rate: Floats
) -> Floats:
    """Log likelihood of each path and component under the filter, (N, D), constants left out; as for `smooth`."""
    _, before, first = _forward(measured, seen, steps_s, variance, acceleration, rate)
    later = seen & (np.arange(len(measured))[:, None] > first)
    spread = before["p00"] + variance
    residual = measured - before["value"]
    return np.asarray(
        np.where(later[:, :, None], -0.5 * (residual * residual / spread + np.log(spread)), 0).sum(axis=0)
    )


def _forward(
    measured: Floats, seen: NDArray[np.bool_], steps_s: Floats, variance: Floats, acceleration: Floats, rate: Floats
) -> tuple[dict[str, Floats], dict[str, Floats], NDArray[np.intp]]:
    """The filter's estimates after and before each frame's measurements, and each row's first frame."""
    frames, count, components = measured.shape
    first = np.argmax(seen, axis=0)
    bank = KalmanBank(components)
    bank.add(measured[first, np.arange(count)], variance, rate)
    after = {name: np.empty_like(measured) for name in _NAMES}
    before = {name: np.empty_like(measured) for name in _NAMES}
    for t in range(frames):
        rows = np.flatnonzero(first < t)
        if len(rows):
            bank.predict(float(steps_s[t]), acceleration[rows], rows)
        for name in _NAMES:
            before[name][t] = getattr(bank, name)
        rows = rows[seen[t, rows]]
        if len(rows):
            bank.update(rows, measured[t, rows], variance[rows])
        for name in _NAMES:
            after[name][t] = getattr(bank, name)
    return after, before, first


def _backward(
    after: dict[str, Floats], before: dict[str, Floats], steps_s: Floats, first: NDArray[np.intp]
) -> tuple[Floats, Floats]:
    """x_t + C (x_t+1|T - x_t+1|t), C = P_t F' P_t+1|t^-1, the two-by-two inverse written out."""
    value, rate = after["value"].copy(), after["rate"].copy()
    for t in range(len(value) - 2, -1, -1):
        dt = float(steps_s[t + 1])
        p00, p01, p11 = (after[name][t] for name in ("p00", "p01", "p11"))
        q00, q01, q11 = (before[name][t + 1] for name in ("p00", "p01", "p11"))
        determinant = q00 * q11 - q01 * q01
        a, b = p00 + dt * p01, p01 + dt * p11
        dv = value[t + 1] - before["value"][t + 1]
        dr = rate[t + 1] - before["rate"][t + 1]
        gain = ((a * q11 - p01 * q01), (p01 * q00 - a * q01), (b * q11 - p11 * q01), (p11 * q00 - b * q01))
        started = (first <= t)[:, None]
        value[t] += np.where(started, (gain[0] * dv + gain[1] * dr) / determinant, 0.0)
        rate[t] += np.where(started, (gain[2] * dv + gain[3] * dr) / determinant, 0.0)
    return value, rate
