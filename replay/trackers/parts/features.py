"""The parts model's features (PARTS 2.2), for all candidates of a frame at once, as small integers.

Area and perimeter are counted in integral images of the foreground and of its inner contour. Colours are read at
fixed places within each part (`SAMPLES`), foreground alone, so that a candidate costs the same however large it is;
their 8-bit HSV and XYZ values are counted in one `bincount`. Every feature and every difference is an integer, so
that scores are sums of integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2
from replay.trackers.parts.regions import PARTS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]

FEATURES = ("area", "perimeter", "hsv", "xyz", "displacement", "overlap")
AREA, PERIMETER, HSV, XYZ, DISPLACEMENT, OVERLAP = range(6)
ONE = 256
"""The integer that stands for 1."""
FURTHEST = ONE - 1
"""Differences are kept below this."""
CHANNELS, BINS = 6, 16
"""Channels H, S, V, X, Y, Z, and the bins of each."""
MASS = 1024
"""Sum of a channel's histogram."""
NO_HUE = 12
"""Bin of pixels too dark or too grey for their hue to mean anything."""
_GREY, _DARK = 36, 36
SAMPLES = ((4, 10), (10, 5), (10, 5), (12, 5), (12, 5))
"""Rows and columns of places at which each part's colours are read."""
MIN_SAMPLES = 0.15
"""Least share of a part's places that are foreground, for its colours to be known."""


def _places() -> tuple[Floats, Floats, Ints]:
    """Places in their parts, x and y in [0, 1], and the part of each: (S,), (S,), (S,)."""
    x, y, part = [], [], []
    for j, (rows, columns) in enumerate(SAMPLES):
        across, down = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
        x.append(across.ravel())
        y.append(down.ravel())
        part.append(np.full(rows * columns, j))
    return np.concatenate(x), np.concatenate(y), np.concatenate(part).astype(np.int64)


