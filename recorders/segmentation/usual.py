"""How large bodies usually are, by the place of their feet: learnt from those that are seen clean.

A clean sighting is a region of the mask that stands alone, keeps its size for a moment, lies in
the picture whole, and rather moves than rests. Specks, flicker, pieces of bodies, merged bodies and what a light
throws on a wall are not. Sightings count by their area: specks outnumber bodies. No shape is
assumed: cars, mice and flies have a usual size, too, and one seen from above has the same
everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from recorders.segmentation.sizes import SizeModel
from recorders.segmentation.torn import STANDING, TORN, TORN_GAP, going_together, joined

Floats = NDArray[np.float64]

MOMENT_S = 0.12
"""Time between the two looks at a sighting."""
RING = 0.35
"""Whatever stands alone has this free around it, of its width and height."""
FREE = 0.1
"""So much of its area, there at most."""
STEADY = 0.15
"""It keeps width and height within this factor's logarithm; its area within twice that."""
SAME = 0.3
"""The same thing a moment later: the boxes' IoU."""
LEAP = 2.0
"""Or, small and fast, its like (to `GRAIN` px, and `STEADY` of its size, as legs change a small
width by a third) no farther off than so many of its sizes, where a fifth of what stands alone has
one: of specks of noise one in a hundred has.
"""
GRAIN, FOUND_AGAIN = 1.5, 5
MOVED = 0.02
"""It moves if both its edges go the same way, by this share of its size: of a stain of light one
edge comes and goes.
"""
RESTING = 0.05
"""One that rests counts so much of one that moves: it may be a light on a wall."""
FEWEST, FEWEST_MOVING = 5, 2
"""Fewer sightings teach nothing, nor do those of which fewer move."""
SAME_PLACE, SAME_SIZE = 0.5, 0.4
"""Sightings are alike with centres within this share of their size, and sizes within this
logarithm."""
MAX_AREA_SPREAD = 2.0
"""Bodies are alike where three quarters of them are not larger than this many times the first
quarter.
"""
LEVEL = 1.5
"""Who is seen from above is no larger than this many times in one half of the picture than in the
other.
"""
UPRIGHT = 0.8
"""Bodies are upright where this share of the area that was seen of them is higher than wide."""
AS_HIGH = 1.5
"""Who is upright is as high as those at his place, to this factor."""
PLACES = 25
NEARBY = 0.1
"""Sightings teach about places within this share of the picture's height, and less farther off."""
MOST_LOOKED_AT = 300
"""Of more regions in one picture, the largest are looked at."""
MOST_OF_ALL = 40
"""So many regions of a picture, the largest, say what most of its foreground belongs to."""
SPECK = 0.1
"""What has less than this share of the area of what most of the foreground nearby belongs to is no
body, however clean it is seen: leaves, bedding, a tail, a light.
"""
MOST = 1500
"""Of more sightings, the latest are kept."""


GAP = 0.35
"""Between the pieces of a body lies at most this, of the usual height, unless bodies are torn."""


@dataclass(frozen=True)
class UsualSize:
    """Usual width, height (px) and area (px^2) of a body whose feet are at a place.

    Attributes:
        feet: (K,) y of the feet, px, rising.
        sizes: (K, 3) width, height, area.
        alike: (K,) 1 where bodies there are alike, so that two of them have twice the area of one;
            else 0.
        gap: between the pieces of a body lies at most this, of the usual height.
        halves: what lies above or below a wide piece may be its other half. Not over the gaps of
            torn bodies, where it may be a crowd's.
        turning: bodies are seen from above, all of one size: each is as wide and as high as it is
            long, as it turns.
    """

    feet: Floats
    sizes: Floats
    alike: Floats
    gap: float = GAP
    halves: bool = True
    turning: bool = False

    def at(self, feet: Floats) -> tuple[Floats, Floats, Floats]:
        """Width, height and area at feet (any shape, px); each of that shape."""
        w, h, area = (np.interp(feet, self.feet, self.sizes[:, k]) for k in range(3))
        return w, h, area

    def body_areas(self, feet: Floats) -> Floats:
        """The area of one body at feet (any shape, px), 0 where bodies are not alike."""
        area = np.interp(feet, self.feet, self.sizes[:, 2])
        return np.where(np.interp(feet, self.feet, self.alike) >= 0.5, area, 0.0)

    @property
    def least_area(self) -> float:
        """The smallest usual area, px^2."""
        return float(self.sizes[:, 2].min())


