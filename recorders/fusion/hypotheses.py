"""A frame's hypotheses: the detector's boxes and the masks', each pair that is one body taken
together.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.detectors.suppression import overlaps, suppress
from recorders.messages import NO_BLOB, Box, Detections

Floats = NDArray[np.float64]

SAME_BODY = 0.35
"""From this intersection over union on a detector's box and one of the masks are one body."""
DOUBLE = 0.35
"""Boxes of one source that overlap by this are doubles, but for those of the masks, which are not
thinned out.
"""
HELD = 0.8
"""A box of the detector that lies in one of the masks with this share of it is held by it."""
BESIDE = 0.7
"""What a box of the masks has beside the bodies that it holds is another body from this share of
their width on.
"""
SCORE_STEPS = (0.4, 0.55, 0.7, 0.85)
"""Scores are told apart by these steps; what a step is worth is learnt from the recording."""
NOTHING = 0
"""The detector's step where it has no box; its boxes have the steps 1 to 5."""


@dataclass(frozen=True)
class Hypothesis:
    """Something that may be a body.

    Attributes:
        masked: the box that the masks gave, None without one.
        detected: the box that the detector gave, None without one.
        step: the detector's score by `SCORE_STEPS`, `NOTHING` without a box.
        score: the detector's score, 0 without a box.
        label: what the detector calls it.
        row, column: of the masks' detection and of the detector's, -1 without one.
    """

    masked: Box | None
    detected: Box | None
    step: int
    score: float
    label: str
    row: int
    column: int = -1

    @property
    def box(self) -> Box:
        """The masks' box, else the detector's."""
        box = self.masked or self.detected
        assert box is not None
        return box


def hypotheses(masked: Detections, detected: Detections) -> list[Hypothesis]:
    """A frame's hypotheses: those with a mask's box in its order, then the detector's own, best
    score first.
    """
    mine, theirs = corners_of(masked.boxes), corners_of(detected.boxes)
    scores = np.array([_score(detected, k) for k in range(len(theirs))], np.float64)
    alone = np.zeros(len(theirs), np.intp)
    kept = suppress(theirs, scores, alone, DOUBLE).tolist()
    overlap = overlaps(mine, theirs[kept])
    held = _held(mine, theirs[kept], scores[kept])
    overlap[held.sum(axis=1) >= 2] = 0.0  # several run together are nobody's place
    parts = [_beside(box, theirs[kept][held[row]]) for row, box in enumerate(masked.boxes)]
    divided = [row for row, box in enumerate(masked.boxes) if parts[row] != [box]]
    overlap[divided] = 0.0
    pairs = _pairs(overlap)
    made = []
    for row, box in enumerate(masked.boxes):
        column = pairs.get(row)
        if column is None:
            made += [_made(part, row, detected, None) for part in parts[row]]
        else:
            made.append(_made(box, row, detected, kept[column]))
    taken = list(pairs.values())
    rest = [
        k
        for column, k in enumerate(kept)
        if column not in taken and scores[k] >= SCORE_STEPS[0]
    ]
    return made + [_made(None, NO_BLOB, detected, k) for k in rest]


def corners_of(boxes: list[Box]) -> Floats:
    """(N, 4) x1, y1, x2, y2 of boxes x, y, w, h."""
    out = np.array(boxes, np.float64).reshape(-1, 4)
    out[:, 2:] += out[:, :2]
    return out


def covered_ones(found: list[Hypothesis]) -> list[int]:
    """Which of a frame's hypotheses only the detector has, within one that both sources have."""
    agreed = corners_of([h.box for h in found if h.masked and h.detected])
    alone = [k for k, h in enumerate(found) if h.masked is None]
    if not alone or not len(agreed):
        return []
    held = _within(corners_of([found[k].box for k in alone]), agreed).max(axis=1) >= HELD
    return [k for k, inside in zip(alone, held.tolist(), strict=True) if inside]


def _within(boxes: Floats, others: Floats) -> Floats:
    """(N, M) which share of each box (N, 4) lies in each of the others (M, 4)."""
    shared = shared_areas(boxes, others)
    return np.asarray(shared / np.maximum(areas_of(boxes), 1e-9)[:, None])


def shared_areas(boxes: Floats, others: Floats) -> Floats:
    """(N, M) the area that each of some boxes (N, 4) shares with each of others (M, 4), by corners."""
    low = np.maximum(boxes[:, None, :2], others[None, :, :2])
    high = np.minimum(boxes[:, None, 2:], others[None, :, 2:])
    return np.asarray(np.maximum(high - low, 0.0).prod(axis=2))


def areas_of(boxes: Floats) -> Floats:
    """(N,) areas of boxes (N, 4), by corners."""
    return np.asarray((boxes[:, 2:] - boxes[:, :2]).prod(axis=1))


def _score(detected: Detections, k: int) -> float:
    """A detection's score; boxes without one, or with one on another scale, were chosen."""
    score = detected.scores[k] if detected.scores else 1.0
    return score if 0 <= score <= 1 else 1.0


def _made(box: Box | None, row: int, detected: Detections, k: int | None) -> Hypothesis:
    if k is None:
        return Hypothesis(box, None, NOTHING, 0.0, "", row)
    score = _score(detected, k)
    label = detected.labels[k] if detected.labels else ""
    step = 1 + sum(score >= s for s in SCORE_STEPS)
    return Hypothesis(box, detected.boxes[k], step, score, label, row, k)


def _held(mine: Floats, theirs: Floats, scores: Floats) -> NDArray[np.bool_]:
    """(N, M) which of the masks' boxes hold which of the detector's."""
    held = shared_areas(mine, theirs) >= HELD * areas_of(theirs)
    return np.asarray(held & (scores >= SCORE_STEPS[1]))


def _beside(box: Box, held: Floats) -> list[Box]:
    """What a box of the masks has beside the bodies that it holds, left and right, (M, 4) corners,
    where that is as wide as a body; all of it where it is not.
    """
    if not len(held):
        return [box]
    x, y, w, h = box
    low, high = float(held[:, 0].min()), float(held[:, 2].max())
    least = BESIDE * float((held[:, 2] - held[:, 0]).mean())
    sides = ((x, low - x), (high, x + w - high))
    return [(left, y, width, h) for left, width in sides if width >= least] or [box]


def _pairs(overlap: Floats) -> dict[int, int]:
    """Rows and columns that are one body: the best overlap first, of equals the lower row, then
    column.
    """
    found: dict[int, int] = {}
    rows, columns = np.nonzero(overlap >= SAME_BODY)
    order = np.argsort(-overlap[rows, columns], kind="stable")
    used: list[int] = []
    for k in order.tolist():
        row, column = int(rows[k]), int(columns[k])
        if row not in found and column not in used:
            found[row] = column
            used.append(column)
    return found
