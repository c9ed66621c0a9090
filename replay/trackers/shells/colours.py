"""Colour histograms of objects: P(p|c) of SHELLS, equation 8.

One joint histogram over luma and both chromas, so that a red shirt with blue trousers is not a
purple coat. Chroma lies near its middle in most scenes; its bins are finer there. Everything is
8-bit tables, `bincount` and written-out sums: the same on every machine.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Bins = NDArray[np.uint16]

LUMA, CHROMA = 8, 16
BINS = LUMA * CHROMA * CHROMA
_SOFT = 0.002
"""Added to every bin, so that a colour never seen is unlikely, not impossible."""
LIMIT = 2.5
"""Largest log likelihood ratio that one pixel counts."""
_BODY = 0.9
"""Half axes of the ellipse that is looked at in a box without a mask, of the box's."""
MEMORY = 30
"""Updates after which a histogram forgets."""


def _table() -> NDArray[np.uint16]:
    """What each of luma and both chromas adds to the bin, (1, 256, 3)."""
    level = np.arange(256)
    luma = level * LUMA // 256
    # Bins of 5 levels; the first and the last take everything beyond.
    away = level - 128
    chroma = np.clip(
        CHROMA // 2 + np.sign(away) * np.minimum(np.abs(away) // 5, CHROMA // 2),
        0,
        CHROMA - 1,
    )
    return np.stack([luma * CHROMA * CHROMA, chroma * CHROMA, chroma], axis=1).astype(
        np.uint16
    )[None]


_TABLE = _table()


def bins_of(image: Image) -> Bins:
    """Every pixel's bin, (H, W) uint16 below `BINS`, of a (H, W, 3) uint8 BGR image."""
    tall = cv2.LUT(cv2.cvtColor(np.ascontiguousarray(image), cv2.COLOR_BGR2YCrCb), _TABLE)
    return np.asarray(tall[:, :, 0] + tall[:, :, 1] + tall[:, :, 2])


def histogram(bins: Bins, own: NDArray[np.bool_]) -> Floats:
    """Histogram (BINS,) of the pixels of a mask, of sum 1; all 0 for an empty mask."""
    counts = np.bincount(bins[own], minlength=BINS).astype(np.float64)
    return np.asarray(counts / max(1.0, float(counts.sum())))


def colours_in(
    box: Sequence[float], image: Image | None, mask: Image | None = None
) -> Floats | None:
    """Histogram of the foreground in a box; without a mask of the ellipse in it, where most of a
    body is.

    None without a picture, or where hardly a pixel of the box is in it.
    """
    if image is None:
        return None
    height, width = image.shape[:2]
    x, y, w, h = box
    x1, y1, x2, y2 = (
        max(0, round(x)),
        max(0, round(y)),
        min(width, round(x + w)),
        min(height, round(y + h)),
    )
    if x2 - x1 < 2 or y2 - y1 < 2:
        return None
    if mask is not None:
        own = mask[y1:y2, x1:x2] > 0
    else:
        u, v = (
            (np.arange(x1, x2) + 0.5 - x) / w * 2 - 1,
            (np.arange(y1, y2) + 0.5 - y) / h * 2 - 1,
        )
        own = (u * u)[None, :] + (v * v)[:, None] <= _BODY * _BODY
    return histogram(bins_of(image[y1:y2, x1:x2]), own) if own.any() else None


def without_colours(table: Floats) -> Floats:
    """A histogram as a camera that shows no colours would see it: brightness alone."""
    out = np.zeros((LUMA, CHROMA, CHROMA))
    middle = CHROMA // 2
    out[:, middle, middle] = table.reshape(LUMA, CHROMA * CHROMA).sum(axis=1)
    return out.reshape(BINS)


def tell(tables: Sequence[Floats | None]) -> list[Floats | None]:
    """Each object's log likelihood ratio of every bin against the mean of all, within `LIMIT`.

    The common denominator leaves equation 6 as it is and makes a colour that all of them have
    worth nothing. None for objects whose colours are not known; all None where fewer than two are
    known.
    """
    known = [t for t in tables if t is not None]
    if len(known) < 2:
        return [None] * len(tables)
    mean = np.zeros(BINS)
    for table in known:
        mean += table / len(known)
    return [
        None if t is None else np.clip(np.log((t + _SOFT) / (mean + _SOFT)), -LIMIT, LIMIT)
        for t in tables
    ]


def against(mine: Floats, other: Floats, seen: Floats) -> float:
    """How much seen pixels (BINS,) speak for one histogram against another: mean log likelihood
    ratio per pixel.
    """
    ratio = np.clip(np.log((mine + _SOFT) / (other + _SOFT)), -LIMIT, LIMIT)
    return float((seen * ratio).sum())


def distance(a: Floats, b: Floats) -> float:
    """Hellinger distance of two histograms of sum 1, in [0, 1]."""
    return float(np.sqrt(max(0.0, 1.0 - float(np.sqrt(a * b).sum()))))


def signature(table: Floats) -> list[int]:
    """A compact form for `recorders.messages.Target.signature`: 4 lumas by 8 by 8 chromas, counts
    of 1000.
    """
    # Eight bins make one, added two by two: a third of the time of a sum over three axes.
    pairs = table.reshape(LUMA // 2, 2, CHROMA // 2, 2, CHROMA // 2, 2)
    pairs = pairs[..., 0] + pairs[..., 1]
    coarse = pairs[:, 0, :, 0] + pairs[:, 0, :, 1] + pairs[:, 1, :, 0] + pairs[:, 1, :, 1]
    counts: list[int] = np.rint(coarse * 1000).astype(np.int64).ravel().tolist()
    return counts
