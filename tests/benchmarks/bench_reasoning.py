"""CPU time of a reasoning step against the number of targets; ``--plot PNG`` draws it.

People wander over an area that grows with their number, so that each has about as many
neighbours; blobs are shared where boxes overlap. Prints milliseconds per frame (median and 95th
percentile) and microseconds per target.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np

from reasoning.reasoner import Reasoner
from recorders.messages import Target, Targets

COUNTS = (2, 5, 8, 10, 20, 50, 100, 200)


def shared_blobs(boxes: np.ndarray) -> list[int]:
    """The lowest member of each target's chain of overlapping boxes."""
    x, y, w, h = boxes.T
    near = (abs(x[:, None] - x) < (w[:, None] + w) / 2) & (
        abs(y[:, None] - y) < (h[:, None] + h) / 2
    )
    root = np.arange(len(boxes))
    for _ in range(8):
        root = np.where(near, root[None, :], len(boxes)).min(axis=1)
    return [int(r) for r in root]


def scene(people: int, frames: int, seed: int = 0) -> list[Targets]:
    """Random walks of ``people`` persons of 20 x 50 px, one per 100 x 100 px of ground."""
    rng = np.random.default_rng(seed)
    side = 100 * people**0.5
    places, speeds = rng.uniform(0, side, (people, 2)), rng.normal(0, 1.5, (people, 2))
    answer = []
    for k in range(frames):
        speeds = 0.98 * speeds + rng.normal(0, 0.3, speeds.shape)
        places = (places + speeds) % side
        boxes = np.hstack([places, np.full((people, 1), 20.0), np.full((people, 1), 50.0)])
        blobs = shared_blobs(boxes)
        targets = [
            Target(i, tuple(b), (float(v[0]) * 25, float(v[1]) * 25), blob=blobs[i])
            for i, (b, v) in enumerate(zip(boxes.tolist(), speeds, strict=True))
        ]
        answer.append(Targets(k, targets))
    return answer


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=300)
    parser.add_argument(
        "--plot",
        type=Path,
        metavar="PNG",
        help="draw the cost against the number of targets",
    )
    args = parser.parse_args()
    frames = args.frames
    costs = []
    print(f"{'targets':>8}{'related':>9}{'ms median':>11}{'ms 95 %':>9}{'us/target':>11}")
    for people in COUNTS:
        side = round(100 * people**0.5)
        reasoner, spent, pairs = Reasoner({}, side, side), [], 0
        for k, targets in enumerate(scene(people, frames)):
            start = time.thread_time()
            annotation = reasoner.step(k, k * 40_000_000, targets, None)
            spent.append(time.thread_time() - start)
            pairs += len(annotation.relations.relations)
        middle, high = np.percentile(spent, [50, 95]) * 1e3
        costs.append((middle, high))
        print(
            f"{people:>8}{pairs / frames:>9.1f}{middle:>11.3f}{high:>9.3f}{middle * 1e3 / people:>11.1f}"
        )
    exponent = float(
        np.polyfit(np.log(COUNTS[-5:]), np.log([c[0] for c in costs[-5:]]), 1)[0]
    )
    print(
        f"from {COUNTS[-5]} to {COUNTS[-1]} targets the cost grows with their number to the"
        f" power of {exponent:.2f}"
    )
    if args.plot is not None:
        plot(args.plot, costs, exponent)


def plot(path: Path, costs: list[tuple[float, float]], exponent: float) -> None:
    """Median and 95th percentile against the number of targets, both axes linear, with a straight
    line beside.
    """
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6.4, 4), dpi=110)
    middle, high = zip(*costs, strict=True)
    axes.fill_between(COUNTS, middle, high, alpha=0.2, label="median to 95th percentile")
    axes.plot(COUNTS, middle, "o-", label=f"median, about n^{exponent:.2f}")
    axes.plot((0, COUNTS[-1]), (0, middle[-1]), "k:", linewidth=1, label="linear")
    axes.set(
        xlabel="targets",
        ylabel="CPU ms per frame",
        title="Reasoning over a frame",
        xlim=0,
        ylim=0,
    )
    axes.legend()
    figure.tight_layout()
    figure.savefig(path)


if __name__ == "__main__":
    main()
