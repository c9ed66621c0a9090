"""The parts model's features (PARTS 2.2), for all candidates of a frame at once, as small integers.

Area and perimeter are counted in integral images of the foreground and of its inner contour.
Colours are read at fixed places within each part (`SAMPLES`), foreground alone, so that a
candidate costs the same however large it is; their 8-bit HSV and XYZ values are counted in one
`bincount`. Every feature and every difference is an integer, so that scores are sums of integers.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2
from replay.trackers.parts.regions import PARTS

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.intp]
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
BRIGHTNESS = 4
"""The channel that a picture without colours shows, too: Y."""
_BUT_BRIGHTNESS = [k for k in range(6) if k != BRIGHTNESS]
_GREY, _DARK = 36, 36
SAMPLES = ((4, 10), (10, 5), (10, 5), (12, 5), (12, 5))
"""Rows and columns of places at which each part's colours are read."""
MIN_SAMPLES = 0.15
"""Least share of a part's places that are foreground, for its colours to be known."""


def _places() -> tuple[Floats, Floats, Rows, Rows, Rows]:
    """Places in their parts: x of each column and y of each row of the parts' grids, in [0, 1],
    the parts one after the other; and of every place its column, its row and its part, (S,) each.
    """
    x = np.concatenate([(np.arange(columns) + 0.5) / columns for _, columns in SAMPLES])
    y = np.concatenate([(np.arange(rows) + 0.5) / rows for rows, _ in SAMPLES])
    column, row, part = np.array(
        [
            (
                sum(c for _, c in SAMPLES[:j]) + k % columns,
                sum(r for r, _ in SAMPLES[:j]) + k // columns,
                j,
            )
            for j, (rows, columns) in enumerate(SAMPLES)
            for k in range(rows * columns)
        ],
        np.intp,
    ).T.copy()
    return x, y, column, row, part


