"""A bank of constant-velocity Kalman filters, vectorised over targets.

Every state component (centre x, centre y, width, ...) is an independent [value, rate] filter, so
a target with D components is D two-state filters; covariances are kept as their three distinct
numbers and all sums are written out. No matrix product reaches BLAS, whose kernels differ between
machines. `model` gives the same filter as a `filterpy.kalman.KalmanFilter`, the reference that
the tests hold this bank against.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from filterpy.kalman import KalmanFilter

Floats = NDArray[np.float64]
State = tuple[Floats, Floats, Floats, Floats, Floats]
"""Value, rate, p00, p01, p11 of some components; also as one table (5, ...)."""
Noise = tuple[Floats | float, Floats | float, Floats | float]


def white_noise(dt: float, acceleration_variance: Floats | float) -> Noise:
    """What dt seconds of white-noise acceleration of a variance add to p00, p01 and p11."""
    q = acceleration_variance
    return q * (0.25 * dt * dt * dt * dt), q * (0.5 * dt * dt * dt), q * (dt * dt)


def predicted(state: State | Floats, dt: float, noise: Noise) -> State:
    """A state dt seconds later, under such noise; of arrays of any shape, all alike."""
    value, rate, p00, p01, p11 = state
    step = dt * p11
    return (
        value + dt * rate,
        rate,
        p00 + dt * (2 * p01 + step) + noise[0],
        p01 + step + noise[1],
        p11 + noise[2],
    )


def updated(state: State | Floats, measured: Floats, variance: Floats | float) -> State:
    """A state corrected with measured values of a variance."""
    value, rate, p00, p01, p11 = state
    s = p00 + variance
    k0, k1 = p00 / s, p01 / s
    residual, left = measured - value, 1 - k0
    return (
        value + k0 * residual,
        rate + k1 * residual,
        left * p00,
        left * p01,
        p11 - k1 * p01,
    )


class KalmanBank:
    """N targets by D components, each a constant-velocity filter.

    Attributes:
        value: (N, D) the components' estimates, pixels (or radians).
        rate: (N, D) their rates, per second.
        p00, p01, p11: (N, D) the covariance [[p00, p01], [p01, p11]] of each.
    """

    def __init__(self, components: int) -> None:
        self.components = components
        self.value: Floats = np.zeros((0, components))
        self.rate: Floats = np.zeros((0, components))
        self.p00: Floats = np.zeros((0, components))
        self.p01: Floats = np.zeros((0, components))
        self.p11: Floats = np.zeros((0, components))

    def __len__(self) -> int:
        return len(self.value)

    def add(
        self,
        value: Floats,
        variance: Floats,
        rate_variance: Floats,
        rate: Floats | None = None,
    ) -> None:
        """Append targets: value (M, D), their variances (M, D) or broadcastable, rate 0 unless
        given.
        """
        value = np.atleast_2d(np.asarray(value, np.float64))
        shape = value.shape
        self.value = np.concatenate([self.value, value])
        self.rate = np.concatenate(
            [self.rate, np.zeros(shape) if rate is None else np.atleast_2d(rate)]
        )
        self.p00 = np.concatenate([self.p00, np.broadcast_to(variance, shape)])
        self.p01 = np.concatenate([self.p01, np.zeros(shape)])
        self.p11 = np.concatenate([self.p11, np.broadcast_to(rate_variance, shape)])

    def keep(self, rows: NDArray[np.bool_] | NDArray[np.intp]) -> None:
        """Keep the rows of a boolean mask or an index array, in that order."""
        for name in ("value", "rate", "p00", "p01", "p11"):
            setattr(self, name, getattr(self, name)[rows])

    def predict(
        self, dt: float, acceleration_variance: Floats | float, rows: Any = slice(None)
    ) -> None:
        """Advance by dt seconds under discrete white-noise acceleration of the given variance
        (units/s^2)^2.
        """
        found = predicted(self._rows(rows), dt, white_noise(dt, acceleration_variance))
        self._set(rows, found)

    def update(
        self, rows: NDArray[np.intp] | slice, measured: Floats, variance: Floats | float
    ) -> None:
        """Correct the given rows with measured values (M, D) of the given variance, broadcastable
        to (M, D).
        """
        self._set(rows, updated(self._rows(rows), measured, variance))

    def _rows(self, rows: Any) -> State:
        return (
            self.value[rows], self.rate[rows], self.p00[rows], self.p01[rows], self.p11[rows],
        )  # fmt: skip

    def _set(self, rows: Any, state: State) -> None:
        self.value[rows], self.rate[rows], self.p00[rows] = state[:3]
        self.p01[rows], self.p11[rows] = state[3:]

    def update_row(self, row: int, measured: Floats, variance: Floats | float) -> None:
        """The same for one target: measured (D,), variance (D,) or one for all."""
        value, rate = self.value[row], self.rate[row]
        p00, p01, p11 = self.p00[row], self.p01[row], self.p11[row]
        s = p00 + variance
        k0, k1 = p00 / s, p01 / s
        residual = measured - value
        value += k0 * residual
        rate += k1 * residual
        p11 -= k1 * p01
        left = 1 - k0
        p00 *= left
        p01 *= left

    def distance2(self, measured: Floats, variance: Floats) -> Floats:
        """Squared Mahalanobis distances, (N, M), summed over components; variance broadcasts to
        (N, M, D).
        """
        residual = measured[None, :, :] - self.value[:, None, :]
        out: Floats = np.sum(
            residual * residual / (self.p00[:, None, :] + variance), axis=2
        )
        return out

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {
            name: getattr(self, name).copy()
            for name in ("value", "rate", "p00", "p01", "p11")
        }

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        for name in ("value", "rate", "p00", "p01", "p11"):
            setattr(
                self, name, np.array(state[name], np.float64).reshape(-1, self.components)
            )


def model(
    values: Sequence[float],
    dt: float,
    variance: float,
    rate_variance: float,
    acceleration_variance: float,
    measurement_variance: float,
) -> KalmanFilter:
    """The same constant-velocity filter as a filterpy object: state [v0, r0, v1, r1, ...]."""
    # It brings all of scipy.stats along, a third of what starting a replay takes.
    from filterpy.common import Q_discrete_white_noise
    from filterpy.kalman import KalmanFilter

    count = len(values)
    kf = KalmanFilter(dim_x=2 * count, dim_z=count)
    kf.x[0::2, 0] = values
    kf.F = np.kron(np.eye(count), np.array([[1.0, dt], [0.0, 1.0]]))
    kf.H = np.kron(np.eye(count), np.array([[1.0, 0.0]]))
    kf.Q = np.kron(np.eye(count), Q_discrete_white_noise(2, dt, acceleration_variance))
    kf.P = np.kron(np.eye(count), np.diag([variance, rate_variance]))
    kf.R = np.eye(count) * measurement_variance
    return kf
