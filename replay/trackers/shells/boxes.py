"""Boxes without pixels: whose detection is whose, and who is hidden behind whom, by predictions and shells alone.

Where a scene has no foreground there is nothing to own, but the rest of the method stands. An object that is not seen
while another lies over it is occluded: it goes on as predicted, but stays within its occluder's shell (SHELLS 2.3, case
III), and is held present for longer. Detections are given to those in sight first, near their predictions: were
everybody to choose within a whole shell, one missing detection would push a row of neighbours on to the next one's.

Equation 9's ``a`` is the filter's own gain here: a detected box's error is known, an owned pixel's is not.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import assign, intersection, iou
from replay.trackers.shells.births import Free
from replay.trackers.shells.objects import TENTATIVE, Bodies
from replay.trackers.shells.parameters import ShellsParameters

Floats = NDArray[np.float64]
Pairs = list[tuple[int, int]]

_GATE = 4.0
"""Furthest innovation that is associated, standard deviations."""
_OVERLAP = 0.2
"""Least IoU of a detection with the box that was predicted."""

_RESIZED = 0.7
"""Largest change of area (log) of one who is found again where nobody else is."""


def match(bodies: Bodies, free: Free, p: ShellsParameters) -> Pairs:
    """(row, detection) pairs: those in sight choose first, then the lost, last the tentative."""
    items = bodies.items
    followed = [k for k, b in enumerate(items) if b.id != TENTATIVE and not b.lost]
    lost = [k for k, b in enumerate(items) if b.id != TENTATIVE and b.lost]
    tentative = [k for k, b in enumerate(items) if b.id == TENTATIVE]
    sure = free.scores >= p.start_score
    out: Pairs = []
    near = partial(_near, p=p)
    for who, which, choose in (
        (followed, sure, near),
        (followed, ~sure, near),
        (followed, sure, _only),
        (lost, sure, near),
        (tentative, sure, near),
    ):
        done = dict(out)
        stage = [k for k in who if k not in done]
        columns = np.setdiff1d(np.flatnonzero(which), list(done.values()))
        if stage and len(columns):
            pairs = choose(bodies, np.array(stage, np.intp), free.boxes[columns])
            out += [(stage[i], int(columns[j])) for i, j in pairs]
    return out


def _near(bodies: Bodies, rows: NDArray[np.intp], boxes: Floats, p: ShellsParameters) -> Pairs:
    """Pairs near the predictions, (index of row, index of box)."""
    bank = bodies.bank
    noise = p.box_noise * np.sqrt(np.maximum(boxes[:, 2] * boxes[:, 3], 1.0))
    away = boxes[:, :2] + boxes[:, 2:] / 2 - bank.value[rows, None, :2]
    distance2 = (away * away / (bank.p00[rows, None, :2] + (noise * noise)[None, :, None])).sum(axis=2)
    overlap = iou(bodies.boxes[rows], boxes)
    allowed = (distance2 <= _GATE * _GATE) & (overlap >= _OVERLAP)
    return assign(1.0 - overlap + distance2 / (_GATE * _GATE), allowed)


def learn(bodies: Bodies, taken: Mapping[int, int], free: Free, p: ShellsParameters) -> None:
    """Learn how the targets move from {detection: row}: of who was in sight, where no other detection is near."""
    manner = bodies.manner
    if manner is None or not taken:
        return
    columns = sorted(taken)
    rows = np.array([taken[c] for c in columns], np.intp)
    near = np.count_nonzero(intersection(free.boxes[columns], free.boxes) > 0, axis=1) > 1
    steady = np.array([b.id != TENTATIVE and b.mode == "motion" for b in (bodies.items[k] for k in rows)], bool)
    found = free.boxes[columns]
    sure = free.scores[columns] >= p.start_score
    sizes = np.sqrt(np.maximum(found[:, 2] * found[:, 3], 1.0))
    manner.see(rows, found[:, :2] + found[:, 2:] / 2, sizes, steady & sure & ~near)


def _only(bodies: Bodies, rows: NDArray[np.intp], boxes: Floats) -> Pairs:
    """Pairs within a minimum shell without a rival: no other detection is left in it, and nobody else is about.

    Whoever turns back abruptly is off its prediction, yet nobody else can be there.
    """
    bank = bodies.bank
    away = boxes[:, :2] + boxes[:, 2:] / 2 - bank.value[rows, None, :2]
    smallest = bodies.radii(0.0)[rows]
    inside = (away * away).sum(axis=2) <= (smallest * smallest)[:, None]
    area = bank.value[rows, 2] * bank.value[rows, 3]
    ratio = np.log(np.maximum(area, 1.0)[:, None] / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0))
    alone = inside & (inside.sum(axis=1, keepdims=True) == 1) & (inside.sum(axis=0, keepdims=True) == 1)
    return [(int(i), int(j)) for i, j in np.argwhere(alone & (np.abs(ratio) <= _RESIZED))]


def hide(bodies: Bodies, p: ShellsParameters) -> None:
    """An object that is not seen while another, that is, lies over it, is behind that one."""
    items = bodies.items
    seen = [k for k, b in enumerate(items) if b.id != TENTATIVE and b.observed]
    boxes = bodies.boxes
    for row, body in enumerate(items):
        if body.id == TENTATIVE or body.observed or not seen:
            continue
        if any(items[k].id == body.front for k in seen):
            continue
        mine = boxes[row : row + 1]
        cover = intersection(mine, boxes[seen])[0] / max(1.0, float(mine[0, 2] * mine[0, 3]))
        best = int(np.argmax(cover))
        body.front = items[seen[best]].id if cover[best] >= p.hidden_cover else TENTATIVE
