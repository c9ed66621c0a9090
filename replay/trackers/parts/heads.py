"""Head detection (PARTS 2.3): hair and skin colours, closing, ellipses registered to the top,
occupancy.

A pixel's colour is judged in XYZ and HSV by mixtures per category of hair and skin, combined as p
= w1 p_XYZ + w2 p_HSV with the highest category (eq. 3 to 6); the judgement is made once for 32
levels of each of blue, green and red, and looked up. Where colours say nothing (heads of eight
pixels, hats) the silhouette does: the tops of its outline are heads too, as everywhere in the
tracking literature that the paper cites.

Deviations: the mixtures' parameters are not fitted to annotated heads (the paper's training set
is not to be had) but set from the swatches below, one component each; each density is taken over
its highest value, so that one threshold serves all categories.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2

Bytes = NDArray[np.uint8]
Floats = NDArray[np.float64]
Colour = tuple[int, int, int]

# Red, green, blue of each category's components. Hair after the shades of the Fischer-Saller
# scale (A-L blond, M-T brown, U-Y black, I-VI red), skin after the von Luschan scale in three
# kinds of light.
HAIR: dict[str, tuple[Colour, ...]] = {
    "black": ((22, 20, 22), (44, 40, 42), (62, 58, 60)),
    "brown": ((78, 52, 36), (104, 74, 54), (66, 48, 40)),
    "blond": ((202, 166, 106), (222, 192, 140), (160, 126, 84)),
    "red": ((146, 70, 40), (172, 88, 48), (112, 54, 36)),
}
SKIN: dict[str, tuple[Colour, ...]] = {
    "bright": ((255, 224, 196), (240, 200, 170), (226, 184, 150)),
    "standard": ((224, 178, 148), (198, 146, 112), (164, 112, 80)),
    "dark": ((142, 94, 66), (112, 74, 52), (80, 54, 40)),
}
SPREAD_XYZ = (16.0, 16.0, 16.0)
SPREAD_HSV = (6.0, 36.0, 24.0)
"""Standard deviations of the components in 8-bit X, Y, Z and H (of 180), S, V."""
GREY_HUE_SPREAD = 60.0
"""Of H where a component is too grey for its hue to mean anything."""
W_XYZ, W_HSV = 0.5, 0.5
THRESHOLD = 0.25
_LEVELS = 32
HEAD = 1 / 7
_HEAD_W, _HEAD_H = 0.12, HEAD
"""A head's ellipse, of the body's height."""
_ELLIPSE = np.array([[0.7, 0.05, 0.2], [1.0, 0.2, 0.8], [0.7, 0.8, 0.95]])
"""An ellipse as three rectangles: width, top and bottom of each, of the head's."""
_ELLIPSE_AREA = float((_ELLIPSE[:, 0] * (_ELLIPSE[:, 2] - _ELLIPSE[:, 1])).sum())
_MIN_OCCUPANCY = 0.6
CLEAR_PX = 12.0
"""Least height of a head whose colours and image can be told from what is around it: below, the
silhouette alone.
"""
UPRIGHT = 1.5
"""Least height over width of who shows what colours heads have."""
_TOLD_FROM, _TELLING = 400, 1.5
"""So many pixels of heads have to be seen, and to be of such colours so many times as often as
bodies' are.
"""
_MIN_COLOURED, _MAX_BESIDE = 0.75, 0.5


@dataclass(frozen=True, slots=True)
class Head:
    """A head: x of its middle and y of its top in the picture, and a score in [0, 1]."""

    x: float
    y: float
    score: float


class HeadDetector(Protocol):
    """Finds heads. Another one can be given to the tracker: any callable of this shape that is a
    pure function.
    """

    def __call__(
        self, image: Bytes | None, mask: Bytes | None, box: Floats, height: float
    ) -> Sequence[Head]:
        """Heads in a part of the picture, best first.

        Args:
            image: the picture, (H, W, 3) uint8 BGR, or None.
            mask: its foreground, (H, W) uint8, 0 or 255, or None.
            box: (4,) x, y, w, h of the part to be searched, pixels.
            height: height of the bodies that are expected there, pixels.
        """
        ...


def likelihood(bgr: Bytes) -> Floats:
    """Highest likelihood over all categories of hair and skin, (P,) in [0, 1].

    Pixels are (P, 3) uint8 BGR; equations 3 to 6.
    """
    categories = [*HAIR.values(), *SKIN.values()]
    pixels = _in_both(bgr)
    best = np.zeros(len(bgr))
    for swatches in categories:
        xyz, hsv = _in_both(np.array(swatches, np.uint8)[:, ::-1])
        p_xyz, p_hsv = np.ones(len(bgr)), np.ones(len(bgr))
        for c in range(3):
            p_xyz *= _mixture(pixels[0][:, c], xyz[:, c], np.full(len(xyz), SPREAD_XYZ[c]))
            hue = c == 0
            spread = np.where((hsv[:, 1] < 50) & hue, GREY_HUE_SPREAD, SPREAD_HSV[c])
            p_hsv *= _mixture(pixels[1][:, c], hsv[:, c], spread, 180.0 if hue else 0.0)
        best = np.maximum(best, W_XYZ * p_xyz + W_HSV * p_hsv)
    return best


