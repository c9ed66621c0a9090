"""Whoever stood in the background when it was learnt and has left is no ground: what he hid is.

Who stands in one place for most of a recording is most common there. From when he leaves, the
ground that he hid would stand out from the background in his shape: a ghost, while he was never
seen. Which of the two is the ground its surroundings tell: the ground goes on across the outline,
and a body ends there.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.recurring import weigh
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

LEAST_SHARE = 0.1
"""The other colours are seen in this share of the pictures at least,"""
MOST_CHANGES = 3
"""and come or go no more often than so: leaves, water and people who pass do all the time."""
WHOLLY = 0.8
"""They are seen where so much of the place differs from the background."""
LEAST_SIDE = 0.04
"""Length of a body's shorter side, of the picture's, from which on it is asked."""
ACROSS = 0.6
"""The other colours are the ground where they differ from what is outside by less than this, of what
the background's own do.
"""
RIM_PX = 2
"""So far inside and outside of an outline colours are compared: at the very edge a codec mixes them."""
ALIKE_LEVELS = 12
"""Pictures show the same where brightness and colours differ by less than this on average."""


def without_who_left(
    stack: list[Image], colour: Image, levels: Image
) -> tuple[Image, NDArray[np.bool_]]:
    """A background without those who stood in it for most of the time, and then left or had come.

    Args:
        stack: pictures (H, W, 3) uint8 in Y, Cr, Cb, in the order of time.
        colour: (H, W, 3) uint8, the background that was learnt from them.
        levels: (H, W) uint8, the least difference that is foreground.

    Returns:
        The background, and where it was changed, (H, W).
    """
    height, width = colour.shape[:2]
    changed = np.zeros((height, width), bool)
    often = np.zeros((height, width), np.uint16)
    for picture in stack:
        often += _differing(picture, colour, levels) > 0
    least = max(3, round(LEAST_SHARE * len(stack)))
    side = max(4, round(LEAST_SIDE * min(height, width)))
    lasting = cv2.morphologyEx(
        (often >= least).astype(np.uint8),
        cv2.MORPH_OPEN,
        np.ones((side // 2, side // 2), np.uint8),
    )
    count, labels, stats, _ = cv2.connectedComponentsWithStats(lasting, connectivity=4)
    made = colour
    for k in range(1, count):
        x, y, w, h, area = stats[k].tolist()
        if min(w, h) < side or 2 * area > height * width:
            continue
        around = (
            slice(max(0, y - 2 * RIM_PX), y + h + 2 * RIM_PX),
            slice(max(0, x - 2 * RIM_PX), x + w + 2 * RIM_PX),
        )
        own = labels[around] == k
        pictures = [np.ascontiguousarray(picture[around]) for picture in stack]
        here = np.ascontiguousarray(colour[around]), np.ascontiguousarray(levels[around])
        shown = [_is_shown(_differing(picture, *here), own) for picture in pictures]
        other = _other_colours(pictures, shown, own, least)
        if other is not None and _goes_on(other, colour[around], own):
            made = made.copy() if made is colour else made
            made[around][own] = other[own]
            changed[around] |= own
    return made, changed


def _differing(picture: Image, colour: Image, levels: Image) -> Image:
    """Where a picture differs from the background, (H, W) uint8."""
    difference = weigh(as_image(cv2.absdiff(picture, colour)))
    return as_image(cv2.compare(difference, levels, cv2.CMP_GT))


def _is_shown(differing: Image, own: NDArray[np.bool_]) -> bool:
    """Whether nearly all of a place differs from the background."""
    return bool(np.count_nonzero(differing[own]) >= WHOLLY * np.count_nonzero(own))


def _other_colours(
    pictures: list[Image], shown: list[bool], own: NDArray[np.bool_], least: int
) -> Image | None:
    """What a place, ``own``, shows in the pictures in which it is not the background, None where that
    is not one thing that comes or goes at once.
    """
    changes = sum(now != before for before, now in pairwise(shown))
    if sum(shown) < least or changes > MOST_CHANGES:
        return None
    these = [picture for picture, is_so in zip(pictures, shown, strict=True) if is_so]
    middle = these[len(these) // 2]
    alike = [
        float(np.abs(p[own].astype(np.int16) - middle[own]).mean()) < ALIKE_LEVELS
        for p in these
    ]
    if not all(alike):
        return None
    return as_image(np.median(np.stack(these), axis=0).astype(np.uint8))


def _goes_on(other: Image, colour: Image, own: NDArray[np.bool_]) -> bool:
    """Whether the other colours go on across the outline, and the background's do not."""
    kernel = np.ones((2 * RIM_PX + 1, 2 * RIM_PX + 1), np.uint8)
    inside = own.astype(np.uint8)
    core = cv2.erode(inside, kernel, borderType=cv2.BORDER_CONSTANT, borderValue=0)
    wide = cv2.dilate(inside, kernel)
    rim = (inside > 0) & (core == 0)
    outer = (wide > 0) & ~own
    if not rim.any() or not outer.any():
        return False
    # Each side is the mean colour along the outline nearby.
    reach = (8 * RIM_PX + 1, 8 * RIM_PX + 1)
    beyond = _mean_of(colour, outer, reach)
    step = np.abs(_mean_of(colour, rim, reach) - beyond)[rim].mean()
    instead = np.abs(_mean_of(other, rim, reach) - beyond)[rim].mean()
    return bool(instead < ACROSS * step)


def _mean_of(
    picture: Image, where: NDArray[np.bool_], reach: tuple[int, int]
) -> NDArray[np.float64]:
    """The mean colour of some pixels near each pixel, (H, W, 3), in whole levels' sums."""
    weight = where.astype(np.float64)
    total = cv2.boxFilter(picture * weight[..., None], cv2.CV_64F, reach, normalize=False)
    count = cv2.boxFilter(weight, cv2.CV_64F, reach, normalize=False)
    mean: NDArray[np.float64] = np.rint(total) / np.maximum(np.rint(count), 1.0)[..., None]
    return mean
