"""Foreground explained by boxes of known size, one at a time.

A box explains well if it is full of foreground, and the ring around it, above all the strips
above the head and under the feet, are empty. The best box takes its pixels away, and the rest is
explained by the next one: who stands in front is seen whole and goes first. Boxes that do not
meet are independent of one another, so each round takes every box that is the best of all that it
meets. Everything is counted in integral images, over all boxes at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.sizes import SizeModel
from recorders.vision import cv2

Floats: TypeAlias = NDArray[np.float64]
Ints: TypeAlias = NDArray[np.int64]
Integral: TypeAlias = NDArray[np.int32]

# Weights of the score, all relative to the box's own foreground, and found on people walking in
# two recordings.
RING, RING_WEIGHT = (
    0.35,
    0.7,
)  # width of the ring, of the box's width; what foreground in it costs
STRIP, STRIP_WEIGHT = (
    0.2,
    0.5,
)  # height of the strips above and under the box, of its width; what a full one costs
# what costs a box with as much foreground on its left as on its right: it sits between two bodies
BESIDE_WEIGHT = 0.4
EXPLAINED_WEIGHT = (
    0.25  # explained foreground inside speaks for a body behind another, a little
)

UNSEEN_WEIGHT = 0.5  # what lies outside the picture counts this much as empty

MIN_FILL = 0.3
"""Least share of a box that is foreground."""
MIN_OWN = 0.25
"""Least share of a box that is foreground which no earlier box explains."""
MIN_SCORE = 0.3
"""Least score of an explanation."""
FULL_SCORE = 0.65
"""The score of a body that stands alone: confidence 1."""
MIN_VISIBLE = 0.4
"""Least share of a box that lies in the picture."""
PREFER_LARGE = 0.25
"""Boxes are ranked by score * area ** this: a small box inside a body explains less than the
body's own.
"""
PROPOSAL_BONUS = 1.25
"""A proposal's score counts this much more than the size model's own boxes."""
GRID_X, GRID_Y = 0.2, 0.08
"""Distance of neighbouring boxes, of their width and of their height."""
ROUNDS = 8
MOST_BOXES = 300_000
"""Of more boxes in the grid, their distance grows until they are no more than this: bodies of a
few pixels in a large picture would take gigabytes."""


def integral_of(mask: Image) -> Integral:
    """Integral image (H + 1, W + 1) int32 of a mask (H, W) uint8; each non-zero pixel counts 1."""
    return cast(
        "Integral", cv2.integral(cv2.min(mask, np.ones_like(mask)), sdepth=cv2.CV_32S)
    )


def box_scores(integral: Integral, boxes: Floats) -> Floats:
    """How well each box explains the foreground, all on its own.

    Args:
        integral: (H + 1, W + 1) int32 as `integral_of` makes it.
        boxes: (N, 4) x, y, w, h in px; parts outside the picture do not count.

    Returns:
        (N,) float64, at most 1; `MIN_SCORE` and above is an explanation.
    """
    height, width = integral.shape[0] - 1, integral.shape[1] - 1
    return _Candidates(np.asarray(boxes, np.float64).reshape(-1, 4), width, height).scores(
        integral.ravel(), None
    )


@dataclass(frozen=True)
class BodiesExplanation:
    """Boxes that explain a mask.

    Attributes:
        boxes: (N, 4) float64 x, y, w, h in px, best of the first round first; they may reach out
            of the picture.
        scores: (N,) float64 in [0, 1], 1 for a body that stands alone.
        sources: (N,) int64, the row of the proposal that the box came from, -1 for one of the
            size model's own.
        rest: (H, W) uint8, 0 or 255: the foreground that no box explains.
    """

    boxes: Floats
    scores: Floats
    sources: Ints
    rest: Image


class Explainer:
    """Explains masks of one picture size; the size model's grid of boxes is laid out once.

    It keeps nothing from one mask to the next: `explain` is a pure function of its arguments.
    """

    def __init__(self, model: SizeModel, width: int, height: int) -> None:
        self.model = model
        self._width, self._height = width, height
        grid = _Candidates(_grid(model, width, height), width, height)
        self._grid = grid.take(np.flatnonzero(grid.visible >= MIN_VISIBLE))

    def explain(self, mask: Image, proposals: Floats | None = None) -> BodiesExplanation:
        """Explain a mask's foreground.

        Args:
            mask: (H, W) uint8, 0 or 255.
            proposals: (M, 4) boxes of any size that are expected, such as predictions of tracks;
                each is tried a little shifted and scaled, together with the size model's own
                boxes, and used at most once.
        """
        rest = mask.copy()
        explained = np.zeros_like(rest)
        own, behind = integral_of(rest).ravel(), None
        candidates, source = self._candidates(own, proposals)
        found: list[tuple[Floats, Floats, Ints]] = []
        for _ in range(ROUNDS):
            scores = candidates.scores(own, behind)
            fair = np.flatnonzero(scores >= 0.7 * MIN_SCORE)
            rank = scores[fair] * candidates.area[fair] ** PREFER_LARGE
            rank *= np.where(source[fair] >= 0, PROPOSAL_BONUS, 1.0)
            chosen = fair[_best_of_neighbours(candidates.boxes[fair], rank)]
            boxes, scores = self._refine(own, behind, candidates.boxes[chosen])
            good = scores >= MIN_SCORE
            if not good.any():
                break
            boxes, scores, chosen = boxes[good], scores[good], chosen[good]
            found.append((boxes, scores, source[chosen]))
            for x1, y1, x2, y2 in _pixels(boxes):
                part = np.s_[y1:y2, x1:x2]
                explained[part] |= rest[part]
                rest[part] = 0
            own, behind = integral_of(rest).ravel(), integral_of(explained).ravel()
            used = np.isin(source, source[chosen][source[chosen] >= 0])
            left = np.flatnonzero(
                (candidates.inside(own) >= MIN_OWN * candidates.area) & ~used
            )
            candidates, source = candidates.take(left), source[left]
        if not found:
            return BodiesExplanation(
                np.zeros((0, 4)), np.zeros(0), np.zeros(0, np.int64), rest
            )
        all_boxes, all_scores, sources = (
            np.concatenate(part) for part in zip(*found, strict=True)
        )
        return BodiesExplanation(
            all_boxes, np.clip(all_scores / FULL_SCORE, 0.0, 1.0), sources, rest
        )

    def _candidates(
        self, own: Integral, proposals: Floats | None
    ) -> tuple[_Candidates, Ints]:
        """The grid's boxes with enough foreground, and the proposals; with each the proposal's
        row or -1.
        """
        grid = self._grid.take(
            np.flatnonzero(self._grid.inside(own) >= MIN_FILL * self._grid.area)
        )
        source = np.full(len(grid.boxes), -1, np.int64)
        if proposals is None or not len(proposals):
            return grid, source
        moved = _Candidates(
            _neighbours(np.asarray(proposals, np.float64)), self._width, self._height
        )
        rows = np.repeat(np.arange(len(proposals)), len(_DX))
        keep = np.flatnonzero(moved.inside(own) >= MIN_OWN * moved.area)
        moved = moved.take(keep)
        both = _Candidates(
            np.concatenate([moved.boxes, grid.boxes]), self._width, self._height
        )
        return both, np.concatenate([rows[keep], source])

    def _refine(
        self, own: Integral, behind: Integral | None, boxes: Floats
    ) -> tuple[Floats, Floats]:
        """Shift and scale each box a little to where it scores best; the first of equals."""
        tried = _neighbours(boxes)
        candidates = _Candidates(tried, self._width, self._height)
        scores = candidates.scores(own, behind).reshape(len(boxes), len(_DX))
        best = np.argmax(scores * _SCALE ** (2 * PREFER_LARGE), axis=1)
        one = np.arange(len(boxes))
        return tried.reshape(len(boxes), len(_DX), 4)[one, best], scores[one, best]


class _Candidates:
    """Boxes with the flat indices of their corners, their rings' and their strips', in an
    integral image.
    """

    def __init__(self, boxes: Floats, width: int, height: int) -> None:
        self.boxes = boxes
        x, y, w, h = boxes.T
        ring, strip = RING * w, STRIP * w
        # Left and right ends, top and bottom ends, of the box, its ring, and its strips above,
        # under, left and right.
        xs = np.stack(
            [
                x,
                x - ring,
                x,
                x,
                x - strip,
                x + w,
                x + w,
                x + w + ring,
                x + w,
                x + w,
                x,
                x + w + strip,
            ]
        )
        ys = np.stack(
            [
                y,
                y - ring,
                y - strip,
                y + h,
                y,
                y,
                y + h,
                y + h + ring,
                y,
                y + h + strip,
                y + h,
                y + h,
            ]
        )
        (left, right), (top, bottom) = _ends(xs, width), _ends(ys, height)
        row = width + 1
        self._corners: Ints = np.stack(
            [bottom * row + right, top * row + right, bottom * row + left, top * row + left]
        )
        self._areas: Floats = np.maximum((right - left) * (bottom - top), 1).astype(
            np.float64
        )
        visible = (right[0] - left[0]) * (bottom[0] - top[0])
        self.visible: Floats = visible / np.maximum(w * h, 1.0)
        self._areas[0] += UNSEEN_WEIGHT * np.maximum(w * h - visible, 0.0)
        self.area: Floats = self._areas[0]

    def take(self, rows: Ints) -> _Candidates:
        """Some of the boxes."""
        some = object.__new__(_Candidates)
        some.boxes, some.visible = self.boxes[rows], self.visible[rows]
        some._corners, some._areas = self._corners[..., rows], self._areas[:, rows]
        some.area = some._areas[0]
        return some

    def inside(self, own: Integral) -> Ints:
        """Foreground pixels in each box."""
        return _sums(own, self._corners[:, 0])

    def scores(self, own: Integral, behind: Integral | None) -> Floats:
        """Each box's score; -1 where too little of it is foreground of its own.

        Args:
            own: flat integral image of the foreground that is still to be explained.
            behind: flat integral image of the explained foreground, if there is any.
        """
        inside, ringed, *strips = _sums(own, self._corners)
        above, under, left, right = strips / self._areas[2:]
        score = (inside - RING_WEIGHT * (ringed - inside)) / self.area
        if behind is not None:
            score += EXPLAINED_WEIGHT * _sums(behind, self._corners[:, 0]) / self.area
        score -= STRIP_WEIGHT * (above + under) + BESIDE_WEIGHT * np.minimum(left, right)
        return np.where(inside >= MIN_OWN * self.area, score, -1.0)


def _ends(places: Floats, size: int) -> tuple[Ints, Ints]:
    """Lower and upper ends, (12, N) px, as the nearest pixel borders in the picture: twice (6,
    N).
    """
    whole = np.minimum(np.maximum(np.rint(places), 0), size).astype(np.int64)
    return whole[:6], whole[6:]


def _sums(flat: Integral, corners: Ints) -> Ints:
    """Sums over boxes whose corners' flat indices are given, (4, ...) -> (...)."""
    a, b, c, d = flat.take(corners)
    total: Ints = (a - b - c + d).astype(np.int64)
    return total


