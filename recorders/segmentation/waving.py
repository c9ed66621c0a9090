"""Ground that waves: leaves, water, flags, screens' edges. What repeats in place is ground.

Where a tree moves in the wind a pixel shows now a leaf and now what lies behind, and both are
there all the time, a few pixels away. So where most of what differs from the background has a
colour of the background nearby, the ground waves, and only what differs from all of these colours
is foreground there (the neighbourhood kernel of SHELLS 2.1, after Sheikh and Shah, PAMI 2005,
where it is needed and nowhere else). Those who pass have other colours than what they pass, in
most of their pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.blobs import components
from recorders.segmentation.recurring import FEWEST, SEGMENTS, light_shift, shifted, weigh
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

REACH = 0.02
"""Things wave by this share of the picture's height to each side."""
AROUND = 0.04
"""Side of the window in which a place is judged, of the picture's height."""
RESTLESS = 0.04
"""A place is restless where it differs from the background for this share of the time,"""
STRANGE = 0.3
"""and waves where at most this share of that has none of the colours nearby,"""
SPREAD = 0.85
"""and it is so in as many parts of the recording as if it came and went at random, or this share of
them: those who pass or stay are there for a while, and then are not.
"""
SCATTERED = 0.5
"""What waves is seen here and there, nowhere whole: a window of which a share s differs counts s (1 - s),
which is at least this share of all that differs in it. A body fills it or is not there.
"""
FINER = 20
"""Steps in which parts are counted."""
LEAST = 0.01
"""Less of the picture than this, in one piece, does not wave."""
MUCH = 0.3
"""Where this share of the picture waves, those who pass are seen through it, in pieces:"""
THROUGH = 0.16
"""foreground counts with what is in a window of this side, of the picture's height,"""
SPARSE, DENSE = 0.05, 0.15
"""where that has the first share of foreground, and goes on to where it has the second."""


@dataclass(frozen=True)
class Waving:
    """Where the ground waves.

    Attributes:
        mask: (h, w) uint8, 255 where it does, of the part of the picture that holds all of it.
        left, top: of that part, px.
        reach: how far it waves, px.
        size: height and width of the whole picture.
    """

    mask: Image
    left: int
    top: int
    reach: int
    size: tuple[int, int]

    def soften(self, difference: Image, picture: Image, behind: Image) -> None:
        """Where the ground waves, put the difference from all colours nearby into ``difference``,
        (H, W) uint8, in place.

        Args:
            difference: from the background alone, weighed as `weigh` does.
            picture: (H, W, 3) uint8 in Y, Cr, Cb.
            behind: the background, the same.
        """
        h, w = self.mask.shape
        part = np.s_[self.top : self.top + h, self.left : self.left + w]
        # What lies beside the part is a colour nearby, too.
        r = self.reach
        y0, x0 = max(0, self.top - r), max(0, self.left - r)
        around = np.ascontiguousarray(behind[y0 : self.top + h + r, x0 : self.left + w + r])
        inner = np.s_[
            self.top - y0 : self.top - y0 + h, self.left - x0 : self.left - x0 + w
        ]
        low, high = _range(around, r)
        other = outside(picture[part], low[inner], high[inner])
        cv2.copyTo(other, self.mask, difference[part])

    def seen_through(self, mask: Image) -> Image:
        """The foreground, (H, W) uint8, 0 or 255, where much of the picture waves; else ``mask``
        itself, likewise.

        There leaves cover most of whoever passes, and his colours are often theirs. What is left of
        him lies close together, leaves that are mistaken for foreground lie here and there: these
        go, and the gaps in what remains are closed.
        """
        if self._closed_mask is None:
            return mask
        side = self._window
        near = cv2.boxFilter(mask, cv2.CV_32S, (side, side), normalize=False)
        full = 255 * side * side
        some = as_image((near >= SPARSE * full).view(np.uint8))
        count, numbers = cv2.connectedComponents(some)
        body = np.zeros(count, np.uint8)
        body[numbers[near >= DENSE * full]] = 255
        closed = _closed(as_image(mask & body[numbers]), side)
        h, w = self.mask.shape
        part = np.s_[self.top : self.top + h, self.left : self.left + w]
        found = mask.copy()
        cv2.copyTo(closed[part], self._closed_mask, found[part])
        return found

    @property
    def _window(self) -> int:
        return 2 * round(THROUGH * self.size[0] / 2) + 1

    @cached_property
    def _closed_mask(self) -> Image | None:
        """Where the ground waves, without gaps; None where that is little of the picture."""
        height, width = self.size
        if np.count_nonzero(self.mask) < MUCH * height * width:
            return None
        return _closed(self.mask, self._window)


