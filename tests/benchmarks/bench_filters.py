"""The Kalman bank and the smoother against filterpy's: time, agreement, and whether the bits stay
the same over BLAS kernels.

Run: ``python tests/benchmarks/bench_filters.py``
"""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np

from replay.hindsight.smoothing import smooth
from replay.trackers.kalman import KalmanBank, model

TARGETS, COMPONENTS, FRAMES, ROUNDS = 10, 4, 300, 3
DT, ACCELERATION, NOISE, SPEED = 0.04, 9.0, 4.0, 100.0
KERNELS = ("Prescott", "Sandybridge", "Haswell")
Floats = np.ndarray


def measured() -> Floats:
    rng = np.random.Generator(np.random.PCG64(1))
    steps = rng.normal(1, 1, (FRAMES, TARGETS, COMPONENTS))
    return np.cumsum(steps, axis=0) + rng.normal(0, 2, steps.shape)


def bank(paths: Floats) -> Floats:
    found = KalmanBank(COMPONENTS)
    of = np.ones((TARGETS, COMPONENTS))
    found.add(paths[0], NOISE * of, SPEED * of)
    rows = np.arange(TARGETS)
    values = [found.value.copy()]
    for now in paths[1:]:
        found.predict(DT, ACCELERATION)
        found.update(rows, now, NOISE)
        values.append(found.value.copy())
    return np.array(values)


def filterpy(paths: Floats, smoothed: bool = False) -> Floats:
    answer = []
    for k in range(TARGETS):
        one = model(list(paths[0, k]), DT, NOISE, SPEED, ACCELERATION, NOISE)
        states, covariances = [one.x.copy()], [one.P.copy()]
        for now in paths[1:, k]:
            one.predict()
            one.update(now)
            states.append(one.x.copy())
            covariances.append(one.P.copy())
        whole = np.array(states)
        if smoothed:
            whole = one.rts_smoother(whole, np.array(covariances))[0]
        answer.append(whole[:, 0::2, 0])
    return np.array(answer).transpose(1, 0, 2)


def smoother(paths: Floats) -> Floats:
    of = np.ones((TARGETS, COMPONENTS))
    seen, steps = np.ones(paths.shape[:2], bool), np.full(FRAMES, DT)
    return smooth(paths, seen, steps, NOISE * of, ACCELERATION * of, SPEED * of)[0]


CALLS: dict[str, tuple[Callable[[Floats], Floats], Callable[[Floats], Floats]]] = {
    "filter": (bank, filterpy),
    "smooth": (smoother, lambda paths: filterpy(paths, smoothed=True)),
}


def seconds(call: Callable[[Floats], Floats], paths: Floats) -> float:
    start = time.perf_counter()
    call(paths)
    return time.perf_counter() - start


def digests() -> list[str]:
    """Of each answer's bits, in this process."""
    paths = measured()
    return [
        hashlib.sha256(np.ascontiguousarray(call(paths)).tobytes()).hexdigest()
        for pair in CALLS.values()
        for call in pair
    ]


def main() -> None:
    """Print microseconds per target and frame, the largest difference, and the kernels' digests."""
    paths = measured()
    print(
        f"{TARGETS} targets of {COMPONENTS} components over {FRAMES} frames, best of {ROUNDS}"
    )
    for name, (ours, peer) in CALLS.items():
        apart = float(np.abs(ours(paths) - peer(paths)).max())
        times = [(seconds(ours, paths), seconds(peer, paths)) for _ in range(ROUNDS)]
        mine, theirs = (1e6 * min(t[k] for t in times) / TARGETS / FRAMES for k in (0, 1))
        print(
            f"{name}  ours {mine:6.2f} us  filterpy {theirs:6.2f} us  ratio {theirs / mine:5.1f}  apart {apart:.1e} px"
        )
    found = []
    for kernel in KERNELS:
        done = subprocess.run(
            [sys.executable, __file__, "--digests"],
            env={**os.environ, "OPENBLAS_CORETYPE": kernel},
            capture_output=True, text=True, check=True,
        )  # fmt: skip
        found.append(done.stdout.split())
    labels = [f"{who} {name}" for name in CALLS for who in ("our", "filterpy's")]
    for label, *of_kernels in zip(labels, *found, strict=True):
        count = len(set(of_kernels))
        print(
            f"{label}: {count} result{'s' * (count > 1)} over the BLAS kernels {', '.join(KERNELS)}"
        )


if __name__ == "__main__":
    if "--digests" in sys.argv:
        print(*digests())
    else:
        main()
