"""Landmarks: small textured patches of a view, by which it is known again and its shift measured.

A picture shows the view where most of its landmarks are seen, all shifted by the same whole
number of pixels. Bodies cover some of them, leaves move others: the rest decides. Everything is
sums of 8-bit values, so that the answer is the same on every machine; light and contrast cancel
out in the correlation.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.change.light import light_of
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

Shift = tuple[int, int]
"""Pixels right and down by which a picture is shifted against its view."""
Ints = NDArray[np.int64]
Floats = NDArray[np.float64]

SIDE = 16
"""Side of a landmark, px."""
STEP = 4
"""Landmarks are looked for at every so-manieth pixel."""
COLUMNS, ROWS = 8, 6
"""The picture is divided into so many cells; each has one landmark, its most textured patch."""
FEWEST = 6
"""Of fewer landmarks nothing is known of a view."""
LEAST_GRADIENT = 6
"""A patch is textured if in its weaker direction its brightness changes by this from pixel to
pixel, root mean square, levels."""
ABOVE_NOISE, QUIET, MOST_PAIRS = 2.5, 0.2, 12
"""And by so many times what noise alone makes of it, in squares; which is measured where this share of
the picture is quietest, in so many pairs of pictures of at most `SMALL_PX`, in fewer of larger ones.
"""
SMALL_PX = 640 * 480
ALIKE = 0.6
"""A landmark is seen where the correlation is at least this."""
DRIFT_PX = 0.5
"""From this mean displacement on, another shift is looked for."""
BETWEEN_PX = 0.2
"""A picture shifted by this much less or more than a whole number lies between pixels."""
UNEVEN_PX = 0.45
"""A picture is turned, or nearer, where its landmarks are scattered by more than this."""
FURTHEST_PX, FINE = 2, 256
"""A landmark's displacement is known no farther than this; and to so many parts of a pixel."""
NEAR = 2
"""Reach of the search around a shift, px."""
SMALLEST_SIDE = 128
"""Pictures are halved until neither side is longer than this, for the search at large."""
MOST_SHIFT = 0.1
"""A view is known again under shifts up to this, of the picture's sides."""
AGREES = 0.75
"""A picture agrees with a view in this share of its pixels."""
MOST_DIFFERENCE = 24
"""A pixel counts no more than this in the search at large, levels."""


@dataclass(frozen=True)
class LandmarkSight:
    """How a picture shows a view under a shift.

    Attributes:
        share: of the landmarks that lie in the picture, how many are seen; 1 where there are too
            few to tell.
        score: sum of their correlations.
        drift: median displacement of those that are seen, px right and down.
        seen: which ones.
        scatter: median distance of their displacements from the median, px: large where the picture
            is turned or nearer. Of steady landmarks, as far as it follows from where they lie.
    """

    share: float
    score: float
    drift: tuple[float, float]
    seen: NDArray[np.bool_]
    scatter: float = 0.0

    @property
    def even(self) -> bool:
        """All of the view is shifted alike: the picture is neither turned nor nearer."""
        return self.scatter <= UNEVEN_PX

    @property
    def whole(self) -> bool:
        """The picture is shifted by a whole number of pixels."""
        return max(map(abs, self.drift)) <= BETWEEN_PX

    @property
    def near(self) -> bool:
        """The shift is nearly the nearest whole one: no better one was out of reach."""
        return max(map(abs, self.drift)) <= 2 * DRIFT_PX

    @property
    def still(self) -> bool:
        """The shift is the nearest whole one."""
        return max(map(abs, self.drift)) <= DRIFT_PX


NO_SIGHT = LandmarkSight(0.0, 0.0, (0.0, 0.0), np.zeros(0, bool))