@dataclass
class Sightings:
    """What was seen of the bodies of a recording, in pictures of one size."""

    width: int
    height: int
    _clean: list[Floats] = field(default_factory=list)
    _all: list[Floats] = field(default_factory=list)
    _leaps: list[Floats] = field(default_factory=list)
    _looked_for: int = 0
    _joined: list[Floats] = field(default_factory=list)
    _moved: float = 0.0
    _in_pieces: float = 0.0

    def observe(self, now: Floats, later: Floats) -> None:
        """Take in the regions of two pictures, `MOMENT_S` apart.

        Args:
            now: (N, 5) x, y, w, h, area of the first one's.
            later: (M, 5) of the second one's.
        """
        now, later = largest(now), largest(later)
        some = largest(now, MOST_OF_ALL)
        self._all.append(np.column_stack([some, some[:, 4] / max(1.0, some[:, 4].sum())]))
        if not len(now) or not len(later):
            return
        alone = self._alone(now)
        if not alone.any():
            return
        every = ious(now[:, :4], later[:, :4])
        found, overlap = now[alone], every[alone]
        self._leaps.append(_found_again(found[overlap.max(axis=1) < SAME], later))
        self._looked_for += len(found)
        same = later[overlap.argmax(axis=1)]
        factor = np.abs(np.log(same[:, 2:5] / found[:, 2:5]))
        steady = (overlap.max(axis=1) >= SAME) & (
            factor <= (STEADY, STEADY, 2 * STEADY)
        ).all(axis=1)
        way = np.hypot(*(_way(found, same, k) for k in (0, 1)))
        moves = (way > 0) & (way >= MOVED * np.sqrt(found[:, 2] * found[:, 3]))
        weight = np.where(moves, 1.0, RESTING)
        self._clean.append(np.column_stack([found, weight])[steady])
        self._join(now, later, every, alone)

    def _join(
        self, now: Floats, later: Floats, overlap: Floats, alone: NDArray[np.bool_]
    ) -> None:
        """Take in the bodies whose pieces go together, and how much of what stands alone does."""
        same = later[overlap.argmax(axis=1)]
        way = same[:, 0] + same[:, 2] / 2 - now[:, 0] - now[:, 2] / 2
        kept = np.abs(np.log(same[:, 4] / now[:, 4])) <= 2 * STEADY
        way[(overlap.max(axis=1) < SAME) | ~kept] = 0.0
        first = going_together(now, way)
        area = now[:, 4] * (alone & (way != 0.0))
        self._moved += float(area.sum())
        self._in_pieces += float(area[np.bincount(first)[first] > 1].sum())
        bodies = joined(now, first)
        self._joined.append(np.column_stack([bodies, np.ones(len(bodies))]))

    @property
    def torn(self) -> bool:
        """Bodies that stand are seen in pieces that go together."""
        if not self._in_pieces or self._in_pieces < TORN * self._moved:
            return False
        _, _, w, h, area, *_ = np.concatenate(self._joined).T
        return float(quantile(w / h, area, 0.5)) <= STANDING

    @property
    def count(self) -> int:
        """How many were seen clean."""
        return sum(len(rows) for rows in self._clean)

    def _alone(self, b: Floats) -> NDArray[np.bool_]:
        """Regions with little beside them that lie in the picture whole."""
        x, y, w, h, area = b.T
        whole = (x >= 2) & (y >= 2) & (x + w <= self.width - 2) & (y + h <= self.height - 2)
        gx, gy = RING * np.maximum(w, h / 2), RING * np.maximum(h, w / 2)
        beside = x < (x + w + gx)[:, None]
        beside &= x + w > (x - gx)[:, None]
        beside &= y < (y + h + gy)[:, None]
        beside &= y + h > (y - gy)[:, None]
        alone: NDArray[np.bool_] = whole & (
            (beside * area).sum(axis=1) - area <= FREE * area
        )
        return alone

    def learn(self, *, upright: SizeModel | None = None) -> UsualSize | None:
        """The usual size, or None where too few were seen clean.

        Args:
            upright: how high bodies are, where they are upright on a plane: who is lower or higher
                is a head, legs, or several.
        """
        if not self._clean:
            return None
        rows = np.concatenate(self._clean)[-MOST:]
        self._clean = [rows]
        if self.torn:
            self._joined = [np.concatenate(self._joined)[-MOST:]]
            found = self._of(self._joined[0], upright)
            if found is not None:
                return replace(found, gap=TORN_GAP, halves=False)
        return self._of(self._with_leaps(rows), upright)

    def _with_leaps(self, rows: Floats) -> Floats:
        """Clean sightings, and those of what moved by more than itself where these are more, and
        enough of what was looked for: in the recording, or, as small ones are far away, with their
        feet nearby.
        """
        leaps = np.concatenate(self._leaps)[-MOST:]
        self._leaps = [leaps]
        if FOUND_AGAIN * (len(rows) + len(leaps)) < min(self._looked_for, MOST):
            return rows
        if len(leaps) <= len(rows):
            feet = leaps[:, 1] + leaps[:, 3]
            here, there = (
                (np.abs(feet[:, None] - b[:, 1] - b[:, 3]) <= NEARBY * self.height).sum(
                    axis=1
                )
                for b in (leaps, rows)
            )
            leaps = leaps[(here > there) & (here >= FEWEST)]
        return np.concatenate([rows, leaps])

    def _of(self, rows: Floats, upright: SizeModel | None) -> UsualSize | None:
        """The usual size of clean sightings (N, 6)."""
        rows = rows[rows[:, 4] >= SPECK * self._common(rows[:, 1] + rows[:, 3])]
        if upright is not None:
            share = rows[:, 3] / upright.heights(rows[:, 1] + rows[:, 3])
            rows = rows[(share >= 1 / AS_HIGH) & (share <= AS_HIGH)]
        if len(rows) < FEWEST or np.count_nonzero(rows[:, 5] == 1.0) < FEWEST_MOVING:
            return None
        feet = np.linspace(0.0, self.height, PLACES)
        weights = np.tile(rows[:, 4] * rows[:, 5] / _alike(rows), (PLACES, 1))
        turning = _from_above(rows, weights[0])
        if turning:
            longest = rows[:, 2:4].max(axis=1)
            rows = np.column_stack([rows[:, :2], longest, longest, rows[:, 4:]])
        else:
            weights = weights * self._near(feet, rows)
        sizes, alike = _sizes(rows, weights), _alike_at(rows, weights)
        return UsualSize(feet, sizes, alike, turning=turning)

    def guess(self) -> UsualSize | None:
        """What most of the foreground belongs to, clean or not: better than nothing where bodies
        are seldom seen clean; None where there is no foreground.
        """
        rows = np.concatenate(self._all) if self._all else np.zeros((0, 6))
        if len(rows) < FEWEST:
            return None
        feet = np.linspace(0.0, self.height, PLACES)
        weights = rows[:, 5] * self._near(feet, rows)
        return UsualSize(feet, _sizes(rows, weights), _alike_at(rows, weights))

    def _common(self, feet: Floats) -> Floats:
        """The area of what most of the foreground with its feet near each of some places (N,)
        belongs to, px^2, (N,): of whatever was seen, clean or not.
        """
        rows = np.concatenate(self._all)
        places = np.linspace(0.0, self.height, PLACES)
        weights = rows[:, 5] * self._near(places, rows)
        common = [median(rows[:, 4], w) for w in weights]
        return np.interp(feet, places, np.array(common, np.float64))

    def _near(self, places: Floats, rows: Floats) -> Floats:
        """How much each row (N, 5+) tells of bodies with their feet at each place (K,): (K, N)."""
        off = (rows[:, 1] + rows[:, 3] - places[:, None]) / (NEARBY * self.height)
        near: Floats = 1.0 / (1.0 + np.abs(off) ** 3)
        return near


