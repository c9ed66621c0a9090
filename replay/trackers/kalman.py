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
        q = acceleration_variance
        p00, p01, p11 = self.p00[rows], self.p01[rows], self.p11[rows]
        self.value[rows] = self.value[rows] + dt * self.rate[rows]
        self.p00[rows] = p00 + dt * (2 * p01 + dt * p11) + q * (0.25 * dt * dt * dt * dt)
        self.p01[rows] = p01 + dt * p11 + q * (0.5 * dt * dt * dt)
        self.p11[rows] = p11 + q * (dt * dt)

    def update(
        self, rows: NDArray[np.intp] | slice, measured: Floats, variance: Floats | float
    ) -> None:
        """Correct the given rows with measured values (M, D) of the given variance, broadcastable
        to (M, D).
        """
        p00, p01, p11 = self.p00[rows], self.p01[rows], self.p11[rows]
        s = p00 + variance
        k0, k1 = p00 / s, p01 / s
        residual = measured - self.value[rows]
        self.value[rows] = self.value[rows] + k0 * residual
        self.rate[rows] = self.rate[rows] + k1 * residual
        self.p11[rows] = p11 - k1 * p01
        self.p00[rows] = (1 - k0) * p00
        self.p01[rows] = (1 - k0) * p01

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
