"""Pieces of a mask that belong to one body, taken together.

Where a body has the background's colours its region of the mask falls into pieces. Pieces are
one body's as long as they lie close and together are no larger than a body usually is at that
place: two bodies that pass one another are not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob
from recorders.pictures import Image
from recorders.segmentation.blobs import Labels, components, numbered
from recorders.segmentation.segmenter import as_image
from recorders.segmentation.usual import UsualSize
from recorders.vision import cv2

Floats = NDArray[np.float64]

GAP = 0.25
"""Between pieces lies at most this, of the usual width."""
REACH = 1.4
"""Together they are at most so many usual widths wide and usual heights high."""
WITHIN = 1.02
"""What lies beside a large piece and makes it no larger belongs to it, and what lies above or below
a wide one and is no higher with it than a body: a cyclist's upper half and his legs.
"""
SPECK = 0.01
"""A piece has at least this share of the usual area."""
THIN = 0.15
"""A small piece is thin under this, of the usual width: a streak of shadow, a wire, a speck."""
THIN_PART = 0.1
"""What is thinner than this does not count for the size of a body: a tail, a shadow at its feet."""
THIN_TURNING = 0.15
"""Bodies that turn have no usual width: there it is this, of the root of the usual area."""
SMALL = 0.2
"""A piece is small under this share of the usual area."""
LEAST = 0.4
"""A body has at least this share of the usual area,"""
LEAST_GOING_ON = 0.1
"""or this one, where it mostly lies on foreground of the frame before: it steps behind a post."""
REACHES = (0.6, 0.75)
"""A body that is hardly seen has this share of the usual width and height."""
MOST_PIECES = 64
"""Of more pieces in a frame the largest are kept."""
SIZE_WEIGHT = 0.2
"""Close pieces go together first; of equally close ones the smaller."""


@dataclass(frozen=True)
class PieceGroup:
    """One body's pieces.

    Attributes:
        box: x1, y1, x2, y2, px.
        area: of the pieces, px.
        pieces: their rows, in the order of joining.
    """

    box: tuple[float, float, float, float]
    area: float
    pieces: tuple[int, ...]


def together(pieces: Floats, usual: UsualSize) -> list[PieceGroup]:
    """Group the pieces of one frame into bodies, the closest ones first (ties: the first rows).

    Args:
        pieces: (N, 5) x, y, w, h, area.
        usual: how large bodies are.

    Returns:
        The groups by their first pieces.
    """
    x, y, w, h, area = pieces.T
    box = np.stack([x, y, x + w, y + h], axis=1)
    members: list[tuple[int, ...]] = [(k,) for k in range(len(pieces))]
    area = area.copy()
    while len(box) > 1:
        cost = _costs(box, area, usual)
        k = int(cost.argmin())
        i, j = divmod(k, len(box))
        if not np.isfinite(cost[i, j]):
            break
        box[i, :2] = np.minimum(box[i, :2], box[j, :2])
        box[i, 2:] = np.maximum(box[i, 2:], box[j, 2:])
        area[i] += area[j]
        members[i] += members.pop(j)
        box, area = np.delete(box, j, axis=0), np.delete(area, j)
    return [
        PieceGroup((x1, y1, x2, y2), a, member)
        for (x1, y1, x2, y2), a, member in zip(
            box.tolist(), area.tolist(), members, strict=True
        )
    ]


def _costs(box: Floats, area: Floats, usual: UsualSize) -> Floats:
    """What joining each pair costs, (N, N): infinite for those that do not belong together, and
    for all but i < j.
    """
    low = np.minimum(box[:, None, :2], box[:, :2])
    high = np.maximum(box[:, None, 2:], box[:, 2:])
    gap = np.maximum(
        np.maximum(box[:, None, :2], box[:, :2]) - np.minimum(box[:, None, 2:], box[:, 2:]),
        0.0,
    )
    w, h, _ = usual.at(high[..., 1])
    most = np.stack([w, h], axis=-1)
    size = high - low
    own = box[:, 2:] - box[:, :2]
    reached = size <= REACH * most
    within = size <= WITHIN * np.maximum(own[:, None], own)
    fits = reached.all(axis=-1) | within.all(axis=-1)
    if usual.halves:
        fits |= (reached | within).all(axis=-1)
    fits &= (gap <= np.array((GAP, usual.gap)) * most).all(axis=-1)
    fits &= np.arange(len(box))[:, None] < np.arange(len(box))
    if usual.turning:
        fits &= area[:, None] + area <= REACH * usual.at(high[..., 1])[2]
    cost = (gap / most).sum(axis=-1) + SIZE_WEIGHT * (size / most).max(axis=-1)
    return np.where(fits, cost, np.inf)


def bodies_of(
    mask: Image,
    usual: UsualSize,
    before: Image | None,
    upright: bool = True,
    weak: Image | None = None,
) -> tuple[Image, Labels, list[Blob]]:
    """The bodies in a mask, each as one component: thin parts are taken off, pieces are tied
    together, what is too small is left out.

    Args:
        mask: (H, W) uint8, 0 or 255.
        usual: how large bodies are.
        before: the mask that this gave for the frame before.
        upright: bodies are upright people, whose limbs are a part of their size. Otherwise thin
            parts of bodies are taken off, too: tails, strands of shadow.
        weak: as ``mask``, also where the evidence is weak: in clothes like the wall.

    Returns:
        Mask, labels and blobs, as `recorders.segmentation.blobs.components` gives them.
    """
    pieces = pieces_in(without_thin(mask, usual, THIN, SMALL), usual)
    clean = np.zeros_like(mask)
    for group in together(pieces.rows, usual):
        own = [pieces.part(piece) for piece in group.pieces]
        least = float(usual.at(np.array(group.box[3]))[2])
        goes_on = before is not None and group.area >= LEAST_GOING_ON * least
        if group.area < LEAST * least and not (
            goes_on and before is not None and _goes_on(own, before)
        ):
            faint = None if weak is None else _faint(group, usual, weak)
            if faint is None:
                continue
            own = [faint]
        if not upright:
            own = _solid(own, _thin(usual, group.box[3]))
        for part in own:
            part.paint(clean)
        _tie(own, clean)
    return components(clean, 1)


@dataclass(frozen=True)
class Part:
    """A piece's pixels, (h, w) uint8, 0 or 1, and where they lie in the picture, px."""

    pixels: Image
    x: int
    y: int

    @property
    def within(self) -> tuple[slice, slice]:
        """Where in the picture it lies."""
        h, w = self.pixels.shape
        return slice(self.y, self.y + h), slice(self.x, self.x + w)

    def paint(self, mask: Image) -> None:
        """Set its pixels to 255."""
        cv2.copyTo(np.full_like(self.pixels, 255), self.pixels, mask[self.within])

    def points(self) -> NDArray[np.int64]:
        """(N, 2) x, y of its pixels in the picture."""
        places = np.argwhere(self.pixels)[:, ::-1].astype(np.int64)
        return places + np.array([self.x, self.y], np.int64)


