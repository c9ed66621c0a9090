"""Appearance models: 8-bit colour histograms, the features that tell best, back projection, mean
shift.

A target's colours are kept as one histogram per feature and half of its body (above and below the
middle), weighted towards the ellipse's centre (EVENTS 2). Which features tell a target from what
is around it is decided online by the variance ratio of their log likelihood ratios; the best are
projected back onto the picture.

Only 8-bit conversions, integer tables, `bincount` and written-out sums are used, so results are
the same on every machine.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.vision import cv2

Floats = NDArray[np.float64]

FEATURES = ("luma", "red-luma", "blue-luma", "blue", "green", "red", "saturation")
BINS = 32
HALVES = 2
CHOSEN = 3
"""Features that are projected back."""
BRIGHTNESS, SIGNATURE = HALVES * BINS // 2, 3 * HALVES * BINS // 2
"""Length of a signature's first part, the luma, and of the whole one."""
_SOFT = 0.01
"""Added to every bin, so that a colour never seen is unlikely, not impossible."""
_LIMIT = 2.0
"""Largest log likelihood ratio that counts."""
_CHROMATIC, _NEUTRAL = slice(1, 3), BINS // 2
_COLOURLESS = 0.998
"""Share of neutral chroma from which on a camera shows no colours: clothes always have a few."""


def _chroma_table() -> Image:
    """Chroma lies close to its middle in most scenes, so its bins are four times as fine there."""
    stretched = (np.arange(256) - 128) * 4 // 8 + BINS // 2
    return np.clip(stretched, 0, BINS - 1).astype(np.uint8)


_LUMA = (np.arange(256) * BINS // 256).astype(np.uint8)
_CHROMA = _chroma_table()


def bins_of(image: Image, wanted: Collection[int] = range(len(FEATURES))) -> Image:
    """Every feature's bin of every pixel, (features, H, W) uint8 below `BINS`, from a (H, W, 3)
    uint8 BGR image.

    Features that are not ``wanted`` are left undefined.
    """
    out = np.empty((len(FEATURES), *image.shape[:2]), np.uint8)
    if any(k < 3 for k in wanted):
        tall = cv2.split(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))
        for k, table in enumerate((_LUMA, _CHROMA, _CHROMA)):
            if k in wanted:
                out[k] = cv2.LUT(tall[k], table)
    if any(3 <= k < 6 for k in wanted):
        plain = cv2.split(cv2.LUT(image, _LUMA))
        out[3], out[4], out[5] = plain
    if 6 in wanted:
        out[6] = cv2.LUT(
            cv2.extractChannel(cv2.cvtColor(image, cv2.COLOR_BGR2HSV), 1), _LUMA
        )
    return out


@lru_cache(maxsize=4096)
def kernel(height: int, width: int) -> Floats:
    """Epanechnikov weights over the ellipse inscribed in a box, (H, W): 1 at the centre, 0 on and
    outside it.
    """
    y = ((np.arange(height) + 0.5) / height * 2 - 1)[:, None]
    x = ((np.arange(width) + 0.5) / width * 2 - 1)[None, :]
    return np.asarray(np.maximum(0.0, 1.0 - x * x - y * y))