def _closed(mask: Image, side: int) -> Image:
    """A mask whose gaps are closed that a window fits across."""
    around = cv2.copyMakeBorder(mask, side, side, side, side, cv2.BORDER_CONSTANT, value=0)
    kernel = np.ones((side, side), np.uint8)
    closed = cv2.morphologyEx(around, cv2.MORPH_CLOSE, kernel)
    return as_image(closed[side:-side, side:-side])


def _range(picture: Image, reach: int) -> tuple[Image, Image]:
    """The least and the largest value of each channel around each pixel."""
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return as_image(cv2.erode(picture, kernel)), as_image(cv2.dilate(picture, kernel))


def outside(picture: Image, low: Image, high: Image) -> Image:
    """How far colours (H, W, 3) are outside of a range, weighed as `weigh` does, (H, W) uint8."""
    return weigh(as_image(cv2.add(cv2.subtract(low, picture), cv2.subtract(picture, high))))


def waving(stack: list[Image], colour: Image, level: Image) -> Waving | None:
    """Where the ground waves, None where it does not.

    Args:
        stack: pictures spread over the recording, (H, W, 3) uint8 in Y, Cr, Cb.
        colour: the background, the same.
        level: (H, W) uint8, the least difference that is foreground.
    """
    if len(stack) < FEWEST:
        return None
    height = colour.shape[0]
    reach = max(2, round(REACH * height))
    side = 2 * round(AROUND * height / 2) + 1
    low, high = _range(colour, reach)
    crowded = np.zeros(level.shape, np.int64)
    differs, strange = np.zeros_like(level), np.zeros_like(level)
    parts, in_part = np.zeros_like(level), np.zeros_like(level)
    for k, picture in enumerate(stack):
        lit = shifted(picture, -light_shift(picture, colour))
        there = cv2.compare(weigh(as_image(cv2.absdiff(lit, colour))), level, cv2.CMP_GT)
        other = cv2.compare(outside(lit, low, high), level, cv2.CMP_GT)
        one = as_image(there) & np.uint8(1)
        near = cv2.boxFilter(one, cv2.CV_32S, (side, side), normalize=False)
        crowded += np.square(np.asarray(near, np.int64))
        differs += one
        strange += as_image(other) & np.uint8(1)
        in_part |= one
        if (k + 1) * SEGMENTS // len(stack) != k * SEGMENTS // len(stack):
            parts += in_part
            in_part[:] = 0

    def summed(count: Image) -> NDArray[np.int64]:
        total = cv2.boxFilter(count, cv2.CV_32S, (side, side), normalize=False)
        return np.asarray(total, np.int64)

    often, odd = summed(differs), summed(strange)
    seen, expected = summed(parts), summed(_expected(differs, len(stack)))
    found = often >= RESTLESS * len(stack) * side * side
    found &= odd <= STRANGE * often
    found &= FINER * seen >= SPREAD * expected
    found &= crowded <= (1 - SCATTERED) * side * side * often
    there = components(found.view(np.uint8), LEAST * found.size)[0]
    left, top, w, h = (int(v) for v in cv2.boundingRect(there))
    if w == 0:
        return None
    mask = np.ascontiguousarray(there[top : top + h, left : left + w])
    return Waving(mask, left, top, reach, level.shape)


def _expected(differs: Image, samples: int) -> Image:
    """In how many parts of the recording, times `FINER`, a pixel differs that differs in so
    many samples, one as likely as the other, (H, W) uint8.
    """
    each = samples / SEGMENTS
    table = np.array(
        [
            round(FINER * SEGMENTS * (1 - (1 - min(1.0, k / samples)) ** each))
            for k in range(256)
        ],
        np.uint8,
    )
    return as_image(cv2.LUT(differs, table))
