"""From a network's output tensors to boxes, scores and classes: one pure function for each family.

All give corners (N, 4) x1, y1, x2, y2 in px of the network's input. A place of a grid, or a query,
shows the class that it holds most likely, and no other.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
Size = tuple[int, int]

STRIDES = (8, 16, 32)
STRIDES_OF_FOUR = (8, 16, 32, 64)
YOLOX_OFFSET = 8.0
"""YOLOX networks that leave decoding to others give offsets within a few cells; places in px have
their median in the middle of the picture."""
RELATIVE = 2.0
"""Places are shares of the input where none is over this."""
SUMS_TO_ONE = 0.01
BINS = 8
"""NanoDet tells each side's distance as a distribution over this many bins."""


class Decoded(NamedTuple):
    """What a network found: corners (N, 4), scores (N,) in [0, 1], classes (N,) from 0."""

    corners: Floats
    scores: Floats
    classes: Rows


def yolov5(rows: Floats, size: Size, least: float) -> Decoded:
    """YOLOv5, v6 and v7: (A, 5 + C) centre, size, objectness, classes; score = objectness * class.

    Args:
        rows: the output, float64.
        size: width and height of the network's input, px.
        least: smallest score.
    """
    return _taken(_scaled(rows[:, :4], size), rows[:, 5:] * rows[:, 4:5], least)


def yolov8(columns: Floats, size: Size, least: float, classes: int = 0) -> Decoded:
    """YOLOv8, v9, 11 and 12: (4 + C, A) centre, size, classes.

    ``classes`` says how many of the rows after the fourth are classes (0: all); what follows them
    are masks or key points.
    """
    rows = columns.T
    end = 4 + classes if classes else rows.shape[1]
    return _taken(_scaled(rows[:, :4], size), rows[:, 4:end], least)


def yolox(rows: Floats, size: Size, least: float) -> Decoded:
    """YOLOX: (A, 5 + C) as YOLOv5, its places offsets from their cells where it leaves that to
    others: centre = (cell + offset) * stride, size = exp(.) * stride.
    """
    boxes = rows[:, :4]
    if len(boxes) and float(np.median(np.abs(boxes[:, :2]))) <= YOLOX_OFFSET:
        cells, strides = grid(size, STRIDES)
        boxes = np.concatenate(
            [
                (boxes[:, :2] + cells) * strides[:, None],
                np.exp(np.minimum(boxes[:, 2:], 20.0)) * strides[:, None],
            ],
            axis=1,
        )
    return _taken(boxes, rows[:, 5:] * rows[:, 4:5], least)


def end_to_end(rows: Floats, size: Size, least: float) -> Decoded:
    """YOLOv10, 26 and exports with suppression inside: (Q, 6) corners, score, class; or YOLOv7's
    (Q, 7) picture, corners, class, score.
    """
    if rows.shape[1] == 7:
        rows = rows[:, [1, 2, 3, 4, 6, 5]]
    good = np.flatnonzero(rows[:, 4] >= least)
    corners = _scaled(rows[:, :4], size)[good]
    return _sound(corners, rows[good, 4], rows[good, 5])


def detr_rows(rows: Floats, size: Size, least: float) -> Decoded:
    """RT-DETR in one output: (Q, 4 + C) centre and size as shares of the input, classes."""
    return detr(rows[:, :4], rows[:, 4:], size, least)


def detr(boxes: Floats, classes: Floats, size: Size, least: float) -> Decoded:
    """DETR kinds: (Q, 4) centre and size as shares of the input, (Q, C) classes as probabilities or
    as logits: of one class against the others where the last means "nothing" (DETR itself), else
    of each class for itself.
    """
    if classes.size and (classes.min() < 0 or classes.max() > 1):
        nothing = classes.shape[1] in (22, 92)
        classes = softmax(classes)[:, :-1] if nothing else sigmoid(classes)
    return _taken(_scaled(boxes, size), classes, least)


def labelled(
    boxes: Floats, scores: Floats, labels: Floats, size: Size, least: float
) -> Decoded:
    """Torchvision, SSD, and RT-DETR and D-FINE with their own last step: (N, 4) corners in px or as
    shares of the input, (N,) scores, (N,) classes.
    """
    good = np.flatnonzero(scores >= least)
    return _sound(_scaled(boxes, size)[good], scores[good], labels[good])


def upright_first(boxes: Floats) -> Floats:
    """Corners y1, x1, y2, x2, as TensorFlow has them, to x1, y1, x2, y2."""
    return boxes[:, [1, 0, 3, 2]]


def ssd_rows(rows: Floats, size: Size, least: float) -> Decoded:
    """SSD's (N, 7): picture, class, score, corners."""
    return labelled(rows[:, 3:], rows[:, 2], rows[:, 1], size, least)


def ssd_anchors(boxes: Floats, classes: Floats, size: Size, least: float) -> Decoded:
    """SSD without suppression: (A, 4) corners, (A, C) classes; where they sum to 1 the first is
    the ground.
    """
    if len(classes) and float(np.median(np.abs(classes.sum(axis=1) - 1))) < SUMS_TO_ONE:
        classes = classes[:, 1:]
    return _taken(_from_corners(_scaled(boxes, size)), classes, least)