@dataclass(frozen=True)
class Pieces:
    """A mask's pieces that are worth looking at.

    Attributes:
        rows: (N, 5) x, y, w, h, area, px.
    """

    rows: Floats
    _labels: Labels
    _numbers: NDArray[np.int64]
    _left: int
    _top: int

    def part(self, row: int) -> Part:
        """One of them."""
        x, y, w, h = map(int, self.rows[row, :4].tolist())
        left, top = x - self._left, y - self._top
        own = self._labels[top : top + h, left : left + w] == self._numbers[row]
        return Part(own.view(np.uint8), x, y)


def pieces_in(mask: Image, usual: UsualSize) -> Pieces:
    """The mask's pieces, without specks, in the order of their labels."""
    labels, left, top, rows = numbered(mask)
    area = usual.at(rows[:, 1] + rows[:, 3])[2]
    kept = np.flatnonzero(rows[:, 4] >= np.maximum(2.0, SPECK * area))
    if len(kept) > MOST_PIECES:
        few = np.argsort(-rows[kept, 4], kind="stable")[:MOST_PIECES]
        kept = np.sort(kept[few])
    return Pieces(rows[kept], labels, kept + 1, left, top)


def without_thin(
    mask: Image, usual: UsualSize, thin: float = THIN_PART, small: float = np.inf
) -> Image:
    """A mask without what is thin against a body, and without specks.

    Args:
        mask: (H, W) uint8, 0 or 255.
        usual: how large bodies are.
        thin: of the usual width.
        small: of the usual area; larger pieces keep their thin parts.
    """
    pieces = pieces_in(mask, usual)
    kept = np.zeros_like(mask)
    width, _, area = usual.at(pieces.rows[:, 1] + pieces.rows[:, 3])
    sides = np.rint(np.where(pieces.rows[:, 4] < small * area, thin * width, 0.0))
    for k, side in enumerate(sides.astype(np.int64).tolist()):
        part = pieces.part(k)
        (_thick(part, side) if side > 1 else part).paint(kept)
    return kept


