"""What one target or a pair does for a while, for the patterns: standing still, being near one
another.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from reasoning.encounters.encounters import side_by_side
from reasoning.encounters.pair import (
    Bools,
    Floats,
    History,
    both_seen,
    frame_step,
    length,
    running_median,
    spans,
    velocity,
)
from reasoning.encounters.parameters import EncounterParameters

STILL_SIZES_PER_S = 0.08
STILL_LEAST_S = 1.0


@dataclass(frozen=True)
class Stretch:
    """A closed interval in frames and seconds, with what decided about each of its moments.

    Attributes:
        median, most: of nearness the distance in sizes of the larger one, of standing still the
            speed in own sizes per second.
    """

    start_frame: int
    end_frame: int
    start_s: float
    end_s: float
    median: float = 0.0
    most: float = 0.0


def still(history: History, parameters: EncounterParameters | None = None) -> list[Stretch]:
    """When a target stood still: slower than 0.08 of its own size per second for at least a
    second.
    """
    p = parameters or EncounterParameters()
    history = history.sights()
    if len(history.frames) < 2:
        return []
    step = frame_step(history.times_s)
    half = max(1, round(p.window_s / step)) if step > 0 else 1
    size = max(float(np.median(length(history.boxes[:, 2:]))), 1.0)
    feet = np.stack(
        [
            history.boxes[:, 0] + history.boxes[:, 2] / 2,
            history.boxes[:, 1] + history.boxes[:, 3],
        ],
        axis=1,
    )
    steady = np.stack([running_median(feet[:, k], half) for k in (0, 1)], axis=1)
    speed = length(velocity(steady, history.times_s, half)) / size
    gap = np.concatenate([[False], np.diff(history.times_s) > p.gap_s])
    return [
        stretch
        for stretch in _stretches(speed <= STILL_SIZES_PER_S, gap, history, speed)
        if stretch.end_s - stretch.start_s >= STILL_LEAST_S
    ]


def near(
    histories: Mapping[int, History], parameters: EncounterParameters | None = None
) -> list[tuple[int, int, Stretch]]:
    """When two targets a < b stood within touching distance, in sizes of the larger one, by
    start, a, b.
    """
    p = parameters or EncounterParameters()
    out: list[tuple[int, int, Stretch]] = []
    for a, b in side_by_side(histories):
        one, two = histories[a], histories[b]
        common, in_a, in_b = np.intersect1d(
            one.frames, two.frames, assume_unique=True, return_indices=True
        )
        kept = both_seen(one, two, in_a, in_b)
        common, in_a, in_b = common[kept], in_a[kept], in_b[kept]
        if len(common) < 2:
            continue
        times, box_a, box_b = one.times_s[in_a], one.boxes[in_a], two.boxes[in_b]
        apart = np.stack(
            [
                box_a[:, 0] + box_a[:, 2] / 2 - box_b[:, 0] - box_b[:, 2] / 2,
                box_a[:, 1] + box_a[:, 3] - box_b[:, 1] - box_b[:, 3],
            ],
            axis=1,
        )
        step = frame_step(times)
        half = max(1, round(p.window_s / 2 / step)) if step > 0 else 1
        size = np.maximum(np.maximum(length(box_a[:, 2:]), length(box_b[:, 2:])), 1.0)
        distance = running_median(length(apart) / size, half)
        gap = np.concatenate([[False], np.diff(times) > p.gap_s])
        pair = History(common, times, box_a)
        out += [
            (a, b, stretch)
            for stretch in _stretches(distance <= p.touch_sizes, gap, pair, distance)
        ]
    return sorted(out, key=lambda x: (x[2].start_frame, x[0], x[1]))


def _stretches(mask: Bools, gap: Bools, history: History, values: Floats) -> list[Stretch]:
    """Runs of the mask, cut where the target was not seen for a while; ``values`` decided about
    the mask.
    """
    found = []
    for start, end in spans(mask):
        cuts = [
            start,
            *(np.flatnonzero(gap[start + 1 : end + 1]) + start + 1).tolist(),
            end + 1,
        ]
        found += [(s, e - 1) for s, e in pairwise(cuts)]
    return [
        Stretch(
            int(history.frames[s]), int(history.frames[e]), float(history.times_s[s]), float(history.times_s[e]),
            median=float(np.median(values[s : e + 1])), most=float(np.max(values[s : e + 1])),
        )
        for s, e in found
    ]  # fmt: skip
