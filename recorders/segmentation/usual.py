"""How large bodies usually are, by the place of their feet: learnt from those that are seen clean.

A clean sighting is a region of the mask that stands alone, keeps its size for a moment, lies in
the picture whole, and rather moves than rests. Specks, flicker, pieces of bodies, merged bodies and what a light
throws on a wall are not. Sightings count by their area: specks outnumber bodies. No shape is
assumed: cars, mice and flies have a usual size, too, and one seen from above has the same
everywhere.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

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
MOVED = 0.02
"""It moves if by this share of its size."""
RESTING = 0.05
"""One that rests counts so much of one that moves: it may be a light on a wall."""
FEWEST, FEWEST_MOVING = 5, 3
"""Fewer sightings teach nothing, nor do those of which fewer move."""
SAME_PLACE, SAME_SIZE = 0.5, 0.4
"""Sightings are alike with centres within this share of their size, and sizes within this
logarithm."""
PLACES = 25
NEARBY = 0.1
"""Sightings teach about places within this share of the picture's height, and less farther off."""
MOST_LOOKED_AT = 300
"""Of more regions in one picture, the largest are looked at."""
MOST = 1500
"""Of more sightings, the latest are kept."""


@dataclass(frozen=True)
class UsualSize:
    """Usual width, height (px) and area (px^2) of a body whose feet are at a place.

    Attributes:
        feet: (K,) y of the feet, px, rising.
        sizes: (K, 3) width, height, area.
    """

    feet: Floats
    sizes: Floats

    def at(self, feet: Floats) -> tuple[Floats, Floats, Floats]:
        """Width, height and area at feet (any shape, px); each of that shape."""
        w, h, area = (np.interp(feet, self.feet, self.sizes[:, k]) for k in range(3))
        return w, h, area

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

    def observe(self, now: Floats, later: Floats) -> None:
        """Take in the regions of two pictures, `MOMENT_S` apart.

        Args:
            now: (N, 5) x, y, w, h, area of the first one's.
            later: (M, 5) of the second one's.
        """
        now, later = largest(now), largest(later)
        if not len(now) or not len(later):
            return
        found = now[self._alone(now)]
        if not len(found):
            return
        overlap = ious(found[:, :4], later[:, :4])
        same = later[overlap.argmax(axis=1)]
        factor = np.abs(np.log(same[:, 2:5] / found[:, 2:5]))
        steady = (overlap.max(axis=1) >= SAME) & (
            factor <= (STEADY, STEADY, 2 * STEADY)
        ).all(axis=1)
        way = np.hypot(
            *(
                same[:, k] + same[:, k + 2] / 2 - found[:, k] - found[:, k + 2] / 2
                for k in (0, 1)
            )
        )
        moves = way >= MOVED * np.sqrt(found[:, 2] * found[:, 3])
        weight = np.where(moves, 1.0, RESTING)
        self._clean.append(np.column_stack([found, weight])[steady])

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

    def learn(self) -> UsualSize | None:
        """The usual size, or None where too few were seen clean."""
        if not self._clean:
            return None
        rows = np.concatenate(self._clean)[-MOST:]
        self._clean = [rows]
        if len(rows) < FEWEST or np.count_nonzero(rows[:, 5] == 1.0) < FEWEST_MOVING:
            return None
        feet = np.linspace(0.0, self.height, PLACES)
        off = (rows[:, 1] + rows[:, 3] - feet[:, None]) / (NEARBY * self.height)
        weights = rows[:, 4] * rows[:, 5] / _alike(rows) / (1.0 + np.abs(off) ** 3)
        return UsualSize(
            feet,
            np.array(
                [[median(rows[:, k], weight) for k in (2, 3, 4)] for weight in weights],
                np.float64,
            ),
        )


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
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def ious(a: Floats, b: Floats) -> Floats:
    """IoU of boxes (N, 4) x, y, w, h with (M, 4): (N, M)."""
    shared = np.ones((len(a), len(b)))
    for k in (0, 1):
        low = np.maximum(a[:, None, k], b[:, k])
        high = np.minimum((a[:, k] + a[:, k + 2])[:, None], b[:, k] + b[:, k + 2])
        shared *= np.maximum(high - low, 0.0)
    union = (a[:, 2] * a[:, 3])[:, None] + b[:, 2] * b[:, 3] - shared
    return shared / np.maximum(union, 1e-9)