def fastestdet(planes: Floats, size: Size, least: float) -> Decoded:
    """FastestDet: (5 + C, gh, gw); score = objectness^.6 * class^.4, centre = (cell + tanh) / grid,
    size = sigmoid.
    """
    high, wide = planes.shape[1:]
    across, down = np.meshgrid(np.arange(wide), np.arange(high))
    boxes = np.stack(
        [
            (across + np.tanh(planes[1])) / wide * size[0],
            (down + np.tanh(planes[2])) / high * size[1],
            sigmoid(planes[3]) * size[0],
            sigmoid(planes[4]) * size[1],
        ],
        axis=-1,
    )
    scores = np.maximum(planes[0], 0) ** 0.6 * np.maximum(planes[5:], 0) ** 0.4
    return _taken(
        boxes.reshape(-1, 4), scores.transpose(1, 2, 0).reshape(-1, len(scores)), least
    )


def nanodet(rows: Floats, size: Size, least: float) -> Decoded:
    """NanoDet: (A, C + 4 * 8); each side's distance from the place is the mean of a softmax over
    8 bins, in cells. NanoDet-Plus (four strides) measures from a cell's corner, the first NanoDet
    (three) from its middle.
    """
    strides = STRIDES_OF_FOUR if len(rows) == cells_of(size, STRIDES_OF_FOUR) else STRIDES
    cells, per_row = grid(size, strides)
    middle = 0.0 if strides == STRIDES_OF_FOUR else 0.5
    classes, sides = rows[:, : -4 * BINS], rows[:, -4 * BINS :]
    if classes.size and (classes.min() < 0 or classes.max() > 1):
        classes = sigmoid(classes)
    share = softmax(sides.reshape(-1, 4, BINS))
    distance = (share * np.arange(BINS)).sum(axis=2) * per_row[:, None]
    places = (cells + middle) * per_row[:, None]
    corners = np.concatenate([places - distance[:, :2], places + distance[:, 2:]], axis=1)
    return _taken(_from_corners(corners), classes, least)


def cells_of(size: Size, strides: Sequence[int] = STRIDES) -> int:
    """How many cells the grids of some strides have in an input.

    >>> cells_of((640, 640)), cells_of((416, 416), STRIDES_OF_FOUR)
    (8400, 3598)
    """
    return sum(-(-size[0] // stride) * -(-size[1] // stride) for stride in strides)


def grid(size: Size, strides: Sequence[int]) -> tuple[Floats, Floats]:
    """Column and row (A, 2) of every cell, and its stride (A,): grid after grid, row by row."""
    places, lengths = [], []
    for stride in strides:
        across, down = np.meshgrid(
            np.arange(-(-size[0] // stride)), np.arange(-(-size[1] // stride))
        )
        places.append(np.stack([across, down], axis=-1).reshape(-1, 2))
        lengths.append(np.full(across.size, float(stride)))
    return np.concatenate(places).astype(np.float64), np.concatenate(lengths)


def sigmoid(x: Floats) -> Floats:
    """1 / (1 + exp(-x))."""
    return np.asarray(1 / (1 + np.exp(-np.clip(x, -60.0, 60.0))))


def softmax(x: Floats) -> Floats:
    """Shares of the last axis."""
    e = np.exp(x - x.max(axis=-1, keepdims=True))
    return np.asarray(e / e.sum(axis=-1, keepdims=True))


def _scaled(places: Floats, size: Size) -> Floats:
    """Places (N, 4) in px; where none is over `RELATIVE` they are shares of the input."""
    if len(places) and float(np.abs(places).max()) > RELATIVE:
        return places
    return places * np.array([*size, *size], np.float64)


def _from_corners(corners: Floats) -> Floats:
    size = corners[:, 2:] - corners[:, :2]
    return np.concatenate([corners[:, :2] + size / 2, size], axis=1)


def _taken(boxes: Floats, classes: Floats, least: float) -> Decoded:
    """Centres and sizes (N, 4) with each one's likeliest class, from a score on."""
    if not classes.size:
        return Decoded(np.zeros((0, 4)), np.zeros(0), np.zeros(0, np.intp))
    best = classes.argmax(axis=1)
    scores = classes[np.arange(len(best)), best]
    good = np.flatnonzero(scores >= least)
    chosen = boxes[good]
    corners = np.concatenate(
        [chosen[:, :2] - chosen[:, 2:] / 2, chosen[:, :2] + chosen[:, 2:] / 2], axis=1
    )
    return _sound(corners, scores[good], best[good])


def _sound(corners: Floats, scores: Floats, classes: Floats | Rows) -> Decoded:
    """Without boxes of no size and numbers that are none; scores in [0, 1]."""
    numbers = np.concatenate(
        [corners, scores[:, None], np.asarray(classes, np.float64)[:, None]], axis=1
    )
    good = np.isfinite(numbers).all(axis=1) & (classes >= 0)
    good &= (corners[:, 2:] > corners[:, :2]).all(axis=1) & (np.abs(corners) < 1e6).all(
        axis=1
    )
    return Decoded(
        corners[good],
        np.clip(scores[good], 0.0, 1.0),
        np.asarray(classes)[good].astype(np.intp),
    )