def _way(now: Floats, later: Floats, axis: int) -> Floats:
    """How far regions (N, 5) go along an axis, px, (N,): as far as both of their edges do; 0 where
    they go opposite ways or one stays.
    """
    low = later[:, axis] - now[:, axis]
    high = low + later[:, axis + 2] - now[:, axis + 2]
    way: Floats = np.where(low * high > 0, np.minimum(np.abs(low), np.abs(high)), 0.0)
    return way


def _found_again(found: Floats, later: Floats) -> Floats:
    """Those regions (N, 5) that have their like nearby in the later picture, (M, 5), each one of
    theirs: (K, 6) with weight 1.
    """
    size = np.sqrt(found[:, 2] * found[:, 3])
    far = np.hypot(
        *(
            found[:, None, k]
            + found[:, None, k + 2] / 2
            - later[:, k]
            - later[:, k + 2] / 2
            for k in (0, 1)
        )
    )
    off = np.abs(found[:, None, 2:4] - later[:, 2:4])
    grain = np.maximum(GRAIN, STEADY * size)[:, None, None]
    like = (off <= np.maximum(grain, STEADY * found[:, None, 2:4])).all(axis=-1)
    like &= far <= LEAP * size[:, None]
    # One has one like, and is it to no other.
    kept = (like.sum(axis=1) == 1) & (like[:, like.sum(axis=0) == 1].sum(axis=1) == 1)
    return np.column_stack([found[kept], np.ones(int(kept.sum()))])