_X, _Y, _PART = _places()
_COUNTS = np.array([r * c for r, c in SAMPLES], np.int64)
_STARTS = np.concatenate([[0], np.cumsum(_COUNTS)[:-1]])
_LEVELS = (np.arange(256) * BINS // 256).astype(np.int64)
_HUES = np.minimum(np.arange(256) // 15, NO_HUE - 1).astype(np.int64)


class Pixels:
    """One frame's pixels, prepared for counting.

    Args:
        image: (H, W, 3) uint8 BGR, or None.
        mask: (H, W) uint8, 0 or 255, or None: everything counts as foreground, area and perimeter are not known.
        size: (width, height).
    """

    def __init__(self, image: Bytes | None, mask: Bytes | None, size: tuple[int, int]) -> None:
        self.image, self.mask = image, mask
        self.width, self.height = size
        self.area: NDArray[np.int32] | None = None
        self.edge: NDArray[np.int32] | None = None
        if mask is not None:
            ones = cv2.min(mask, np.ones_like(mask))
            self.area = np.asarray(cv2.integral(ones, sdepth=cv2.CV_32S))
            inner = cv2.erode(ones, np.ones((3, 3), np.uint8), borderType=cv2.BORDER_CONSTANT, borderValue=0)
            self.edge = np.asarray(cv2.integral(cv2.subtract(ones, inner), sdepth=cv2.CV_32S))

    def sums(self, integral: NDArray[np.int32], boxes: Floats) -> Ints:
        """Counts within boxes (..., 4) of the picture, (...,)."""
        x1 = np.clip(np.rint(boxes[..., 0]), 0, self.width).astype(np.int64)
        y1 = np.clip(np.rint(boxes[..., 1]), 0, self.height).astype(np.int64)
        x2 = np.clip(np.rint(boxes[..., 0] + boxes[..., 2]), 0, self.width).astype(np.int64)
        y2 = np.clip(np.rint(boxes[..., 1] + boxes[..., 3]), 0, self.height).astype(np.int64)
        flat, pitch = integral.ravel(), self.width + 1
        y1, y2 = y1 * pitch, y2 * pitch
        return np.asarray(flat[y2 + x2] - flat[y1 + x2] - flat[y2 + x1] + flat[y1 + x1], np.int64)

    def fill(self, boxes: Floats) -> Floats:
        """Share of boxes (N, 4) that is foreground, (N,)."""
        if self.area is None:
            return np.ones(len(boxes))
        return self.sums(self.area, boxes) / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)


@dataclass(frozen=True)
class Measured:
    """Features of N candidates, each measured for one target.

    Attributes:
        area: (N, 5) foreground pixels of each part over the area of the target's part, in 1 / `ONE`.
        perimeter: (N, 5) contour pixels over the perimeter of the target's part, in 1 / `ONE`.
        colours: (N, 5, CHANNELS, BINS) histograms of sum `MASS`, all 0 where too little foreground was seen.
        displacement: (N, 5) way of the part's centre from where it was, over the gate's half side, in 1 / `ONE`.
        overlap: (N, 5) share of the part's last rectangle that the new one covers, in 1 / `ONE`.
        known: (6,) bool, which of `FEATURES` were measured at all.
    """

    area: Ints
    perimeter: Ints
    colours: Ints
    displacement: Ints
    overlap: Ints
    known: NDArray[np.bool_]


def measure(pixels: Pixels, parts: Floats, expected: Floats, before: Floats, gate: Floats) -> Measured:
    """Measure candidates.

    Args:
        pixels: the frame.
        parts: (N, 5, 4) the candidates' parts.
        expected: (N, 5, 4) parts of the box that the candidate's target is expected to have: only sizes count.
        before: (N, 5, 4) its parts where it was last.
        gate: (N,) half side of its gate, pixels.
    """
    n = len(parts)
    known = np.array([pixels.area is not None] * 2 + [pixels.image is not None] * 2 + [True] * 2)
    area = perimeter = np.zeros((n, len(PARTS)), np.int64)
    if pixels.area is not None and pixels.edge is not None:
        w, h = expected[:, :, 2], expected[:, :, 3]
        area = pixels.sums(pixels.area, parts) * ONE // np.maximum(np.rint(w * h), 1).astype(np.int64)
        around = np.maximum(np.rint(2 * (w + h)), 1).astype(np.int64)
        perimeter = pixels.sums(pixels.edge, parts) * ONE // around
    colours = np.zeros((n, len(PARTS), CHANNELS, BINS), np.int64)
    if pixels.image is not None and n:
        colours = _colours(pixels, parts)
    return Measured(area, perimeter, colours, _displacement(parts, before, gate), _overlap(parts, before), known)


def _colours(pixels: Pixels, parts: Floats) -> Ints:
    """Normalised histograms of the parts' foreground colours."""
    image, n = pixels.image, len(parts)
    assert image is not None
    p = parts[:, _PART, :]
    x = np.floor(p[:, :, 0] + _X * p[:, :, 2]).astype(np.int64)
    y = np.floor(p[:, :, 1] + _Y * p[:, :, 3]).astype(np.int64)
    seen = (x >= 0) & (x < pixels.width) & (y >= 0) & (y < pixels.height)
    flat = np.where(seen, y * pixels.width + x, 0)
    if pixels.mask is not None:
        seen &= pixels.mask.ravel()[flat] > 0
    rows, places = np.nonzero(seen)
    bgr = image.reshape(-1, 3)[flat[rows, places]][None]
    bins = bins_of(bgr)
    cell = rows * len(PARTS) + _PART[places]
    index = (cell[:, None] * CHANNELS + np.arange(CHANNELS)) * BINS + bins
    counts = np.bincount(index.ravel(), minlength=n * len(PARTS) * CHANNELS * BINS)
    counts = counts.reshape(n, len(PARTS), CHANNELS, BINS)
    total = counts[:, :, 0, :].sum(axis=2)
    enough = total >= MIN_SAMPLES * _COUNTS
    scaled = counts * MASS // np.maximum(total, 1)[:, :, None, None]
    return np.asarray(scaled * enough[:, :, None, None], np.int64)


def bins_of(bgr: Bytes) -> Ints:
    """Bins of pixels (1, P, 3) uint8 BGR in H, S, V, X, Y, Z, (P, CHANNELS)."""
    if not bgr.size:
        return np.zeros((0, CHANNELS), np.int64)
    hsv = cv2.cvtColor(bgr, cv2.COLOR_BGR2HSV)[0]
    xyz = cv2.cvtColor(bgr, cv2.COLOR_BGR2XYZ)[0]
    out = np.empty((len(hsv), CHANNELS), np.int64)
    out[:, 0] = np.where((hsv[:, 1] < _GREY) | (hsv[:, 2] < _DARK), NO_HUE, _HUES[hsv[:, 0]])
    out[:, 1] = _LEVELS[hsv[:, 1]]
    out[:, 2] = _LEVELS[hsv[:, 2]]
    out[:, 3:] = _LEVELS[xyz]
    return out


def _displacement(parts: Floats, before: Floats, gate: Floats) -> Ints:
    dx = parts[:, :, 0] + parts[:, :, 2] / 2 - before[:, :, 0] - before[:, :, 2] / 2
    dy = parts[:, :, 1] + parts[:, :, 3] / 2 - before[:, :, 1] - before[:, :, 3] / 2
    way = np.sqrt(dx * dx + dy * dy) / np.maximum(gate, 1e-9)[:, None]
    return np.asarray(np.rint(np.minimum(way, 4.0) * ONE), np.int64)


def _overlap(parts: Floats, before: Floats) -> Ints:
    ends, ended = parts[..., :2] + parts[..., 2:], before[..., :2] + before[..., 2:]
    size = np.maximum(np.minimum(ends, ended) - np.maximum(parts[..., :2], before[..., :2]), 0.0)
    share = size[..., 0] * size[..., 1] / np.maximum(before[..., 2] * before[..., 3], 1e-9)
    return np.asarray(np.rint(np.minimum(share, 1.0) * ONE), np.int64)


@dataclass
class PartsModel:
    """What is known of targets' parts: running means of the features, one row per target.

    Attributes:
        area, perimeter, overlap: (N, 5) as in `Measured`.
        colours: (N, 5, CHANNELS, BINS).
        seen: (N, 5) how often each part was learnt.
    """

    area: Ints
    perimeter: Ints
    overlap: Ints
    colours: Ints
    seen: Ints

    @classmethod
    def empty(cls, n: int = 0) -> PartsModel:
        """Models of n targets of whom nothing is known."""
        k = len(PARTS)
        area, perimeter, overlap, seen = np.zeros((4, n, k), np.int64)
        return cls(area, perimeter, overlap, np.zeros((n, k, CHANNELS, BINS), np.int64), seen)

    def take(self, rows: NDArray[np.intp]) -> PartsModel:
        """The models of some rows, in that order."""
        return PartsModel(
            self.area[rows], self.perimeter[rows], self.overlap[rows], self.colours[rows], self.seen[rows]
        )

    def append(self, other: PartsModel) -> None:
        """Add the other's rows at the end."""
        for name in ("area", "perimeter", "overlap", "colours", "seen"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(other, name)]))

    def learn(self, row: int, m: Measured, k: int, weight: Ints) -> None:
        """Blend candidate k into a target's parts (PARTS 4.2): weights (5,) in 1 / `ONE`, 0 leaves a part as it is.

        A part that was never learnt takes the measured values as they are.
        """
        w = np.where((self.seen[row] == 0) & (weight > 0), ONE, weight)
        for name in ("area", "perimeter", "overlap"):
            now = getattr(self, name)
            now[row] += (getattr(m, name)[k] - now[row]) * w // ONE
        seen = m.colours[k].sum(axis=(1, 2)) > 0
        fresh = seen & (self.colours[row].sum(axis=(1, 2)) == 0)
        cw = np.where(fresh & (weight > 0), ONE, w) * seen
        self.colours[row] += (m.colours[k] - self.colours[row]) * cw[:, None, None] // ONE
        self.seen[row] += weight > 0


