"""What colours somebody wears: pixels of the upper and the lower body counted by shade.

A shade is a box in hue, saturation and brightness, each in 8 bits; several shades make a colour
that people have a word for. Every pixel counts alike, so light and shadow over a body move a few
of them into a neighbouring shade and leave the rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box
from recorders.pictures import Image
from recorders.vision import cv2

Counts = NDArray[np.int64]

SHADES: tuple[tuple[str, str], ...] = (
    ("black", "black"), ("dark grey", "grey"), ("light grey", "grey"), ("white", "white"),
    ("dark red", "red"), ("red", "red"), ("brown", "brown"), ("orange", "orange"), ("beige", "beige"),
    ("olive", "green"), ("yellow", "yellow"), ("dark green", "green"), ("green", "green"),
    ("turquoise", "blue"), ("dark blue", "blue"), ("blue", "blue"), ("light blue", "blue"),
    ("dark purple", "purple"), ("purple", "purple"), ("pink", "pink"),
)  # fmt: skip
"""Shades, and the colour that each is called."""
COLOURS = tuple(dict.fromkeys(colour for _, colour in SHADES))
UPPER, LOWER = (0.16, 0.48), (0.56, 0.92)
"""From where to where, of a box's height, the upper and the lower body reach: without head, waist
and shoes.
"""
_SIDE = 0.22
_LEAST_PIXELS = 12
_GREY, _DARK, _LIGHT, _WHITE = 24, 66, 120, 182
_RED, _ORANGE, _YELLOW, _OLIVE, _GREEN, _TURQUOISE, _BLUE, _PURPLE, _PINK = (
    7, 20, 34, 42, 84, 98, 128, 150, 172
)  # fmt: skip


def shades_of(names: Sequence[str]) -> list[int]:
    """The numbers of the shades that are called by one of these colours or are one of them."""
    return [k for k, (shade, colour) in enumerate(SHADES) if {shade, colour} & set(names)]


@cache
def _table() -> Image:
    """The shade of each BGR colour of 5 bits a channel, (32, 32, 32) uint8."""
    levels = np.arange(32, dtype=np.uint8) * 8 + 4
    grid = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1)
    hsv = cv2.cvtColor(grid.reshape(1, -1, 3), cv2.COLOR_BGR2HSV)[0].astype(np.int64)
    table = np.array([_shade(*row) for row in hsv.tolist()], np.uint8)
    return table.reshape(32, 32, 32)


def _shade(hue: int, saturation: int, value: int) -> int:
    """Hue 0 to 179, the others 0 to 255."""
    return next(k for k, (name, _) in enumerate(SHADES) if name == _named(hue, saturation, value))  # fmt: skip


def _named(hue: int, saturation: int, value: int) -> str:
    if value < 40 or saturation * value < _GREY * 255:
        bounds = ((_DARK, "black"), (_LIGHT, "dark grey"), (_WHITE, "light grey"))
        return next((name for bound, name in bounds if value < bound), "white")
    if hue < _RED or hue >= _PINK:
        return _reddish(saturation, value)
    dark = value < 100
    spans = (
        (_ORANGE, "brown" if value < 165 else "beige" if saturation < 105 else "orange"),
        (_YELLOW, "olive" if value < 140 else "beige" if saturation < 75 else "yellow"),
        (_OLIVE, "olive" if value < 140 else "green"),
        (_GREEN, "dark green" if dark else "green"),
        (_TURQUOISE, "turquoise"),
        (_BLUE, "dark blue" if dark else "light blue" if value > 170 and saturation < 150 else "blue"),
        (_PURPLE, "dark purple" if dark else "purple"),
        (_PINK, "pink" if value > 130 else "dark purple"),
    )  # fmt: skip
    return next(name for bound, name in spans if hue < bound)


def _reddish(saturation: int, value: int) -> str:
    if value > 150 and saturation < 120:
        return "pink"
    return "dark red" if value < 120 else "red"


def count_shades(pixels: Image) -> Counts:
    """How many of pixels (N, 3), BGR, are of each shade, (20,)."""
    small = pixels >> 3
    found = _table()[small[:, 0], small[:, 1], small[:, 2]]
    return np.bincount(found, minlength=len(SHADES)).astype(np.int64)


def body_shades(
    image: Image, mask: Image | None, box: Box, others: Sequence[Box] = ()
) -> tuple[Counts, Counts] | None:
    """Shades of the upper and the lower body in a box of a picture.

    Args:
        image: (height, width, 3) uint8 BGR.
        mask: (height, width) uint8, not 0 where there is a body; None: the box's middle counts.
        box: x, y, w, h in pixels.
        others: boxes of others, whose pixels do not count.

    Returns:
        counts (20,) of each half; None where too little of either is to be seen.
    """
    height, width = image.shape[:2]
    x0, x1 = (min(max(round(v), 0), width) for v in (box[0], box[0] + box[2]))
    y0, y1 = (min(max(round(v), 0), height) for v in (box[1], box[1] + box[3]))
    if x1 - x0 < 3 or y1 - y0 < 6:
        return None
    own = np.zeros((y1 - y0, x1 - x0), np.bool_)
    if mask is None:
        side = round(_SIDE * (x1 - x0))
        own[:, side : x1 - x0 - side] = True
    else:
        own |= mask[y0:y1, x0:x1] > 0
    for x, y, w, h in others:
        left, top = max(0, round(x) - x0), max(0, round(y) - y0)
        own[top : max(0, round(y + h) - y0), left : max(0, round(x + w) - x0)] = False
    found = []
    for start, end in (UPPER, LOWER):
        rows = slice(*(round(box[1] + part * box[3]) - y0 for part in (start, end)))
        rows = slice(max(0, rows.start), max(0, rows.stop))
        pixels = image[y0:y1, x0:x1][rows][own[rows]]
        if len(pixels) < _LEAST_PIXELS:
            return None
        found.append(count_shades(pixels))
    return found[0], found[1]
