"""The closed-form smoother against filterpy's."""

from __future__ import annotations

import numpy as np
import pytest

from replay.hindsight.smoothing import likelihood, smooth
from replay.trackers.kalman import model

DT, ACCELERATION, NOISE, SPEED = 1 / 7, 20.0, 9.0, 400.0


def _paths() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.Generator(np.random.PCG64(7))
    measured = np.cumsum(rng.normal(2, 1, (40, 3, 2)), axis=0) + rng.normal(
        0, 3, (40, 3, 2)
    )
    seen = rng.random((40, 3)) < 0.7
    seen[0, 0] = True
    seen[:9, 1] = False
    seen[9, 1] = True
    return measured, seen, np.full(40, DT)


def _smooth() -> tuple[np.ndarray, np.ndarray]:
    measured, seen, steps = _paths()
    of = np.ones((3, 2))
    return smooth(measured, seen, steps, NOISE * of, ACCELERATION * of, SPEED * of)


@pytest.mark.parametrize("row", [0, 1, 2])
def test_equals_filterpys_smoother(row: int) -> None:
    measured, seen, _ = _paths()
    value, rate = _smooth()
    first = int(np.argmax(seen[:, row]))
    reference = model(list(measured[first, row]), DT, NOISE, SPEED, ACCELERATION, NOISE)
    states, covariances = [reference.x.copy()], [reference.P.copy()]
    for t in range(first + 1, len(measured)):
        reference.predict()
        if seen[t, row]:
            reference.update(measured[t, row])
        states.append(reference.x.copy())
        covariances.append(reference.P.copy())
    smoothed = reference.rts_smoother(np.array(states), np.array(covariances))[0]
    assert value[first:, row] == pytest.approx(smoothed[:, 0::2, 0], abs=1e-6)
    assert rate[first:, row] == pytest.approx(smoothed[:, 1::2, 0], abs=1e-6)


def test_before_its_first_measurement_a_path_holds_it() -> None:
    measured, seen, _ = _paths()
    value, _ = _smooth()
    first = int(np.argmax(seen[:, 1]))
    assert np.array_equal(
        value[:first, 1], np.repeat(measured[first, 1][None], first, axis=0)
    )


def test_the_likeliest_acceleration_is_the_true_one() -> None:
    rng = np.random.Generator(np.random.PCG64(3))
    speed = np.cumsum(rng.normal(0, 30 * DT, (200, 1, 1)), axis=0)
    measured = np.cumsum(speed * DT, axis=0) + rng.normal(0, 1, (200, 1, 1))
    seen, steps, one = np.ones((200, 1), bool), np.full(200, DT), np.ones((1, 1))
    scores = {
        a: float(likelihood(measured, seen, steps, one, a * a * one, 400 * one)[0, 0])
        for a in (1.0, 30.0, 900.0)
    }
    assert max(scores, key=lambda a: scores[a]) == 30.0