def differences(model: PartsModel, rows: NDArray[np.intp], m: Measured) -> Ints:
    """d_ij = |f_ij - F_ij| (eq. 11) of N candidates, (N, 5, 6) in [0, `FURTHEST`]; ``rows`` are their targets.

    Colours differ by half the sum of absolute differences of their histograms, the mean over the three channels; those
    of a part without foreground differ entirely.
    """
    out = np.empty((len(rows), len(PARTS), len(FEATURES)), np.int64)
    out[:, :, AREA] = np.abs(m.area - model.area[rows])
    out[:, :, PERIMETER] = np.abs(m.perimeter - model.perimeter[rows])
    apart = np.abs(m.colours - model.colours[rows]).sum(axis=3)
    unseen = ~m.colours.any(axis=(2, 3))
    out[:, :, HSV] = np.where(unseen, FURTHEST, apart[:, :, :3].sum(axis=2) * ONE // (6 * MASS))
    out[:, :, XYZ] = np.where(unseen, FURTHEST, apart[:, :, 3:].sum(axis=2) * ONE // (6 * MASS))
    out[:, :, DISPLACEMENT] = m.displacement
    out[:, :, OVERLAP] = np.abs(m.overlap - model.overlap[rows])
    return np.minimum(out, FURTHEST)