def _in_both(bgr: Bytes) -> tuple[Floats, Floats]:
    row = np.ascontiguousarray(bgr.reshape(1, -1, 3))
    xyz = cv2.cvtColor(row, cv2.COLOR_BGR2XYZ)[0].astype(np.float64)
    hsv = cv2.cvtColor(row, cv2.COLOR_BGR2HSV)[0].astype(np.float64)
    return xyz, hsv


def _mixture(at: Floats, means: Floats, spreads: Floats, turn: float = 0.0) -> Floats:
    """Equal Gaussians over their highest value at a mean; ``turn``: the channel is a circle of
    this length.
    """

    def density(x: Floats) -> Floats:
        away = np.abs(x[:, None] - means[None, :])
        if turn:
            away = np.minimum(away, turn - away)
        return np.asarray((np.exp(-0.5 * (away / spreads) ** 2) / spreads).sum(axis=1))

    return np.asarray(np.minimum(density(at) / density(means).max(), 1.0))


@lru_cache(maxsize=1)
def colour_table() -> Bytes:
    """Whether a colour is hair's or skin's, (32, 32, 32) uint8 0 or 1, by red, green and blue
    over 8.
    """
    levels = (np.arange(_LEVELS) * 8 + 4).astype(np.uint8)
    r, g, b = np.meshgrid(levels, levels, levels, indexing="ij")
    colours = np.stack([b.ravel(), g.ravel(), r.ravel()], axis=1)
    return (
        (likelihood(colours) > THRESHOLD)
        .astype(np.uint8)
        .reshape(_LEVELS, _LEVELS, _LEVELS)
    )


class HeadColours:
    """Whether the colours of hair and skin tell heads from bodies in this recording.

    The mixtures are set around published swatches and fit some recordings; on a street of brown
    coats they find heads everywhere. So they count for nothing once those who are alone have
    shown that such colours are hardly more frequent in heads than below them. (Ours.)
    """

    def __init__(self) -> None:
        self._counts = np.zeros((2, 2), np.int64)

    def take(self, head: Bytes, body: Bytes) -> None:
        """Count pixels (P, 3) uint8 BGR of heads and of bodies."""
        for row, bgr in enumerate((head, body)):
            at = (bgr >> 3).astype(np.intp)
            coloured = colour_table()[at[:, 2], at[:, 1], at[:, 0]]
            self._counts[row] += (int(coloured.sum()), len(bgr))

    @property
    def tell(self) -> bool:
        """Whether they do; yes as long as too little was seen to say."""
        (in_head, head), (in_body, body) = self._counts.tolist()
        return bool(
            head < _TOLD_FROM or in_head * body >= _TELLING * max(in_body, 1) * head
        )

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"counts": self._counts.copy()}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._counts = np.array(state["counts"], np.int64).reshape(2, 2)


def _crop(box: Floats, width: int, height: int) -> tuple[int, int, int, int]:
    x1, y1 = max(0, int(np.floor(box[0]))), max(0, int(np.floor(box[1])))
    x2, y2 = (
        min(width, int(np.ceil(box[0] + box[2]))),
        min(height, int(np.ceil(box[1] + box[3]))),
    )
    return x1, y1, x2, y2


class ColourShapeHeads:
    """The paper's detector by colour and ellipse, and the silhouette's tops.

    Args:
        colours: whether colours are asked; else the silhouette alone.
    """

    def __init__(self, colours: bool = True) -> None:
        self._colours = colours

    def __call__(
        self, image: Bytes | None, mask: Bytes | None, box: Floats, height: float
    ) -> list[Head]:
        """See `HeadDetector`."""
        if mask is None:
            return []
        x1, y1, x2, y2 = _crop(box, mask.shape[1], mask.shape[0])
        if x2 - x1 < 3 or y2 - y1 < 3:
            return []
        part = np.minimum(mask[y1:y2, x1:x2], np.uint8(1))
        found = tops(part, height)
        if self._colours and image is not None and height * HEAD >= CLEAR_PX:
            found += coloured(image[y1:y2, x1:x2], part, height)
        placed = [Head(h.x + x1, h.y + y1, h.score) for h in found]
        return _apart(placed, 0.5 * _HEAD_W * height * 2, 0.5 * _HEAD_H * height * 2)