def _pixels(boxes: Floats) -> list[tuple[int, int, int, int]]:
    """The pixels that `_Candidates` counts in each box: x1, y1, x2, y2, end excluded, not below
    0.
    """
    ends = np.stack(
        [boxes[:, 0], boxes[:, 1], boxes[:, 0] + boxes[:, 2], boxes[:, 1] + boxes[:, 3]],
        axis=1,
    )
    return [
        (x1, y1, x2, y2)
        for x1, y1, x2, y2 in np.maximum(np.rint(ends), 0).astype(np.int64).tolist()
    ]


_DX, _DY, _SCALE = (
    a.ravel()
    for a in np.meshgrid((0.0, -0.5, 0.5), (0.0, -0.5, 0.5), (1.0, 0.9, 1.1), indexing="ij")
)


def _neighbours(boxes: Floats) -> Floats:
    """Each box and 26 like it, shifted by half a grid step and scaled about the foot: (27 * N,
    4).
    """
    x, y, w, h = (boxes[:, k, None] for k in range(4))
    width, height = w * _SCALE, h * _SCALE
    left = x + w / 2 + _DX * GRID_X * w - width / 2
    top = y + h + _DY * GRID_Y * h - height
    return np.stack([left, top, width, height], axis=-1).reshape(-1, 4)


