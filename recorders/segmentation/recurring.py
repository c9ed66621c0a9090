"""The background behind those who stand before it for most of the time: what comes back.

The most common value of a pixel (`recorders.segmentation.background.most_common`) is a body's
where bodies stand at one place, one after another, for more than half of the recording. But each
of them comes and goes, and between them the background is seen again: from the first sample to
the last, and in most parts of the recording.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

Bools = NDArray[np.bool_]
Floats = NDArray[np.float64]

ALIKE = 24
"""Colours of one thing differ by at most this (`weigh`): what a background does by itself."""
MIN_AWAY = 0.3
"""A pixel is in doubt where this share of the samples differs from its most common value."""
MOST_IN_DOUBT = 0.3
"""Where more of the picture than this is in doubt, it is not bodies that change it."""
WEAK_MARGIN = -0.1
"""Beside such pixels it gives way to one that recurs nearly as well: all visitors' hair is dark."""
ENOUGH = 0.1
"""It is so in a region of which at least this share are such pixels: who stands there covers it.
Where animals come and go a few of them are scattered over a region that is none.
"""
CANDIDATES, SEGMENTS = 12, 12
"""Colours that are tried: those of so many samples. Parts of the recording that are counted."""
MARGIN = 0.15
"""The most common value stays unless another one recurs by this much better: of 2, the share of
the parts in which it is seen plus the share of the time from its first to its last sighting.
"""
FEWEST = 2 * SEGMENTS
"""Of fewer samples nothing recurs."""


def weigh(difference: Image) -> Image:
    """One number for a difference in Y, Cr, Cb, (H, W, 3) uint8 -> (H, W) uint8: |dY| + 2 (|dCr|
    + |dCb|).
    """
    dy, dr, db = cv2.split(difference)
    chroma = cv2.add(dr, db)
    return as_image(cv2.add(dy, cv2.add(chroma, chroma)))


def _difference(a: Image, b: Image) -> Image:
    return as_image(cv2.absdiff(a, b))


def recurring(stack: list[Image], colour: Image) -> tuple[Image, Image]:
    """The background, where another colour than the most common one recurs better.

    Args:
        stack: pictures in the order of time, (H, W, 3) uint8 in Y, Cr, Cb.
        colour: the most common values, the same; not changed.

    Returns:
        The background, and 255 where it is another than ``colour``, (H, W) uint8.
    """
    other = np.zeros(colour.shape[:2], np.uint8)
    if len(stack) < FEWEST:
        return colour, other
    shifts = [light_shift(picture, colour) for picture in stack]
    away = np.zeros(colour.shape[:2], np.uint16)
    for picture, shift in zip(stack, shifts, strict=True):
        away += weigh(_difference(shifted(picture, -shift), colour)) > ALIKE
    rows, columns = np.nonzero(away >= MIN_AWAY * len(stack))
    if not len(rows) or len(rows) > MOST_IN_DOUBT * away.size:
        return colour, other
    values = [
        shifted(p[rows, columns][:, None], -s) for p, s in zip(stack, shifts, strict=True)
    ]
    found, better = _best(values, colour[rows, columns][:, None])
    weak, strong = np.zeros_like(other), np.zeros_like(other)
    weak[rows, columns] = better > WEAK_MARGIN
    strong[rows, columns] = better > MARGIN
    changed = _beside(weak, strong)[rows, columns]
    result = colour.copy()
    result[rows[changed], columns[changed]] = found[changed, 0]
    other[rows[changed], columns[changed]] = 255
    return result, other


def light_shift(picture: Image, colour: Image) -> int:
    """The median difference in brightness of a picture from the background, levels; 0 under 2."""
    step = max(1, min(picture.shape[:2]) // 96)
    difference = picture[::step, ::step, 0].astype(np.int16) - colour[::step, ::step, 0]
    counts = np.bincount((difference + 255).ravel(), minlength=511)
    shift = int(np.searchsorted(np.cumsum(counts), difference.size / 2)) - 255
    return shift if abs(shift) >= 2 else 0


def shifted(picture: Image, shift: int) -> Image:
    """A picture with its brightness shifted."""
    if not shift:
        return picture
    moved = picture.copy()
    moved[..., 0] = np.clip(picture[..., 0].astype(np.int16) + shift, 0, 255)
    return moved


def _beside(weak: Image, strong: Image) -> Bools:
    """The regions of ``weak`` pixels of which `ENOUGH` are ``strong``, (H, W)."""
    count, labels = cv2.connectedComponents(weak, connectivity=8)
    of_strong = np.bincount(labels[strong > 0], minlength=count)
    held = of_strong >= ENOUGH * np.bincount(labels.ravel(), minlength=count)
    held[0] = False
    there: Bools = held[labels]
    return there


def _best(values: list[Image], usual: Image) -> tuple[Image, Floats]:
    """The other colour of each pixel that recurs best, and by how much better than the usual one,
    (P,).

    Args:
        values: each sample's colours, (P, 1, 3) uint8.
        usual: the most common ones, the same.
    """
    n = len(values)
    base, _ = _recurrence(values, usual)
    best, count = np.full(len(usual), -1.0), np.zeros(len(usual), np.int64)
    found = usual.copy()
    for k in range(CANDIDATES):
        colour = values[(2 * k + 1) * n // (2 * CANDIDATES)]
        score, seen = _recurrence(values, colour)
        score[weigh(_difference(colour, usual))[:, 0] <= ALIKE] = -1.0
        better = (score > best) | ((score == best) & (seen > count))
        found[better], best[better], count[better] = (
            colour[better],
            score[better],
            seen[better],
        )
    return _settled(values, found), best - base


def _recurrence(values: list[Image], colour: Image) -> tuple[Floats, NDArray[np.int64]]:
    """How well each colour recurs, (P,) in [0, 2], and in how many samples it is seen, (P,)."""
    n, points = len(values), len(colour)
    first = np.full(points, n)
    last = np.full(points, -1)
    seen = np.zeros(points, np.int64)
    parts = np.zeros(points, np.int64)
    in_part = np.zeros(points, bool)
    for k, value in enumerate(values):
        there = weigh(_difference(value, colour))[:, 0] <= ALIKE
        seen += there
        last[there] = k
        np.minimum(first, np.where(there, k, n), out=first)
        in_part |= there
        if (k + 1) * SEGMENTS // n != k * SEGMENTS // n:
            parts += in_part
            in_part[:] = False
    span = np.maximum(last - first + 1, 0)
    return parts / SEGMENTS + span / n, seen


def _settled(values: list[Image], colour: Image) -> Image:
    """The mean of the samples that are like each colour, (P, 1, 3) uint8."""
    total = np.zeros(colour.shape, np.int64)
    count = np.zeros((len(colour), 1, 1), np.int64)
    for value in values:
        there = (weigh(_difference(value, colour)) <= ALIKE)[..., None]
        total += value * there
        count += there
    settled: Image = (total // np.maximum(count, 1)).astype(np.uint8)
    return settled