class Landmarks:
    """The landmarks of one picture.

    Args:
        luma: (H, W) uint8.
        corners: (N, 2) row and column of each patch's first pixel.
        steady: they are what is steady between leaves, which a coarse codec moves one by one.
    """

    def __init__(self, luma: Image, corners: Ints, *, steady: bool = False) -> None:
        self._height, self._width = luma.shape
        self.corners = corners
        self._steady = steady
        within = np.arange(SIDE)
        rows = corners[:, 0, None, None] + within[:, None]
        columns = corners[:, 1, None, None] + within
        self._index: Ints = (rows * self._width + columns).reshape(-1, SIDE * SIDE)
        values = luma.ravel()[self._index].astype(np.int32)
        self._values = values
        self._sum = _total(values)
        self._spread = SIDE * SIDE * _dot(values, values) - self._sum * self._sum
        patches = values.reshape(-1, SIDE, SIDE)
        gradients = np.zeros((2, *patches.shape), np.int32)
        gradients[0, :, 1:-1, 1:-1] = patches[:, 1:-1, 2:] - patches[:, 1:-1, :-2]
        gradients[1, :, 1:-1, 1:-1] = patches[:, 2:, 1:-1] - patches[:, :-2, 1:-1]
        self._gx, self._gy = gradients.reshape(2, -1, SIDE * SIDE)
        self._own = [
            _dot(g, values) - _total(g) * self._sum / SIDE**2 for g in (self._gx, self._gy)
        ]
        self._tensor = [
            _dot(a, b).astype(np.float64)
            for a, b in (
                (self._gx, self._gx),
                (self._gx, self._gy),
                (self._gy, self._gy),
            )
        ]

    def __len__(self) -> int:
        return len(self.corners)

    @classmethod
    def of(
        cls,
        luma: Image,
        *,
        among: Ints | None = None,
        all_of_them: bool = False,
        noise: float = 0.0,
    ) -> Landmarks:
        """The most textured patch of each cell of a picture, (H, W) uint8.

        Args:
            luma: the picture.
            among: (N, 2) the only ones that are asked, which are steady: row and column of their
                first pixels.
            all_of_them: every textured patch, however many lie in a cell.
            noise: see `noise_of`.
        """
        least = max(float(LEAST_GRADIENT**2), ABOVE_NOISE * noise)
        height, width = luma.shape
        if min(height, width) < SIDE:
            return cls(luma, np.zeros((0, 2), np.int64))
        texture = _texture(luma)
        if all_of_them:
            apart = SIDE // STEP
            every = np.argwhere(texture[::apart, ::apart] >= least)
            return cls(luma, every * SIDE)
        if among is not None:
            asked = np.zeros_like(texture)
            asked[tuple(among.T // STEP)] = 1.0
            texture = texture * asked
        down, across = texture.shape
        corners = []
        for i in range(ROWS):
            for j in range(COLUMNS):
                top, bottom = i * down // ROWS, (i + 1) * down // ROWS
                left, right = j * across // COLUMNS, (j + 1) * across // COLUMNS
                cell = texture[top:bottom, left:right]
                if cell.size and cell.max() >= least:
                    k, m = divmod(int(cell.argmax()), cell.shape[1])
                    corners.append(((top + k) * STEP, (left + m) * STEP))
        found = np.array(corners, np.int64).reshape(-1, 2)
        return cls(luma, found, steady=among is not None)

    def only(self, kept: NDArray[np.bool_], luma: Image) -> Landmarks:
        """Some of them; ``luma`` is the picture that they are of."""
        return Landmarks(luma, self.corners[kept], steady=self._steady)

    def sight(self, luma: Image, shift: Shift, step: int = 1) -> LandmarkSight:
        """How a picture shows them under a shift.

        Args:
            luma: the picture's values, contiguous uint8.
            shift: px right and down.
            step: brightness is every so-manieth value.
        """
        index, inside, count = self._places(shift)
        if count < FEWEST:
            return LandmarkSight(1.0, 0.0, (0.0, 0.0), np.zeros(len(self), bool))
        there = luma.ravel().take(index * step if step > 1 else index).astype(np.int32)
        total = _total(there)
        spread = SIDE * SIDE * _dot(there, there) - total * total
        common = SIDE * SIDE * _dot(self._values, there) - self._sum * total
        product = self._spread.astype(np.float64) * spread.astype(np.float64)
        alike = common / np.sqrt(np.maximum(product, 1.0))
        seen: NDArray[np.bool_] = inside & (alike >= ALIKE)
        found = int(np.count_nonzero(seen))
        drift, scatter = (0.0, 0.0), 0.0
        if found >= FEWEST:
            drift, scatter = self._drift(there, total, spread, seen)
        score = float(np.maximum(alike, 0.0)[inside].sum())
        return LandmarkSight(found / count, score, drift, seen, scatter)

    def _places(self, shift: Shift) -> tuple[Ints, NDArray[np.bool_], int]:
        """Where the landmarks' pixels lie under a shift, which landmarks lie in the picture, and
        how many.
        """
        if not any(shift):
            return self._index, np.ones(len(self), bool), len(self)
        corners = self.corners + np.array([shift[1], shift[0]])
        most = np.array([self._height - SIDE, self._width - SIDE])
        inside: NDArray[np.bool_] = ((corners >= 0) & (corners <= most)).all(axis=1)
        index = self._index + (shift[1] * self._width + shift[0])
        return (
            np.where(inside[:, None], index, 0),
            inside,
            int(np.count_nonzero(inside)),
        )

    def _drift(
        self,
        there: NDArray[np.int32],
        total: Ints,
        spread: Ints,
        seen: NDArray[np.bool_],
    ) -> tuple[tuple[float, float], float]:
        """Median displacement of the patches, by one step of Lucas and Kanade (1981), and the
        median distance from it.
        """
        contrast = np.sqrt(self._spread / np.maximum(spread, 1))
        # The sums of 8-bit values are exact; only then they are scaled.
        ex, ey = (
            contrast * (_dot(g, there) - _total(g) * total / SIDE**2) - own
            for g, own in zip((self._gx, self._gy), self._own, strict=True)
        )
        xx, xy, yy = self._tensor
        # The central difference is twice the gradient.
        inverse = -2.0 / np.maximum(xx * yy - xy * xy, 1.0)
        dx, dy = inverse * (yy * ex - xy * ey), inverse * (xx * ey - xy * ex)
        dx, dy = dx[seen], dy[seen]
        drift = float(np.median(dx)), float(np.median(dy))
        dx, dy = dx - drift[0], dy - drift[1]
        scatter = float(np.median(np.maximum(np.abs(dx), np.abs(dy))))
        if self._steady and scatter > UNEVEN_PX:
            dx, dy = (_by_place(d, self.corners[seen]) for d in (dx, dy))
            scatter = float(np.median(np.maximum(np.abs(dx), np.abs(dy))))
        return drift, scatter

    def search(self, luma: Image, around: Shift, reach: int) -> tuple[Shift, LandmarkSight]:
        """The shift under which they are seen best, within a reach of one; of equal ones the
        nearest.
        """
        near = [
            (around[0] + dx, around[1] + dy)
            for dx in range(-reach, reach + 1)
            for dy in range(-reach, reach + 1)
        ]
        near.sort(key=lambda s: (abs(s[0] - around[0]) + abs(s[1] - around[1]), s))
        best, found = near[0], self.sight(luma, near[0])
        for shift in near[1:]:
            sight = self.sight(luma, shift)
            if sight.score > found.score:
                best, found = shift, sight
        return best, found


class Reference:
    """A view as it is known again: landmarks at full size, and smaller pictures to search at
    large.

    Args:
        luma: the view's brightness, (H, W) uint8.
        kept: which of its landmarks alone are taken.
        among: (N, 2) the only ones that are asked, row and column of their first pixels.
        noise: see `noise_of`.
    """

    def __init__(
        self,
        luma: Image,
        kept: NDArray[np.bool_] | None = None,
        among: Ints | None = None,
        noise: float = 0.0,
    ) -> None:
        self._levels = _halved(luma)
        # Each half has a fourth of the noise.
        self._marks = [
            Landmarks.of(half, among=None if k else among, noise=noise / 4**k)
            for k, half in enumerate(self._levels)
        ]
        if kept is not None:
            self._marks[0] = self._marks[0].only(kept, luma)
        self._flat = _without_light(self._levels[-1])
        self._picture = self._levels[0][..., None]

    @property
    def known(self) -> bool:
        """There are enough landmarks to know the view by."""
        return len(self._marks[0]) >= FEWEST

    def sight(self, picture: Image, shift: Shift) -> LandmarkSight:
        """How a picture in Y, Cr, Cb, (H, W, 3) uint8, shows the view under a shift; not at all
        under one that is too large.
        """
        if not self.within(shift):
            return LandmarkSight(0.0, 0.0, (0.0, 0.0), np.zeros(len(self._marks[0]), bool))
        return self._marks[0].sight(picture, shift, 3)

    def within(self, shift: Shift) -> bool:
        """A shift is no larger than `MOST_SHIFT`."""
        height, width = self._levels[0].shape
        most = int(MOST_SHIFT * width), int(MOST_SHIFT * height)
        return abs(shift[0]) <= most[0] and abs(shift[1]) <= most[1]

    def lit(self, picture: Image) -> bool:
        """Whether most of a picture is as bright as the view, in some light."""
        return light_of(picture, self._picture).known

    def agrees(self, picture: Image) -> bool:
        """Whether nearly all of a picture is as bright as the view, whatever becomes of its
        landmarks: they may have been on bodies.
        """
        return light_of(picture, self._picture).agreeing >= AGREES

    def near(self, picture: Image, around: Shift) -> tuple[Shift, LandmarkSight]:
        """The best shift within `NEAR` pixels of one; it may be too large."""
        return self._marks[0].search(as_image(cv2.extractChannel(picture, 0)), around, NEAR)

    def around(self, picture: Image, shift: Shift) -> tuple[Shift, LandmarkSight]:
        """The best shift within `NEAR` pixels of one in the smallest picture, then finer and
        finer.
        """
        levels = _halved(as_image(cv2.extractChannel(picture, 0)))
        scale = 1 << (len(levels) - 1)
        return self._finer(levels, (round(shift[0] / scale), round(shift[1] / scale)))

    def anywhere(self, picture: Image) -> tuple[Shift, LandmarkSight]:
        """The best shift up to `MOST_SHIFT` of the picture: at large in the smallest picture, then
        finer and finer.
        """
        levels = _halved(as_image(cv2.extractChannel(picture, 0)))
        return self._finer(levels, _at_large(self._flat, _without_light(levels[-1])))

    def _finer(self, levels: list[Image], shift: Shift) -> tuple[Shift, LandmarkSight]:
        sight = NO_SIGHT
        for k in range(len(levels) - 1, -1, -1):
            if len(self._marks[k]) >= FEWEST:
                shift, sight = self._marks[k].search(levels[k], shift, NEAR)
            if k:
                shift = (2 * shift[0], 2 * shift[1])
        return (shift, sight) if self.within(shift) else ((0, 0), NO_SIGHT)


def _dot(a: NDArray[np.int32], b: NDArray[np.int32]) -> Ints:
    """Of each patch; at most 255 * 510 * `SIDE`**2, which 32 bits hold."""
    product: Ints = np.einsum("pn,pn->p", a, b).astype(np.int64)
    return product


def _total(a: NDArray[np.int32]) -> Ints:
    total: Ints = np.einsum("pn->p", a).astype(np.int64)
    return total


def _by_place(displaced: Floats, corners: Ints) -> Floats:
    """That part of displacements (N,), px, that is linear in the places (N, 2): a turn's or a
    zoom's. Sums of integers, so that it is the same on every machine.
    """
    most = FURTHEST_PX * FINE
    d = np.clip(np.rint(displaced * FINE), -most, most).astype(np.int64)
    n = len(d)
    y, x = (n * corners - corners.sum(axis=0)).T
    yy, xx, xy = (int((a * b).sum()) for a, b in ((y, y), (x, x), (x, y)))
    yd, xd = int((y * d).sum()), int((x * d).sum())
    both = yy * xx - xy * xy
    if not both:
        return np.zeros(n)
    down, right = (yd * xx - xd * xy) / both, (xd * yy - yd * xy) / both
    found: Floats = (down * y + right * x) / FINE
    return found


def _texture(luma: Image | NDArray[np.int16]) -> Floats:
    """The mean square of the gradient in its weaker direction, of the patch of `SIDE` pixels that
    begins at every `STEP`-th pixel.
    """
    values = luma.astype(np.int32)
    gx, gy = np.zeros_like(values), np.zeros_like(values)
    gx[:, :-1] = values[:, 1:] - values[:, :-1]
    gy[:-1] = values[1:] - values[:-1]
    xx, yy, xy = (
        _patch_sums(a * b).astype(np.float64) for a, b in ((gx, gx), (gy, gy), (gx, gy))
    )
    weaker = (xx + yy - np.sqrt((xx - yy) ** 2 + 4 * xy * xy)) / 2
    texture: Floats = weaker / SIDE**2
    return texture


def noise_of(pictures: list[Image]) -> float:
    """The mean square of the gradient that noise makes, as `_texture` measures it: of what differs
    between one picture, (H, W, 3) uint8 with Y first, and the next where they differ least.
    """
    height, width = (side // SIDE * SIDE for side in pictures[0].shape[:2])
    if len(pictures) < 2 or not height * width:
        return 0.0
    # A large picture has as many patches as several small ones.
    pairs = min(MOST_PAIRS, max(3, MOST_PAIRS * SMALL_PX // (height * width)))
    every = max(1, len(pictures) // pairs)
    found = []
    for now, later in list(itertools.pairwise(pictures))[::every]:
        a, b = (p[:height, :width, 0].astype(np.int16) for p in (now, later))
        tiles = np.sort(_texture(a - b), axis=None)
        found.append(float(tiles[int(QUIET * len(tiles))]) / 2)
    return sorted(found)[len(found) // 2]


def _patch_sums(values: NDArray[np.int32]) -> Ints:
    """The sum over each patch of `SIDE` pixels that begins at every `STEP`-th pixel."""
    across, down = values.shape[1] // STEP, values.shape[0] // STEP
    tiles = values[: down * STEP, : across * STEP].reshape(down, STEP, across, STEP)
    total: Ints = tiles.sum(axis=(1, 3), dtype=np.int64)
    for axis in (0, 1):
        total = np.lib.stride_tricks.sliding_window_view(total, SIDE // STEP, axis).sum(
            axis=-1
        )
    return total


def _halved(luma: Image) -> list[Image]:
    """A picture and its halves down to `SMALLEST_SIDE`."""
    levels = [np.ascontiguousarray(luma)]
    while max(levels[-1].shape) > SMALLEST_SIDE:
        h, w = levels[-1].shape
        size = (max(1, w // 2), max(1, h // 2))
        levels.append(as_image(cv2.resize(levels[-1], size, interpolation=cv2.INTER_AREA)))
    return levels


def _without_light(small: Image) -> NDArray[np.int16]:
    """Each pixel's difference from its surroundings, levels."""
    around = cv2.blur(small, (15, 15))
    difference = small.astype(np.int16) - around
    clipped: NDArray[np.int16] = np.clip(difference, -64, 64)
    return clipped


def _at_large(view: NDArray[np.int16], picture: NDArray[np.int16]) -> Shift:
    """The shift of the smallest mean difference over what both show; of equal ones the nearest."""
    height, width = view.shape
    most_x, most_y = int(MOST_SHIFT * width), int(MOST_SHIFT * height)
    best, least = (0, 0), np.inf
    for dy in range(-most_y, most_y + 1):
        a, b = _overlap(view, picture, dy, axis=0)
        for dx in range(-most_x, most_x + 1):
            c, d = _overlap(a, b, dx, axis=1)
            difference = np.minimum(np.abs(c - d), MOST_DIFFERENCE)
            mean = int(difference.sum(dtype=np.int64)) / difference.size
            if (mean, abs(dx) + abs(dy)) < (least, abs(best[0]) + abs(best[1])):
                best, least = (dx, dy), mean
    return best


def _overlap(
    view: NDArray[np.int16], picture: NDArray[np.int16], shift: int, axis: int
) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
    """What both show along an axis if the picture is shifted."""
    n = view.shape[axis]
    ours = slice(max(0, -shift), min(n, n - shift))
    theirs = slice(max(0, shift), min(n, n + shift))
    if axis:
        return view[:, ours], picture[:, theirs]
    return view[ours], picture[theirs]


def shifted(picture: Image, shift: Shift, elsewhere: Image) -> Image:
    """A picture moved right and down by a shift; what it does not show is that of ``elsewhere``."""
    dx, dy = shift
    height, width = picture.shape[:2]
    result = elsewhere.copy()
    result[max(0, dy) : height + min(0, dy), max(0, dx) : width + min(0, dx)] = picture[
        max(0, -dy) : height - max(0, dy), max(0, -dx) : width - max(0, dx)
    ]
    return result
