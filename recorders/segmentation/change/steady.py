"""A camera that rests before leaves that move: the little that never moves says that it rests.

Where a tree in the wind fills most of the picture, each picture's most textured patches are leaves,
which the next picture shows elsewhere or not at all: one view looks like many. But what is beside
the leaves is seen in all pictures at the same place, which a camera that was turned never shows.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.background import most_common
from recorders.segmentation.change.landmarks import AGREES, FEWEST, Ints, Landmarks
from recorders.segmentation.change.light import light_of
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

ALWAYS = 0.8
"""A patch is steady where it is seen, unmoved, in this share of the pictures."""
ENOUGH = 0.1
"""A camera rests where at least so much of all that is textured is steady: a clock that is burnt in
is less.
"""


def steady_view(pictures: list[Image]) -> tuple[Image, Ints] | None:
    """What all pictures, (H, W, 3) uint8 in Y, Cr, Cb, have in common, None where that is too little
    to know a camera by that rests.

    Returns:
        Its brightness, (H, W) uint8, and row and column of the steady patches' first pixels, (N, 2),
        the best of each part of the picture; fewer than `FEWEST` where the camera rests before
        what has little texture, and that of the pictures is that of a crowd.
    """
    luma = most_common([as_image(cv2.extractChannel(p, 0)) for p in pictures])[0]
    every = Landmarks.of(luma, all_of_them=True)
    times = np.zeros(len(every), np.int64)
    for picture in pictures if len(every) >= FEWEST else []:
        times += every.sight(picture, (0, 0), 3).seen
    steady = times >= ALWAYS * len(pictures)
    found = Landmarks.of(luma, among=every.corners[steady])
    enough = np.count_nonzero(steady) >= ENOUGH * len(every) and len(found) >= FEWEST
    return (luma, found.corners) if enough or _rests(pictures, luma) else None


def _rests(pictures: list[Image], luma: Image) -> bool:
    """Whether each picture is as bright as the next in nearly all of its pixels, and nearly every one
    as what they have in common, (H, W) uint8, in most of them.
    """
    bright = [as_image(cv2.extractChannel(p, 0))[..., None] for p in pictures]
    known = sum(light_of(picture, luma[..., None]).known for picture in bright)
    return known >= ALWAYS * len(bright) and all(
        light_of(later, now).agreeing >= AGREES for now, later in pairwise(bright)
    )
