"""The background: each pixel's most common value over pictures sampled from a recording.

In hindsight the samples are spread over the whole recording: what stands still at the start and
leaves later, or comes and stays, is foreground in every frame; the first frames leave no ghosts.
Live they are spread over the past.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from recorders.pictures import Image
from recorders.segmentation.ghosts import without_who_left
from recorders.segmentation.recurring import recurring, weigh
from recorders.segmentation.segmenter import as_image
from recorders.segmentation.waving import Waving, waving
from recorders.vision import cv2

MAX_SAMPLES = 60
MAX_SAMPLE_BYTES = 256 * 1024 * 1024
MIN_SAMPLES = 5


@dataclass
class Samples:
    """Pictures spread evenly over a sequence of unknown length, in bounded memory.

    Every ``stride``-th picture is kept; when there are too many, every second one is dropped and
    the stride doubles. With ``max_stride`` the stride stops there, and the oldest picture makes
    room for the newest.

    Attributes:
        most: largest number of pictures to keep.
        most_bytes: largest number of bytes, though never fewer than `MIN_SAMPLES` pictures.
        max_stride: largest distance of two kept pictures, in frames; 0 for no bound.
    """

    most: int = MAX_SAMPLES
    most_bytes: int = MAX_SAMPLE_BYTES
    max_stride: int = 0
    kept: list[Image] = field(default_factory=list)
    _stride: int = 1
    _seen: int = 0

    def wants_next(self) -> bool:
        """Whether the next picture will be kept."""
        return self._seen % self._stride == 0

    @property
    def stride(self) -> int:
        """Picture k of `kept` was the one with the number k times this, without ``max_stride``."""
        return self._stride

    def add(self, picture: Image) -> bool:
        """Take the next picture; True if it was kept. It must not be written into afterwards."""
        wanted = self.wants_next()
        self._seen += 1
        if not wanted:
            return False
        room = max(MIN_SAMPLES, min(self.most, self.most_bytes // max(1, picture.nbytes)))
        if len(self.kept) >= room:
            if self.max_stride and 2 * self._stride > self.max_stride:
                del self.kept[0]
            else:
                del self.kept[1::2]
                self._stride *= 2
                if (self._seen - 1) % self._stride:
                    return False
        self.kept.append(picture)
        return True

    def skip(self) -> None:
        """Count a picture that `wants_next` did not want."""
        self._seen += 1


def sort_stack(stack: list[Image]) -> list[Image]:
    """Sort each pixel's values over a stack, by Batcher's odd-even merge network of minima and
    maxima.

    K. E. Batcher, Sorting networks and their applications, 1968. A network needs whole-picture
    operations alone.

    Args:
        stack: n arrays of one shape, uint8.

    Returns:
        n arrays, the smallest value of each pixel first.
    """
    s = list(stack)
    n = len(s)
    p = 1
    while p < n:
        k = p
        while k >= 1:
            for j in range(k % p, n - k, 2 * k):
                for i in range(min(k, n - j - k)):
                    if (i + j) // (2 * p) == (i + j + k) // (2 * p):
                        a, b = s[i + j], s[i + j + k]
                        s[i + j], s[i + j + k] = (
                            as_image(cv2.min(a, b)),
                            as_image(cv2.max(a, b)),
                        )
            k //= 2
        p *= 2
    return s


def most_common(stack: list[Image]) -> tuple[Image, Image]:
    """Each pixel's background and its spread: centre and width of the shortest interval with half
    of the values.

    The shortest half (least median of squares, Rousseeuw 1984) withstands up to half of the
    samples showing something else. Equally short intervals: the one of the smallest values.

    Args:
        stack: at least one array of one shape, uint8.

    Returns:
        Two arrays of the stack's shape, uint8.
    """
    s = sort_stack(stack)
    m = len(s) // 2
    width = s[m] - s[0]
    low = s[0].copy()
    for i in range(1, len(s) - m):
        other = s[i + m] - s[i]
        np.copyto(low, s[i], where=other < width)
        np.minimum(other, width, out=width)
    return low + (width >> 1), width


@dataclass
class Background:
    """A background in Y, Cr, Cb that follows the light.

    Attributes:
        colour: (H, W, 3) uint8, the background.
        level: (H, W) uint8, the least difference that is foreground, by pixel: larger where the
            background itself changes (leaves, tape in the wind, screens, a burnt-in clock).
        coloured: it has colours: not from an infrared or a monochrome camera.
        noisy: in most places the level follows from the spread: noise decides what is foreground.
        waving: in this share of the places the level follows from the spread.
        swaying: where the ground waves, if it does anywhere.
        restless: (H, W) uint8, what of the level follows from the spread; None where nothing does.
    """

    colour: Image
    level: Image
    coloured: bool = True
    noisy: bool = False
    waving: float = 0.0
    swaying: Waving | None = None
    restless: Image | None = None
    _around: tuple[Image, Image] | None = field(default=None, init=False, repr=False)

    @classmethod
    def learn(
        cls, stack: list[Image], threshold: float, spread_weight: float
    ) -> Background:
        """From (H, W, 3) uint8 pictures in Y, Cr, Cb.

        Args:
            stack: the pictures.
            threshold: the least difference on a background of middle brightness; half of it on
                black.
            spread_weight: the least difference, of the spread.
        """
        colour, spread = most_common(stack)
        colour, other = recurring(stack, colour)
        spread[other > 0] = 0
        brightness = _brightness(colour)
        by_spread = weigh(spread).astype(np.float32) * np.float32(spread_weight)
        noisy = bool(
            2 * np.count_nonzero(by_spread > threshold * brightness) > by_spread.size
        )
        level = np.maximum(by_spread, threshold * brightness)
        neutral = (
            cv2.absdiff(colour[..., 1:], np.full_like(colour[..., 1:], NEUTRAL_CHROMA))
            <= GREY_LEVELS
        )
        coloured = bool(100 * np.count_nonzero(neutral) < 99 * neutral.size)
        levels = np.minimum(level, np.float32(MAX_LEVEL)).astype(np.uint8)
        colour, changed = without_who_left(stack, colour, levels)
        levels[changed] = (threshold * _brightness(colour)).astype(np.uint8)[changed]
        restless = int(np.count_nonzero(by_spread > threshold * brightness))
        share = restless / by_spread.size
        swaying = waving(stack, colour, levels)
        unrest = np.minimum(by_spread, np.float32(MAX_LEVEL)).astype(np.uint8)
        unrest[changed] = 0
        return cls(colour, levels, coloured, noisy, share, swaying, unrest)

    def around(self) -> tuple[Image, Image]:
        """The least and the largest values of each pixel and its neighbours, (H, W, 3) uint8."""
        if self._around is None:
            kernel = np.ones((3, 3), np.uint8)
            self._around = (
                as_image(cv2.erode(self.colour, kernel)),
                as_image(cv2.dilate(self.colour, kernel)),
            )
        return self._around

    def in_grey(self) -> Background:
        """The same place for a camera that sees no colours."""
        colour = self.colour.copy()
        colour[..., 1:] = NEUTRAL_CHROMA
        return replace(self, colour=colour, coloured=False)

    def asks_less(self) -> None:
        """Half of the difference is foreground, where the background itself does not change as
        much.
        """
        half = self.level // 2
        self.level = half if self.restless is None else np.maximum(half, self.restless)

    def follow(self, picture: Image, still: Image) -> None:
        """Move the background by one level towards the picture where ``still`` (H, W) is not
        zero.
        """
        moved = self.colour + (picture > self.colour) - (picture < self.colour)
        cv2.copyTo(moved, still, self.colour)
        self._around = None


def _brightness(colour: Image) -> NDArray[np.float32]:
    """Of each pixel, from .5 on black to 1 on middle brightness and above, (H, W)."""
    share = 0.5 + colour[..., 0].astype(np.float32) / np.float32(256)
    return np.asarray(np.minimum(share, np.float32(1)))


MAX_LEVEL = 120
NEUTRAL_CHROMA, GREY_LEVELS = 128, 2
"""Cr and Cb of grey, and how far from it grey may be: compression shifts it a little."""