@lru_cache(maxsize=4096)
def _offsets(height: int) -> NDArray[np.int64]:
    """Where each feature's and half's histogram starts, (features, H, 1)."""
    half = (np.arange(height) * HALVES // max(1, height))[None, :, None]
    return np.asarray((np.arange(len(FEATURES))[:, None, None] * HALVES + half) * BINS)


def histograms(bins: Image, weights: Floats) -> Floats:
    """Weighted histograms of a box's pixels by feature and half, (features, halves, BINS), not
    normalised.

    Args:
        bins: (features, H, W) as `bins_of` gives them.
        weights: (H, W) the pixels' weights.
    """
    features, height, width = bins.shape
    index = bins + _offsets(height)
    flat = np.bincount(
        index.ravel(),
        np.broadcast_to(weights, (features, height, width)).ravel(),
        features * HALVES * BINS,
    )
    return np.asarray(flat.reshape(features, HALVES, BINS), np.float64)


class Colours:
    """A target's colours: histograms by feature and half, blended over time.

    Attributes:
        table: (features, halves, BINS); each half of each feature sums to the half's share of the
            body.
        updates: how often it was learnt.
    """

    def __init__(self) -> None:
        self.table: Floats = np.zeros((len(FEATURES), HALVES, BINS))
        self.updates = 0

    def learn(self, seen: Floats, most: int = 20) -> None:
        """Blend in the histograms of one frame: a running mean that forgets after about ``most``
        updates.
        """
        total = float(seen[0].sum())
        if total <= 0:
            return
        if self.updates and colourless(seen) != colourless(self.table):
            # The camera went over to infrared, or back: what was learnt is true no more.
            self.table, self.updates = np.zeros_like(self.table), 0
        self.updates += 1
        self.table += (seen / total - self.table) / min(self.updates, most)

    @property
    def body(self) -> Floats:
        """The whole body's histogram of each feature, (features, BINS), each of sum 1."""
        return np.asarray(self.table.sum(axis=1))

    def signature(self) -> list[int]:
        """A compact form for `recorders.messages.Target.signature`: luma and chroma, two halves,
        16 bins each; of a picture without colours the chroma is 0.
        """
        coarse = self.table[:3].reshape(3, HALVES, BINS // 2, 2).sum(axis=3)
        if colourless(self.table):
            coarse[_CHROMATIC] = 0.0
        return [round(v) for v in (coarse * 1000).ravel().tolist()]

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"table": self.table.copy(), "updates": self.updates}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Colours:
        """Continue from what `state` gave."""
        colours = cls()
        colours.table = np.array(state["table"], np.float64).reshape(
            len(FEATURES), HALVES, BINS
        )
        colours.updates = state["updates"]
        return colours


def colourless(table: Floats) -> bool:
    """Whether histograms (features, halves, BINS) are of a picture without colours, as of a
    camera that sees by infrared.
    """
    if len(table) != len(FEATURES):
        return False
    chroma = table[_CHROMATIC]
    total = float(chroma.sum())
    return total > 0 and float(chroma[..., _NEUTRAL].sum()) >= _COLOURLESS * total


def distance(a: Floats, b: Floats) -> float:
    """Hellinger distance of two sets of histograms of the same shape, in [0, 1], mean over the
    features; where one of the two has no colours, of the brightness alone.
    """
    if colourless(a) != colourless(b):
        a, b = a[:1], b[:1]
    shared = np.sqrt(a * b).reshape(len(a), -1).sum(axis=1)
    total = np.sqrt(a.reshape(len(a), -1).sum(axis=1) * b.reshape(len(b), -1).sum(axis=1))
    likeness = shared / np.maximum(total, 1e-12)
    return float(np.sqrt(np.maximum(0.0, 1.0 - likeness)).mean())


def ratios(target: Floats, others: Floats) -> Floats:
    """Log likelihood ratios of every bin, (features, BINS) within `_LIMIT`: target against
    others.
    """
    return np.asarray(np.clip(np.log((target + _SOFT) / (others + _SOFT)), -_LIMIT, _LIMIT))


def choose(target: Floats, others: Floats, count: int = CHOSEN) -> list[int]:
    """The features that tell the target from others best, best first; of equals the first.

    The variance ratio: the spread of the log likelihood ratio over both together, over its spread
    within each.
    """
    tell = ratios(target, others)

    def spread(p: Floats) -> Floats:
        mean = (p * tell).sum(axis=1)
        return np.asarray((p * tell * tell).sum(axis=1) - mean * mean)

    ratio = spread((target + others) / 2) / (spread(target) + spread(others) + 1e-3)
    return [int(k) for k in np.argsort(-ratio, kind="stable")[:count]]


def back_project(
    bins: Image, target: Floats, others: Floats, chosen: Sequence[int]
) -> NDArray[np.float32]:
    """How much each pixel looks like the target rather than like others, (H, W) float32 in [-1,
    1].
    """
    tell = np.zeros((len(bins), 256), np.int16)
    tell[:, :BINS] = np.rint(ratios(target, others) * (64 / _LIMIT))
    total = np.zeros(bins.shape[1:], np.int16)
    for k in chosen:
        total += cv2.LUT(bins[k], tell[k])
    return np.asarray(total.astype(np.float32) * np.float32(1 / (64 * max(1, len(chosen)))))


def mean_shift(
    likeness: NDArray[np.float32], box: tuple[float, float, float, float], steps: int = 10
) -> tuple[tuple[float, float, float, float], float]:
    """Move a box (x, y, w, h) to where its pixels look most like the target.

    Args:
        likeness: (H, W), as `back_project` gives it; what is below 0 does not pull.
        box: in the image's own pixels.
        steps: at most so many.

    Returns:
        The box at the end, and the mean likeness within its ellipse there, in [-1, 1].
    """
    x, y, w, h = box
    height, width = likeness.shape
    columns, rows = max(1, round(w)), max(1, round(h))
    score = -1.0
    for _ in range(steps):
        left, top = round(x), round(y)
        x1, y1, x2, y2 = (
            max(0, left),
            max(0, top),
            min(width, left + columns),
            min(height, top + rows),
        )
        if x2 <= x1 or y2 <= y1:
            return (x, y, w, h), -1.0
        inside = kernel(rows, columns)[y1 - top : y2 - top, x1 - left : x2 - left]
        part = likeness[y1:y2, x1:x2]
        score = float((inside * part).sum() / max(1e-9, float(inside.sum())))
        pull = np.maximum(part, 0.0)
        mass = float(pull.sum())
        if mass <= 0:
            break
        dx = float((pull.sum(axis=0) * (np.arange(x1, x2) + 0.5)).sum()) / mass - (
            x + w / 2
        )
        dy = float((pull.sum(axis=1) * (np.arange(y1, y2) + 0.5)).sum()) / mass - (
            y + h / 2
        )
        x, y = x + dx, y + dy
        if dx * dx + dy * dy < 0.25:
            break
    return (x, y, w, h), score