def _sizes(rows: Floats, weights: Floats) -> Floats:
    """Width, height and area at K places, (K, 3), of rows (N, 5+) x, y, w, h, area that weigh
    (K, N).
    """
    return np.array(
        [[median(rows[:, k], w) for k in (2, 3, 4)] for w in weights], np.float64
    )


def _alike_at(rows: Floats, weights: Floats) -> Floats:
    """1 at each of K places where what was seen there has much the same area, else 0: as `_sizes`.
    Nowhere where bodies are upright: they do not lie side by side, but hide one another.
    """
    upright = rows[:, 3] > rows[:, 2]
    if rows[upright, 4].sum() >= UPRIGHT * rows[:, 4].sum():
        return np.zeros(len(weights))
    low, high = (
        np.array([quantile(rows[:, 4], w, share) for w in weights])
        for share in (0.25, 0.75)
    )
    return (high <= MAX_AREA_SPREAD * low).astype(np.float64)


def _from_above(rows: Floats, weights: Floats) -> bool:
    """Whether bodies (N, 5+) that weigh (N,) are seen from above: all are alike, and those farther up
    in the picture as those farther down. Then one size holds everywhere, and as they turn they are
    as wide as they are high: a few of them in each place say neither.
    """
    if not _alike_at(rows, weights[None]).all():
        return False
    feet = rows[:, 1] + rows[:, 3]
    far = feet <= np.median(feet)
    if far.all():
        return True
    a, b = (median(rows[part, 4], weights[part]) for part in (far, ~far))
    return max(a, b) <= LEVEL * min(a, b)


def _alike(rows: Floats) -> Floats:
    """How many sightings have the place and the size of each, itself among them, (N,): what repeats
    in place counts once.
    """
    x, y, w, h = rows[:, :4].T
    size = np.sqrt(w * h)
    near = np.abs(np.log(size[:, None] / size)) <= SAME_SIZE
    reach = SAME_PLACE * size[:, None]
    for centre in (x + w / 2, y + h / 2):
        near &= np.abs(centre[:, None] - centre) <= reach
    count: Floats = near.sum(axis=1).astype(np.float64)
    return count


def largest(rows: Floats, most: int = MOST_LOOKED_AT) -> Floats:
    """The rows (N, 5) of the largest areas, at most so many, in their order (the first of equals)."""
    if len(rows) <= most:
        return rows
    return rows[np.sort(np.argsort(-rows[:, 4], kind="stable")[:most])]


def median(values: Floats, weights: Floats) -> float:
    """The weighted lower median."""
    return quantile(values, weights, 0.5)


def quantile(values: Floats, weights: Floats, share: float) -> float:
    """The least value such that values up to it have this share of all weight."""
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] * share)])


def ious(a: Floats, b: Floats) -> Floats:
    """IoU of boxes (N, 4) x, y, w, h with (M, 4): (N, M)."""
    shared = np.ones((len(a), len(b)))
    for k in (0, 1):
        low = np.maximum(a[:, None, k], b[:, k])
        high = np.minimum((a[:, k] + a[:, k + 2])[:, None], b[:, k] + b[:, k + 2])
        shared *= np.maximum(high - low, 0.0)
    union = (a[:, 2] * a[:, 3])[:, None] + b[:, 2] * b[:, 3] - shared
    return shared / np.maximum(union, 1e-9)