def tops(part: Bytes, height: float) -> list[Head]:
    """Tops of a silhouette's outline: higher than everything within a head's width on both sides.

    Args:
        part: (H, W) uint8, 0 or 1.
        height: height of the bodies.

    Returns:
        Heads in the part's own pixels, from left to right; the score is the share of the ellipse
        under the top that is foreground.
    """
    rows = len(part)
    first = np.argmax(part, axis=0)
    first[(first == 0) & (part[0] == 0)] = rows
    reach = max(1, round(0.5 * _HEAD_W * height))
    around = np.ones((1, 2 * reach + 1), np.uint8)
    lowest = cv2.erode(
        first.astype(np.float32)[None],
        around,
        borderType=cv2.BORDER_CONSTANT,
        borderValue=float(rows),
    )
    peaks = np.flatnonzero((first == lowest[0]) & (first < rows)).tolist()
    # A plateau is one top, at its middle; a very long one is no head.
    found = [
        ((start + end) / 2, float(first[start]))
        for start, end in _runs(peaks)
        if end - start <= 4 * reach
    ]
    if not found:
        return []
    total = np.asarray(cv2.integral(part, sdepth=cv2.CV_32S), np.int32)
    x, y = np.array(found).T
    scores = _occupancy(total, x, y, height).tolist()
    return [
        Head(*top, score)
        for top, score in zip(found, scores, strict=True)
        if score >= _MIN_OCCUPANCY
    ]


def _runs(rising: Sequence[int]) -> list[tuple[int, int]]:
    """Runs of integers that follow one another, as first and one past the last."""
    out: list[tuple[int, int]] = []
    for k in rising:
        out.append((out.pop()[0] if out and out[-1][1] == k else k, k + 1))
    return out


def coloured(image: Bytes, part: Bytes, height: float) -> list[Head]:
    """Heads within a silhouette by the colours of hair and skin.

    Ellipses of a head's size are laid everywhere, two pixels apart; one is a head if it is full
    of such colours and the places beside and above it are not.
    """
    # Five bits of each of red, green and blue, the highest first.
    colours = cv2.cvtColor(image, cv2.COLOR_BGR2BGR555).view(np.uint16)[:, :, 0]
    hits = colour_table().take(colours) & part
    side = max(1, round(0.03 * height)) * 2 + 1
    closed = cv2.morphologyEx(hits, cv2.MORPH_CLOSE, np.ones((side, side), np.uint8))
    total = np.asarray(cv2.integral(closed, sdepth=cv2.CV_32S), np.int32)
    step = max(1, round(0.02 * height))
    middle_y, middle_x = np.nonzero(closed[::step, ::step])
    wide, high = _HEAD_W * height, _HEAD_H * height
    x: Floats = np.asarray(middle_x * step + 0.5, np.float64)
    y: Floats = np.asarray(middle_y * step + 0.5 - high / 2, np.float64)
    inside = _occupancy(total, x, y, height)
    full = inside >= _MIN_COLOURED
    if not full.any():
        return []
    x, y, inside = x[full], y[full], inside[full]
    left_right_above = (
        np.concatenate([x - wide, x + wide, x]),
        np.concatenate([y, y, y - high]),
    )
    beside = _occupancy(total, *left_right_above, height).reshape(3, -1).max(axis=0)
    score = 0.9 * (inside - 0.5 * beside)
    good = np.flatnonzero(beside <= _MAX_BESIDE)
    order = good[np.argsort(-score[good], kind="stable")]
    heads = [Head(float(x[k]), float(y[k]), float(score[k])) for k in order[:64].tolist()]
    return _apart(heads, 2 * wide, 1.5 * high)


def _occupancy(total: NDArray[np.int32], x: Floats, y: Floats, height: float) -> Floats:
    """Share of the ellipses hung from tops (x, y), (N,) each, that is set."""
    w, h = _HEAD_W * height, _HEAD_H * height
    rows, columns = total.shape[0] - 1, total.shape[1] - 1
    half, ends = _ELLIPSE[:, :1] * w / 2, np.empty((4, len(_ELLIPSE), len(x)))
    ends[0], ends[1], ends[2], ends[3] = (
        x - half,
        y + _ELLIPSE[:, 1:2] * h,
        x + half,
        y + _ELLIPSE[:, 2:] * h,
    )
    np.rint(ends, out=ends)
    np.maximum(ends, 0, out=ends)
    np.minimum(
        ends, np.array([columns, rows, columns, rows], np.float64)[:, None, None], out=ends
    )
    at = ends.astype(np.intp)
    at[1::2] *= columns + 1
    x1, y1, x2, y2 = at
    flat = total.ravel()
    count = (
        flat.take(y2 + x2) - flat.take(y1 + x2) - flat.take(y2 + x1) + flat.take(y1 + x1)
    ).sum(axis=0)
    area = _ELLIPSE_AREA * w * h
    return np.asarray(np.minimum(count / max(area, 1.0), 1.0))


def _apart(heads: Sequence[Head], wide: float, high: float) -> list[Head]:
    """The best heads, none within an ellipse of these half axes around a better one; ties by
    place, left first.
    """
    ordered = sorted(heads, key=lambda h: (-h.score, h.x, h.y))
    kept: list[Head] = []
    for head in ordered:
        if all(
            ((head.x - k.x) / wide) ** 2 + ((head.y - k.y) / high) ** 2 >= 1 for k in kept
        ):
            kept.append(head)
    return kept