def _bin_tables() -> tuple[Bytes, Bytes]:
    """Bins of 8-bit H, S, V and X, Y, Z, each channel's from where its histogram starts among a
    part's: (256, 1, 3).
    """
    level = np.arange(256)
    hue, plain = np.minimum(level // 15, NO_HUE - 1), level * BINS // 256
    hsv, xyz = np.stack([hue, plain, plain], axis=1), np.stack([plain] * 3, axis=1)
    starts = BINS * np.arange(CHANNELS)
    return (hsv + starts[:3]).astype(np.uint8)[:, None], (xyz + starts[3:]).astype(
        np.uint8
    )[:, None]


_X, _Y, _COLUMN, _ROW, _PART = _places()
_OF_COLUMN = np.repeat(np.arange(len(PARTS)), [columns for _, columns in SAMPLES])
_OF_ROW = np.repeat(np.arange(len(PARTS)), [rows for rows, _ in SAMPLES])
_COUNTS = np.array([r * c for r, c in SAMPLES], np.int64)
_HSV_BINS, _XYZ_BINS = _bin_tables()
_FIRST = np.searchsorted(_PART, np.arange(len(PARTS)))
"""Where each part's places begin."""
_STEPS = (
    np.rint(_X[_COLUMN] * ONE).astype(np.int64),
    np.rint(_Y[_ROW] * ONE).astype(np.int64),
)
"""Every place within its part, across and down, in 1 / `ONE`."""


class Room:
    """Arrays of a picture's size, (width, height), that are used again from frame to frame.

    Fresh ones are had from the system page by page, which takes longer than to fill them.
    """

    def __init__(self, size: tuple[int, int]) -> None:
        width, height = size
        self.ones, self.spare = np.empty((2, height, width), np.uint8)
        self.area, self.edge = np.empty((2, height + 1, width + 1), np.int32)


class Pixels:
    """One frame's pixels, prepared for counting.

    Args:
        image: (H, W, 3) uint8 BGR, or None.
        mask: (H, W) uint8, 0 or 255, or None: everything counts as foreground, area and perimeter
            are not known.
        size: (width, height).
        room: what is counted in; whoever gives the same for the next frame is through with this
            one.

    Attributes:
        grey: the image shows no colours: of the histograms there is that of brightness alone.
    """

    def __init__(
        self,
        image: Bytes | None,
        mask: Bytes | None,
        size: tuple[int, int],
        room: Room | None = None,
    ) -> None:
        self.image, self.mask = image, mask
        self.grey = False
        self.width, self.height = size
        self._first = self._last = np.zeros(4)
        self.area: NDArray[np.int32] | None = None
        self.edge: NDArray[np.int32] | None = None
        if mask is not None:
            self._room = room or Room(size)
            # Only where there is foreground at all.
            left, top, w, h = cv2.boundingRect(mask)
            self._first = np.array([left, top, left, top], np.float64)
            self._last = self._first + np.array([w, h, w, h])
            self.area, self.edge = self._room.area, self._room.edge
            area, edge = self.area[: h + 1, : w + 1], self.edge[: h + 1, : w + 1]
            ones, inner = self._room.ones[:h, :w], self._room.spare[:h, :w]
            if not ones.size:
                area[:] = edge[:] = 0
                return
            np.minimum(mask[top : top + h, left : left + w], np.uint8(1), out=ones)
            cv2.integral(ones, area, cv2.CV_32S)
            cv2.erode(
                ones,
                np.ones((3, 3), np.uint8),
                inner,
                borderType=cv2.BORDER_CONSTANT,
                borderValue=0,
            )
            cv2.integral(cv2.subtract(ones, inner, inner), edge, cv2.CV_32S)

    def copied_mask(self) -> Bytes:
        """A copy of the mask to write into; the next call writes into it, too."""
        assert self.mask is not None
        np.copyto(self._room.spare, self.mask)
        return self._room.spare

    def sums(self, integral: NDArray[np.int32], boxes: Floats) -> Ints:
        """Counts within boxes (..., 4) of the picture, (...,)."""
        return _between(integral, self._corners(boxes))

    def counts(self, boxes: Floats) -> tuple[Ints, Ints] | None:
        """Foreground and contour pixels within boxes (..., 4), (...,) each; None without a mask."""
        if self.area is None or self.edge is None:
            return None
        corners = self._corners(boxes)
        return _between(self.area, corners), _between(self.edge, corners)

    def shares(self, rest: Bytes, boxes: Floats) -> Floats:
        """Share of the foreground within boxes (N, 4) that another mask, with less foreground,
        has too, (N,).
        """
        assert self.area is not None
        ends = self._ends_of(boxes)
        left = [np.count_nonzero(rest[y1:y2, x1:x2]) for x1, y1, x2, y2 in ends.tolist()]
        return np.asarray(left / np.maximum(self.sums(self.area, boxes), 1))

    def _ends_of(self, boxes: Floats) -> Rows:
        """Left, top, right and bottom of boxes (..., 4) in whole pixels, within the foreground's
        bounding box.
        """
        ends = boxes.copy()
        ends[..., 2:] += boxes[..., :2]
        np.rint(ends, out=ends)
        np.maximum(ends, self._first, out=ends)
        np.minimum(ends, self._last, out=ends)
        return ends.astype(np.intp)

    def _corners(self, boxes: Floats) -> tuple[Rows, Rows, Rows, Rows]:
        """Where the boxes' corners lie in the flat integral image: lower right, upper right,
        lower left, upper left.
        """
        at = self._ends_of(boxes) - self._first.astype(np.intp)
        at[..., 1::2] *= self.width + 1
        x1, y1, x2, y2 = at[..., 0], at[..., 1], at[..., 2], at[..., 3]
        return y2 + x2, y1 + x2, y2 + x1, y1 + x1


def _between(integral: NDArray[np.int32], corners: tuple[Rows, Rows, Rows, Rows]) -> Ints:
    """Counts within boxes of these corners."""
    flat = integral.ravel()
    lower_right, upper_right, lower_left, upper_left = (flat.take(at) for at in corners)
    return np.asarray(lower_right - upper_right - lower_left + upper_left, np.int64)


@dataclass(frozen=True)
class Measured:
    """Features of N candidates, each measured for one target.

    Attributes:
        foreground: (N, 5) foreground pixels of each part.
        area: (N, 5) the same over the area of the target's part, in 1 / `ONE`.
        perimeter: (N, 5) contour pixels over the perimeter of the target's part, in 1 / `ONE`.
        colours: (N, 5, CHANNELS, BINS) histograms of sum `MASS`, all 0 where too little
            foreground was seen; all but Y are 0 of a picture without colours.
        coloured: (N, 5) bool: foreground enough was seen.
        displacement: (N, 5) way of the part's centroid from where it was, over the gate's half
            side, in 1 / `ONE`.
        overlap: (N, 5) share of what the part was that it covers now, both of the part's size
            around their centroids, in 1 / `ONE`.
        centroid: (N, 5, 2) the foreground's centroid within the part, x and y, in 1 / `ONE` of
            its sides; the middle where there is no foreground.
        known: (6,) bool, which of `FEATURES` were measured at all.
    """

    foreground: Ints
    area: Ints
    perimeter: Ints
    colours: Ints
    coloured: NDArray[np.bool_]
    displacement: Ints
    overlap: Ints
    centroid: Ints
    known: NDArray[np.bool_]

    def kept(self, keep: NDArray[np.bool_] | slice) -> Measured:
        """Some of the candidates."""
        return Measured(
            foreground=self.foreground[keep],
            area=self.area[keep],
            perimeter=self.perimeter[keep],
            colours=self.colours[keep],
            coloured=self.coloured[keep],
            displacement=self.displacement[keep],
            overlap=self.overlap[keep],
            centroid=self.centroid[keep],
            known=self.known,
        )


def measure(
    pixels: Pixels,
    parts: Floats,
    expected: Floats,
    before: Floats,
    gate: Floats,
    was: Ints | None = None,
) -> Measured:
    """Measure candidates.

    Args:
        pixels: the frame.
        parts: (N, 5, 4) the candidates' parts.
        expected: (N, 5, 4) parts of the box that the candidate's target is expected to have: only
            sizes count.
        before: (N, 5, 4) its parts where it was last.
        gate: (N,) half side of its gate, pixels.
        was: (N, 5, 2) the parts' centroids there, as in `Measured`; None: not known, so that
            places are the rectangles' middles.
    """
    n = len(parts)
    counts = pixels.counts(parts)
    known = np.array([counts is not None] * 2 + [pixels.image is not None] * 2 + [True] * 2)
    foreground = area = perimeter = np.zeros((n, len(PARTS)), np.int64)
    if counts is not None:
        w, h = expected[:, :, 2], expected[:, :, 3]
        foreground = counts[0]
        area = foreground * ONE // np.maximum(np.rint(w * h), 1).astype(np.int64)
        perimeter = counts[1] * ONE // np.maximum(np.rint(2 * (w + h)), 1).astype(np.int64)
    colours = np.zeros((n, len(PARTS), CHANNELS, BINS), np.int64)
    coloured = np.zeros((n, len(PARTS)), bool)
    centroid = np.full((n, len(PARTS), 2), ONE // 2, np.int64)
    if n and (pixels.image is not None or pixels.mask is not None):
        flat, seen = _sampled(pixels, parts)
        if pixels.mask is not None:
            centroid = _centroids(seen)
        if pixels.image is not None:
            colours, coloured = _colours(pixels.image, flat, seen)
            if pixels.grey:
                colours[:, :, _BUT_BRIGHTNESS] = 0
    here = _around(parts, centroid if was is not None else None)
    there = _around(before, was)
    displacement, overlap = _displacement(here, there, gate), _overlap(here, there)
    return Measured(
        foreground=foreground,
        area=area,
        perimeter=perimeter,
        colours=colours,
        coloured=coloured,
        displacement=displacement,
        overlap=overlap,
        centroid=centroid,
        known=known,
    )


def head_and_body(pixels: Pixels, parts: Floats) -> tuple[Bytes, Bytes]:
    """Foreground pixels of heads, and of what is below them, at the parts' (N, 5, 4) places: (P,
    3) uint8 BGR each.
    """
    assert pixels.image is not None
    flat, seen = _sampled(pixels, parts)
    bgr = pixels.image.reshape(-1, 3)
    head, body = seen & (_PART == 0), seen & (_PART > 0)
    return bgr.take(flat[head], axis=0), bgr.take(flat[body], axis=0)


def _centroids(seen: NDArray[np.bool_]) -> Ints:
    """Centroids of the places (N, S) that are foreground, within their parts, (N, 5, 2) in 1 /
    `ONE`.
    """
    counts = np.add.reduceat(seen.astype(np.int64), _FIRST, axis=1)
    out = np.empty((*counts.shape, 2), np.int64)
    for axis, places in enumerate(_STEPS):
        total = np.add.reduceat(seen * places, _FIRST, axis=1)
        out[..., axis] = np.where(counts > 0, total // np.maximum(counts, 1), ONE // 2)
    return out


def _around(parts: Floats, centroids: Ints | None) -> Floats:
    """Rectangles of the parts' (N, 5, 4) sizes around their centroids, (N, 5, 4)."""
    if centroids is None:
        return parts
    out = parts.copy()
    out[..., :2] += (centroids / ONE - 0.5) * parts[..., 2:]
    return out


def _colours(
    image: Bytes, flat: Rows, seen: NDArray[np.bool_]
) -> tuple[Ints, NDArray[np.bool_]]:
    """Normalised histograms of the parts' foreground colours, and which parts have foreground
    enough; places (N, S) as `_sampled` gives them.
    """
    n = len(flat)
    places = np.flatnonzero(seen)
    size = CHANNELS * BINS
    cell = (size * (np.arange(n)[:, None] * len(PARTS) + _PART)).ravel()[places]
    index = _cells_of(image.reshape(-1, 3).take(flat.ravel()[places], axis=0), cell)
    counts = np.bincount(index.ravel(), minlength=n * len(PARTS) * size).reshape(
        n, len(PARTS), CHANNELS, BINS
    )
    total = counts[:, :, 0, :].sum(axis=2)
    enough = total >= MIN_SAMPLES * _COUNTS
    # Floor division, quicker: a quotient of such small whole numbers is never rounded up to a
    # whole one.
    share = counts.astype(np.float32)
    share *= MASS
    share /= np.where(enough, total, np.inf).astype(np.float32)[:, :, None, None]
    return share.astype(np.int64), enough


def _sampled(pixels: Pixels, parts: Floats) -> tuple[Rows, NDArray[np.bool_]]:
    """The flat pixel index of every place in every part, (N, S), and whether it is foreground of
    the picture.
    """
    x = np.floor(parts[:, _OF_COLUMN, 0] + _X * parts[:, _OF_COLUMN, 2]).astype(np.intp)
    y = np.floor(parts[:, _OF_ROW, 1] + _Y * parts[:, _OF_ROW, 3]).astype(np.intp)
    # Outside of the picture a place counts as background, wherever its index then leads.
    across, down = (x >= 0) & (x < pixels.width), (y >= 0) & (y < pixels.height)
    x, y = np.where(across, x, 0), np.where(down, y, 0) * pixels.width
    flat = y[:, _ROW] + x[:, _COLUMN]
    seen = (
        np.ones(flat.shape, bool)
        if pixels.mask is None
        else pixels.mask.ravel().take(flat) > 0
    )
    if not (across.all() and down.all()):
        seen &= down[:, _ROW] & across[:, _COLUMN]
    return flat, seen


def _cells_of(bgr: Bytes, part: Rows) -> Rows:
    """Where pixels (P, 3) uint8 BGR count in H, S, V, X, Y, Z, (CHANNELS, P), given where their
    parts start (P,).
    """
    out = np.empty((CHANNELS, len(bgr)), np.intp)
    if not len(bgr):
        return out
    hsv, xyz = (
        cv2.cvtColor(bgr[None], cv2.COLOR_BGR2HSV),
        cv2.cvtColor(bgr[None], cv2.COLOR_BGR2XYZ),
    )
    np.add(cv2.LUT(hsv, _HSV_BINS)[0].T, part, out=out[:3])
    np.add(cv2.LUT(xyz, _XYZ_BINS)[0].T, part, out=out[3:])
    saturation, value = hsv[0, :, 1], hsv[0, :, 2]
    no_hue = np.flatnonzero((saturation < _GREY) | (value < _DARK))
    out[0, no_hue] = part[no_hue] + NO_HUE
    return out


def _displacement(parts: Floats, before: Floats, gate: Floats) -> Ints:
    off = parts[..., :2] + parts[..., 2:] / 2 - before[..., :2] - before[..., 2:] / 2
    off *= off
    way = np.sqrt(off[..., 0] + off[..., 1]) / np.maximum(gate, 1e-9)[:, None]
    return np.asarray(np.rint(np.minimum(way, 4.0) * ONE), np.int64)


def _overlap(parts: Floats, before: Floats) -> Ints:
    ends, ended = parts[..., :2] + parts[..., 2:], before[..., :2] + before[..., 2:]
    size = np.maximum(
        np.minimum(ends, ended) - np.maximum(parts[..., :2], before[..., :2]), 0.0
    )
    share = size[..., 0] * size[..., 1] / np.maximum(before[..., 2] * before[..., 3], 1e-9)
    return np.asarray(np.rint(np.minimum(share, 1.0) * ONE), np.int64)


@dataclass
class PartsModel:
    """What is known of targets' parts: running means of the features, one row per target.

    Attributes:
        area, perimeter, overlap: (N, 5) as in `Measured`.
        colours: (N, 5, CHANNELS, BINS).
        centroid: (N, 5, 2) as in `Measured`, as it was last.
        seen: (N, 5) how often each part was learnt.
    """

    area: Ints
    perimeter: Ints
    overlap: Ints
    colours: Ints
    centroid: Ints
    seen: Ints

    @classmethod
    def empty(cls, n: int = 0) -> PartsModel:
        """Models of n targets of whom nothing is known."""
        k = len(PARTS)
        area, perimeter, overlap, seen = np.zeros((4, n, k), np.int64)
        return cls(
            area,
            perimeter,
            overlap,
            np.zeros((n, k, CHANNELS, BINS), np.int64),
            np.full((n, k, 2), ONE // 2, np.int64),
            seen,
        )

    def take(self, rows: Rows) -> PartsModel:
        """The models of some rows, in that order."""
        return PartsModel(
            self.area[rows],
            self.perimeter[rows],
            self.overlap[rows],
            self.colours[rows],
            self.centroid[rows],
            self.seen[rows],
        )

    def append(self, other: PartsModel) -> None:
        """Add the other's rows at the end."""
        for name in ("area", "perimeter", "overlap", "colours", "centroid", "seen"):
            setattr(self, name, np.concatenate([getattr(self, name), getattr(other, name)]))

    def learn(self, rows: Rows | int, m: Measured, k: Rows | int, weight: Ints) -> None:
        """Blend candidates into targets' parts (PARTS 4.2).

        A part that was never learnt takes the measured values as they are.

        Args:
            rows: (M,) different targets.
            m: the measured candidates.
            k: (M,) rows of ``m``.
            weight: (M, 5, 6) of each part's features, in 1 / `ONE`; a part of which all are 0 is
                left as it is.
        """
        learnt: NDArray[np.bool_] = np.asarray((weight > 0).any(axis=-1))
        first = (self.seen[rows] == 0) & learnt
        w = np.where(first[..., None], ONE, weight)
        for name, index in (("area", AREA), ("perimeter", PERIMETER), ("overlap", OVERLAP)):
            table = getattr(self, name)
            now = table[rows]
            table[rows] = now + (getattr(m, name)[k] - now) * w[..., index] // ONE
        now, seen = self.colours[rows], m.coloured[k]
        fresh = np.asarray(seen & (now.max(axis=(-2, -1)) == 0) & learnt)
        cw = np.where(fresh[..., None], ONE, w[..., HSV : XYZ + 1]) * seen[..., None]
        by_channel = np.repeat(cw, CHANNELS // 2, axis=-1)
        # What a picture without colours does not show is kept, what was not known yet is taken as
        # it is.
        shown, blank = m.colours[k].any(axis=-1), ~now.any(axis=-1)
        by_channel = np.where(blank & (by_channel > 0), ONE, by_channel) * shown
        self.colours[rows] = now + (m.colours[k] - now) * by_channel[..., None] // ONE
        self.centroid[rows] = np.where(
            learnt[..., None], m.centroid[k], self.centroid[rows]
        )
        self.seen[rows] += learnt


def differences(model: PartsModel, rows: Rows, m: Measured) -> Ints:
    """d_ij = |f_ij - F_ij| (eq. 11) of N candidates, (N, 5, 6) in [0, `FURTHEST`]; ``rows`` are
    their targets.

    Colours differ by half the sum of absolute differences of their histograms, the mean over the
    three channels; by that of the brightness alone where one of the two was seen without colours;
    those of a part without foreground differ entirely.
    """
    out = np.empty((len(rows), len(PARTS), len(FEATURES)), np.int64)
    out[:, :, AREA] = np.abs(m.area - model.area[rows])
    out[:, :, PERIMETER] = np.abs(m.perimeter - model.perimeter[rows])
    known = model.colours[rows]
    apart = m.colours - known
    np.abs(apart, out=apart)
    plain = m.colours.any(axis=(-2, -1)) & ~m.colours[:, :, 0].any(axis=-1)
    plain |= known.any(axis=(-2, -1)) & ~known[:, :, 0].any(axis=-1)
    if plain.any():
        apart[plain] = apart[plain][:, BRIGHTNESS : BRIGHTNESS + 1]
    apart = apart.reshape(len(rows), len(PARTS), 2, CHANNELS // 2 * BINS).sum(axis=3)
    out[:, :, HSV : XYZ + 1] = np.where(
        m.coloured[:, :, None], apart * ONE // (6 * MASS), FURTHEST
    )
    out[:, :, DISPLACEMENT] = m.displacement
    out[:, :, OVERLAP] = np.abs(m.overlap - model.overlap[rows])
    return np.minimum(out, FURTHEST)