def _thick(part: Part, side: int) -> Part:
    """A part without what is thinner than ``side`` px."""
    around = cv2.copyMakeBorder(
        part.pixels, side, side, side, side, cv2.BORDER_CONSTANT, value=0
    )
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    thick = as_image(cv2.morphologyEx(around, cv2.MORPH_OPEN, kernel))
    return Part(thick[side:-side, side:-side], part.x, part.y)


def _thin(usual: UsualSize, foot: float) -> float:
    """What is thinner than so many px is no part of a body that is not upright: a tail."""
    width, _, area = (float(v) for v in usual.at(np.array(foot)))
    return THIN_TURNING * math.sqrt(area) if usual.turning else THIN_PART * width


def _solid(parts: list[Part], thin: float) -> list[Part]:
    """A body's parts without what is thinner than so many px; as they are where all of it is."""
    side = round(thin)
    if side < 2:
        return parts
    found = []
    for part in parts:
        thick = _thick(part, side)
        labels, left, top, rows = numbered(thick.pixels)
        for k, (x, y, w, h) in enumerate(rows[:, :4].astype(np.int64).tolist()):
            own = labels[y - top : y - top + h, x - left : x - left + w] == k + 1
            found.append(Part(own.view(np.uint8), part.x + x, part.y + y))
    return found or parts


def _faint(group: PieceGroup, usual: UsualSize, weak: Image) -> Part | None:
    """All that can be seen of a body in clothes like the wall: the weak evidence between pieces
    that lie as far apart as a body reaches; None where they do not, or it is too little.
    """
    x1, y1, x2, y2 = group.box
    w, h, area = (float(v) for v in usual.at(np.array(y2)))
    if x2 - x1 < REACHES[0] * w or y2 - y1 < REACHES[1] * h:
        return None
    inside = weak[int(y1) : int(y2), int(x1) : int(x2)]
    if np.count_nonzero(inside) < LEAST * area:
        return None
    return Part((inside > 0).view(np.uint8), int(x1), int(y1))


def _goes_on(parts: list[Part], before: Image) -> bool:
    """Whether most of the pieces lies on foreground of the frame before."""
    area = sum(int(np.count_nonzero(part.pixels)) for part in parts)
    shared = sum(
        int(np.count_nonzero((part.pixels > 0) & (before[part.within] > 0)))
        for part in parts
    )
    return 2 * shared >= area


def _tie(parts: list[Part], mask: Image) -> None:
    """Paint a line from each piece to the nearest one that is tied already, beginning with the
    largest.
    """
    if len(parts) < 2:
        return
    points = [part.points() for part in parts]
    loose = sorted(range(len(parts)), key=lambda k: (-len(points[k]), k))
    tied = points[loose.pop(0)]
    while loose:
        ends = [_nearest(tied, points[k]) for k in loose]
        k = min(range(len(loose)), key=lambda i: ends[i][0])
        _, a, b = ends[k]
        cv2.line(mask, a, b, 255, 1)
        tied = np.concatenate([tied, points[loose.pop(k)]])


def _nearest(
    a: NDArray[np.int64], b: NDArray[np.int64]
) -> tuple[int, tuple[int, int], tuple[int, int]]:
    """Squared distance and places of two near points of two pieces: the point of ``b`` nearest to
    ``a``'s centre, the one of ``a`` nearest to that, and the one of ``b`` nearest to that.
    """
    q = b[int(((b - a.mean(axis=0).round().astype(np.int64)) ** 2).sum(axis=1).argmin())]
    p = a[int(((a - q) ** 2).sum(axis=1).argmin())]
    square = ((b - p) ** 2).sum(axis=1)
    k = int(square.argmin())
    return int(square[k]), (int(p[0]), int(p[1])), (int(b[k][0]), int(b[k][1]))
