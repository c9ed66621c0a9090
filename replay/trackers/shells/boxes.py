"""Boxes without pixels: whose detection is whose, and who is hidden behind whom, by predictions and shells alone.

Where a scene has no foreground there is nothing to own, but the rest of the method stands. An object that is not seen
while another lies over it is occluded: it goes on as predicted, but stays within its occluder's shell (SHELLS 2.3, case
III), and is held present for longer. Detections are given to those in sight first, near their predictions: were
everybody to choose within a whole shell, one missing detection would push a row of neighbours on to the next one's.

Equation 9's ``a`` is the filter's own gain here: a detected box's error is known, an owned pixel's is not.
"""

from __future__ import annotations

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


def match(bodies: Bodies, free: Free, p: ShellsParameters) -> Pairs:
    """(row, detection) pairs: those in sight choose first, then the lost, last the tentative."""
    items = bodies.items
    followed = [k for k, b in enumerate(items) if b.id != TENTATIVE and not b.lost]
    lost = [k for k, b in enumerate(items) if b.id != TENTATIVE and b.lost]
    tentative = [k for k, b in enumerate(items) if b.id == TENTATIVE]
    sure = free.scores >= p.start_score
    out: Pairs = []
    for who, which in ((followed, sure), (followed, ~sure), (lost, sure), (tentative, sure)):
        done = dict(out)
        stage = [k for k in who if k not in done]
        columns = np.setdiff1d(np.flatnonzero(which), list(done.values()))
        if stage and len(columns):
            pairs = _near(bodies, np.array(stage, np.intp), free.boxes[columns], p)
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
