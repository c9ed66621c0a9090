"""Rauch-Tung-Striebel smoothing of many paths at once, in closed form.

Every component (centre x, centre y, width, height) is its own constant-velocity filter, as in
`replay.trackers.kalman`; filterpy's `rts_smoother` is the reference that the tests hold this
against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.trackers.kalman import State, predicted, updated, white_noise

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
        after, before = self.after, self.before
        moved, spread = after[:2].swapaxes(0, 1).copy(), after[2:].swapaxes(0, 1).copy()
        if len(moved) < 2:
            return moved[:, 0], moved[:, 1], spread[:, 0]
        dt = self.steps_s[1:, None, None]
        p00, p01, p11 = after[2:, :-1]
        q00, q01, q11 = before[2:, 1:]
        determinant = q00 * q11 - q01 * q01
        a, b = p00 + dt * p01, p01 + dt * p11
        to_value = (a * q11 - p01 * q01), (p01 * q00 - a * q01)
        to_rate = (b * q11 - p11 * q01), (p11 * q00 - b * q01)
        # (T, 2, 2, N, D): how value and rate follow those after them, and (T, 3, 3, N, D), how the
        # covariance follows that after it.
        to_moved = np.array([to_value, to_rate]).transpose(2, 1, 0, 3, 4).copy()
        (a, b), (c, d) = (
            (to / determinant for to in to_value),
            (to / determinant for to in to_rate),
        )
        to_spread = (
            np.array(
                [
                    [a * a, a * c, c * c],
                    [2 * a * b, a * d + b * c, 2 * c * d],
                    [b * b, b * d, d * d],
                ]
            )
            .transpose(2, 0, 1, 3, 4)
            .copy()
        )
        expected = before.swapaxes(0, 1)
        started = (self.first[None, :] <= np.arange(len(moved) - 1)[:, None])[:, :, None]
        all_started: list[bool] = np.asarray(started.all(axis=(1, 2))).tolist()
        for t in range(len(moved) - 2, -1, -1):
            off = moved[t + 1] - expected[t + 1, :2]
            step = to_moved[t] * off[:, None]
            step = (step[0] + step[1]) / determinant[t]
            off = spread[t + 1] - expected[t + 1, 2:]
            change = to_spread[t] * off[:, None]
            change = change[0] + change[1] + change[2]
            if not all_started[t]:
                step = np.where(started[t], step, 0.0)
                change = np.where(started[t], change, 0.0)
            moved[t] += step
            spread[t] += change
        return moved[:, 0], moved[:, 1], spread[:, 0]


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
    after, before = np.empty((5, *measured.shape)), np.empty((5, *measured.shape))
    start = np.zeros((5, count, components))
    start[0], start[2], start[4] = measured[first, np.arange(count)], variance, rate
    begun = first[None, :] < np.arange(frames)[:, None]
    measuring = begun & seen
    moving, some = begun.sum(axis=1).tolist(), measuring.sum(axis=1).tolist()
    state, last, noise = start, -1.0, white_noise(0.0, acceleration)
    for t, dt in enumerate(steps_s.tolist()):
        if dt != last:
            last, noise = dt, white_noise(dt, acceleration)
        # All paths are reckoned on at once, and of those taken that it is true of.
        now, later = before[:, t], after[:, t]
        if moving[t] < count:
            now[...] = state
        if moving[t]:
            _take(now, predicted(state, dt, noise), begun[t], moving[t])
        if some[t] < count:
            later[...] = now
        if some[t]:
            _take(later, updated(now, measured[t], variance), measuring[t], some[t])
        state = later
    return Filtered(after, before, first, steps_s)


def _take(table: Floats, state: State, rows: NDArray[np.bool_], count: int) -> None:
    """Write a state into a table (5, N, D), of rows (N,) of which so many are true."""
    if count == len(rows):
        for into, values in zip(table, state, strict=True):
            into[...] = values
        return
    where = rows[:, None]
    for into, values in zip(table, state, strict=True):
        np.copyto(into, values, where=where)
