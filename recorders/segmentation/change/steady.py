"""A camera that rests before leaves that move: the little that never moves says that it rests.

Where a tree in the wind fills most of the picture, each picture's most textured patches are leaves,
which the next picture shows elsewhere or not at all: one view looks like many. But what is beside
the leaves is seen in all pictures at the same place, which a camera that was turned never shows.
"""

from __future__ import annotations

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.background import most_common
from recorders.segmentation.change.landmarks import FEWEST, Ints, Landmarks
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
        the best of each part of the picture.
    """
    luma = most_common([as_image(cv2.extractChannel(p, 0)) for p in pictures])[0]
    every = Landmarks.of(luma, all_of_them=True)
    if len(every) < FEWEST:
        return None
    times = np.zeros(len(every), np.int64)
    for picture in pictures:
        times += every.sight(picture, (0, 0), 3).seen
    steady = times >= ALWAYS * len(pictures)
    if np.count_nonzero(steady) < ENOUGH * len(every):
        return None
    found = Landmarks.of(luma, among=every.corners[steady])
    return (luma, found.corners) if len(found) >= FEWEST else None
