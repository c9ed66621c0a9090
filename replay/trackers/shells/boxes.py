"""Boxes without pixels: whose detection is whose, and who is hidden behind whom, by predictions
and shells alone.

Where a scene has no foreground there is nothing to own, but the rest of the method stands. An
object that is not seen while another lies over it is occluded: it goes on as predicted, but stays
within its occluder's shell (SHELLS 2.3, case III), and is held present for longer. Detections are
given to those in sight first, near their predictions: were everybody to choose within a whole
shell, one missing detection would push a row of neighbours on to the next one's.

Equation 9's ``a`` is the filter's own gain here: a detected box's error is known, an owned
pixel's is not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
from numpy.typing import NDArray

from replay.trackers.association import assign, intersection, iou, sizes_of
from replay.trackers.belief import LIKELY
from replay.trackers.life import TENTATIVE
from replay.trackers.shells.births import Free
from replay.trackers.shells.colours import colours_in, distance
from replay.trackers.shells.objects import NOBODY, Bodies
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Pairs = list[tuple[int, int]]

_GATE = 4.0
"""Furthest innovation that is associated, standard deviations."""
_OVERLAP = 0.2
"""Least IoU of a detection with the box that was predicted."""

_RESIZED = 0.7
"""Largest change of area (log) of one who is found again where nobody else is."""

_STRANGER = 0.4
"""Distance of colours of two who have nothing to do with one another, usually."""


class BoxColours:
    """The colours of detections, looked at when somebody asks: of the ellipse within the box,
    where the body is.
    """

    def __init__(self, boxes: Floats, picture: Callable[[], Image | None] | None) -> None:
        self._boxes, self._picture = boxes, picture
        self.blind = picture is None
        self._known: dict[int, Floats | None] = {}

    def of(self, column: int) -> Floats | None:
        """A detection's histogram; None without pictures, or where hardly a pixel of it is in the
        picture.
        """
        if column not in self._known:
            image = None if self._picture is None else self._picture()
            self._known[column] = colours_in(self._boxes[column].tolist(), image)
        return self._known[column]


def match(
    bodies: Bodies, free: Free, looks: BoxColours, parameters: ShellsParameters
) -> Pairs:
    """(row, detection) pairs: those in sight choose first, then the lost, last the tentative."""
    items = bodies.items
    followed = [
        index for index, item in enumerate(items) if item.id != TENTATIVE and not item.lost
    ]
    lost = [row for row, item in enumerate(items) if item.id != TENTATIVE and item.lost]
    tentative = [row for row, item in enumerate(items) if item.id == TENTATIVE]
    sure = free.scores >= LIKELY
    out: Pairs = []
    left = np.ones(len(free.boxes), bool)
    near = partial(_near, looks=looks, parameters=parameters)
    for who, which, choose in (
        (followed, sure, near),
        (followed, ~sure, near),
        (followed, sure, _only),
        (lost, sure, near),
        (tentative, sure, near),
    ):
        done = dict(out)
        stage = [row for row in who if row not in done]
        columns = np.flatnonzero(which & left)
        if stage and len(columns):
            pairs = choose(bodies, np.array(stage, np.intp), free.boxes[columns], columns)
            out += [(stage[i], int(columns[j])) for i, j in pairs]
            left[[column for _, column in out]] = False
    return out


def _near(
    bodies: Bodies,
    rows: Rows,
    boxes: Floats,
    columns: Rows,
    looks: BoxColours,
    parameters: ShellsParameters,
) -> Pairs:
    """Pairs near the predictions, (index of row, index of box)."""
    bank = bodies.bank
    noise = parameters.box_noise * sizes_of(boxes)
    away = boxes[:, :2] + boxes[:, 2:] / 2 - bank.value[rows, None, :2]
    distance2 = (
        away * away / (bank.p00[rows, None, :2] + (noise * noise)[None, :, None])
    ).sum(axis=2)
    overlap = iou(bodies.boxes[rows], boxes)
    allowed = (distance2 <= _GATE * _GATE) & (overlap >= _OVERLAP)
    cost = 1.0 - overlap + distance2 / (_GATE * _GATE)
    return assign(
        cost + parameters.box_colour * _strange(bodies, rows, columns, allowed, looks),
        allowed,
    )


def _strange(
    bodies: Bodies, rows: Rows, columns: Rows, allowed: NDArray[np.bool_], looks: BoxColours
) -> Floats:
    """Hellinger distances of colours where pairs compete, 0 elsewhere: places decide where they
    can.
    """
    out = np.zeros(allowed.shape)
    if looks.blind:
        return out
    rivals = (allowed.sum(axis=1, keepdims=True) > 1) | (
        allowed.sum(axis=0, keepdims=True) > 1
    )
    for i, j in np.argwhere(allowed & rivals).tolist():
        mine = bodies.items[rows[i]].colours
        theirs = None if mine is None else looks.of(int(columns[j]))
        # Who is not known is as far as strangers usually are, so that it wins nothing by that.
        out[i, j] = _STRANGER if mine is None or theirs is None else distance(mine, theirs)
    return out


def learn(
    bodies: Bodies,
    taken: Mapping[int, int],
    free: Free,
    looks: BoxColours,
    due: bool,
) -> None:
    """Learn from {detection: row}, where no other detection is near: how who was in sight moves,
    and its colours.
    """
    if not taken:
        return
    columns = sorted(taken)
    rows = np.array([taken[c] for c in columns], np.intp)
    near = np.count_nonzero(intersection(free.boxes[columns], free.boxes) > 0, axis=1) > 1
    steady = np.array(
        [b.id != TENTATIVE and b.mode == "motion" for b in (bodies.items[k] for k in rows)],
        bool,
    )
    found = free.boxes[columns]
    sure = free.scores[columns] >= LIKELY
    if bodies.manner is not None:
        bodies.manner.see(
            rows, found[:, :2] + found[:, 2:] / 2, sizes_of(found), steady & sure & ~near
        )
    if looks.blind:
        return
    for column, row, telling in zip(
        columns, rows.tolist(), (steady & sure & ~near).tolist(), strict=True
    ):
        body = bodies.items[row]
        seen = looks.of(column) if telling and (due or body.colours is None) else None
        if seen is not None:
            body.learn_colours(seen)


def _only(bodies: Bodies, rows: Rows, boxes: Floats, columns: Rows) -> Pairs:  # noqa: ARG001
    """Pairs within a minimum shell without a rival: no other detection, and nobody else, is left
    unmatched in it.

    Whoever turns back abruptly is off its prediction, yet nobody else can be there.
    """
    bank = bodies.bank
    away = boxes[:, :2] + boxes[:, 2:] / 2 - bank.value[rows, None, :2]
    smallest = bodies.radii(0.0)[rows]
    inside = (away * away).sum(axis=2) <= (smallest * smallest)[:, None]
    area = bank.value[rows, 2] * bank.value[rows, 3]
    ratio = np.log(
        np.maximum(area, 1.0)[:, None] / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)
    )
    alone = (
        inside
        & (inside.sum(axis=1, keepdims=True) == 1)
        & (inside.sum(axis=0, keepdims=True) == 1)
    )
    return [(int(i), int(j)) for i, j in np.argwhere(alone & (np.abs(ratio) <= _RESIZED))]


def hide(bodies: Bodies, parameters: ShellsParameters) -> None:
    """An object that is not seen while another, that is, lies over it, is behind that one."""
    items = bodies.items
    seen = [
        index for index, item in enumerate(items) if item.id != TENTATIVE and item.observed
    ]
    boxes = bodies.boxes
    for row, body in enumerate(items):
        if body.id == TENTATIVE or body.observed or not seen:
            continue
        if any(items[k].id == body.front for k in seen):
            continue
        mine = boxes[row : row + 1]
        cover = intersection(mine, boxes[seen])[0] / max(
            1.0, float(mine[0, 2] * mine[0, 3])
        )
        best = int(np.argmax(cover))
        body.front = (
            items[seen[best]].id if cover[best] >= parameters.hidden_cover else NOBODY
        )
