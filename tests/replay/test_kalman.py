"""The Kalman bank against filterpy, its reference."""

from __future__ import annotations

import msgspec
import numpy as np
import pytest

from replay.trackers.kalman import KalmanBank, model

DT, ACCELERATION, NOISE, SPEED = 0.04, 9.0, 4.0, 100.0


def _measurements(frames: int) -> np.ndarray:
    rng = np.random.Generator(np.random.PCG64(1))
    t = np.arange(frames)[:, None, None]
    return t * np.array([[2.0, -1.0], [0.5, 3.0], [0.0, 0.0]]) + rng.normal(
        0, 2, (frames, 3, 2)
    )


def _bank(first: np.ndarray) -> KalmanBank:
    bank = KalmanBank(2)
    bank.add(first, np.full((3, 2), NOISE), np.full((3, 2), SPEED))
    return bank


def test_bank_equals_filterpy_with_and_without_measurements() -> None:
    measured = _measurements(50)
    bank = _bank(measured[0])
    references = [
        model(list(m), DT, NOISE, SPEED, ACCELERATION, NOISE) for m in measured[0]
    ]
    for t in range(1, 50):
        bank.predict(DT, ACCELERATION)
        rows = np.array([k for k in range(3) if (t + k) % 4], np.intp)
        bank.update(rows, measured[t, rows], NOISE)
        for k, reference in enumerate(references):
            reference.predict()
            if k in rows:
                reference.update(measured[t, k])
            assert bank.value[k] == pytest.approx(reference.x[0::2, 0], abs=1e-9)
            assert bank.rate[k] == pytest.approx(reference.x[1::2, 0], abs=1e-9)
            assert bank.p00[k, 0] == pytest.approx(reference.P[0, 0], abs=1e-9)
            assert bank.p01[k, 1] == pytest.approx(reference.P[2, 3], abs=1e-9)
            assert bank.p11[k, 1] == pytest.approx(reference.P[3, 3], abs=1e-9)


def test_prediction_of_some_rows_leaves_the_others() -> None:
    bank = _bank(_measurements(1)[0])
    bank.rate[:] = 5.0
    before = bank.value.copy()
    bank.predict(1.0, 0.0, np.array([0, 2]))
    assert bank.value - before == pytest.approx(
        np.array([[5.0, 5.0], [0.0, 0.0], [5.0, 5.0]])
    )


def test_mahalanobis_distance_counts_standard_deviations() -> None:
    bank = KalmanBank(2)
    bank.add(np.zeros((1, 2)), np.full((1, 2), 5.0), np.ones((1, 2)))
    assert bank.distance2(np.array([[3.0, 0.0], [3.0, 3.0]]), np.array(4.0))[
        0
    ] == pytest.approx([1.0, 2.0])


def test_state_goes_through_plain_data_exactly() -> None:
    measured = _measurements(20)
    bank = _bank(measured[0])
    for t in range(1, 10):
        bank.predict(DT, ACCELERATION)
        bank.update(np.arange(3), measured[t], NOISE)
    other = KalmanBank(2)
    plain = {k: v.tolist() for k, v in bank.state().items()}
    other.restore(msgspec.json.decode(msgspec.json.encode(plain)))
    for t in range(10, 20):
        for b in (bank, other):
            b.predict(DT, ACCELERATION)
            b.update(np.arange(3), measured[t], NOISE)
    assert all(
        np.array_equal(a, b)
        for a, b in zip(bank.state().values(), other.state().values(), strict=True)
    )


def test_keeping_rows_keeps_their_order() -> None:
    bank = _bank(np.arange(6.0).reshape(3, 2))
    bank.keep(np.array([2, 0]))
    assert bank.value.tolist() == [[4.0, 5.0], [0.0, 1.0]]
    assert len(bank) == 2