def _grid(model: SizeModel, width: int, height: int) -> Floats:
    """Boxes of bodies standing at every place, `GRID_X` widths and `GRID_Y` heights apart."""
    wider = 1.0
    while True:
        feet = _feet(model, height, wider)
        heights = model.heights(feet)
        steps = wider * np.maximum(1.0, GRID_X * model.aspect * heights)
        if (
            float(((width + 1.5 * model.aspect * heights) / steps + 1.0).sum())
            <= MOST_BOXES
        ):
            break
        wider *= 1.25
    rows: list[Floats] = []
    for foot, h, step in zip(feet.tolist(), heights.tolist(), steps.tolist(), strict=True):
        w = model.aspect * h
        x = np.arange(-w / 2, width + w, step)
        rows.append(model.boxes(x, np.full(len(x), foot)))
    return np.concatenate(rows) if rows else np.zeros((0, 4))


def _feet(model: SizeModel, height: int, wider: float) -> Floats:
    """Where rows of bodies stand, px from the top: until their heads are under the picture."""
    feet: list[float] = []
    foot = model.first_foot()
    while True:
        h = float(model.heights(np.array([foot]))[0])
        if foot - h > height:
            return np.array(feet, np.float64)
        feet.append(foot)
        foot += wider * max(1.0, GRID_Y * h)


def _best_of_neighbours(boxes: Floats, rank: Floats) -> Ints:
    """Rows of the boxes that rank higher than all boxes that they meet; the first row of equals."""
    order = np.argsort(-rank, kind="stable")
    x1, y1 = boxes[order, 0], boxes[order, 1]
    x2, y2 = x1 + boxes[order, 2], y1 + boxes[order, 3]
    chosen: list[int] = []
    free = np.ones(len(order), bool)
    while free.any():
        k = int(np.argmax(free))
        chosen.append(int(order[k]))
        free &= (x1 >= x2[k]) | (x2 <= x1[k]) | (y1 >= y2[k]) | (y2 <= y1[k])
        free[k] = False
    return np.array(chosen, np.int64)
