"""From evidence to a mask, as the motion and the density segmenters share it: shadows, and the
weighted median.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

NEUTRAL = 128
"""Evidence for neither; above is for foreground."""


@dataclass(frozen=True)
class Foreground:
    """What differs from the background.

    Attributes:
        mask: (H, W) uint8, 0 or 255.
        weak: likewise, also where only `WEAK` of what it takes speaks for foreground: clothes like
            the wall.
    """

    mask: Image
    weak: Image


WEAK = 2
"""A pixel differs weakly by one in so many of the least difference that is foreground."""


class Shadows:
    """Tells pixels that are the background under a shadow: somewhat darker, of nearly the same
    colour.
    """

    def __init__(self, parameters: SegmentationParameters, width: int, height: int) -> None:
        self._darkest = _shares(parameters.shadow_darkest)
        self._grey_keeps = max(parameters.shadow_darkest, parameters.shadow_darkest_grey)
        self._darkest_grey = _shares(self._grey_keeps)
        self._colour = np.full(
            (height, width), int(parameters.shadow_colour_levels), np.uint8
        )

    def learn_grey(self, keeps: float) -> bool:
        """Where there are no colours, a shadow keeps this share of the brightness at least
        (`recorders.segmentation.darkness`), if that is less than what was said. Whether it is;
        where shadows are kept it is not.
        """
        if keeps >= self._grey_keeps or self._grey_keeps >= 1.0:
            return False
        self._darkest_grey = _shares(keeps)
        return True

    def find(
        self, picture: Image, behind: Image, chroma: Image, coloured: bool = True
    ) -> Image:
        """255 where there is shadow, (H, W) uint8.

        Args:
            picture: (H, W, 3) uint8 in Y, Cr, Cb.
            behind: the background, the same.
            chroma: (H, W) uint8, the sum of their differences in Cr and in Cb.
            coloured: the background has colours. Where it has none, whatever is darker has its
                colour, too: only the faintest shadows can be told from dark clothes.
        """
        y, behind_y = cv2.extractChannel(picture, 0), cv2.extractChannel(behind, 0)
        darker = cv2.compare(y, behind_y, cv2.CMP_LT)
        not_too_dark = cv2.compare(
            y,
            cv2.LUT(behind_y, self._darkest if coloured else self._darkest_grey),
            cv2.CMP_GE,
        )
        same_colour = cv2.compare(chroma, self._colour, cv2.CMP_LE)
        return as_image(cv2.bitwise_and(cv2.bitwise_and(darker, not_too_dark), same_colour))


def _shares(share: float) -> Image:
    """Each level times a share, as a table, (256,) uint8."""
    return np.array([int(v * share) for v in range(256)], np.uint8)


def window_of(parameters: SegmentationParameters, height: int) -> int:
    """Side of the weighted median's window, px, odd."""
    return 2 * int(parameters.smoothing * height / 2 + 0.5) + 1


def weighted_median(evidence: Image, window: int) -> Image:
    """The weighted median of the pixels' labels in a window (SHELLS 2.1), (H, W) uint8, 0 or 255.

    Of two labels, the weighted median is the one with the larger sum of weights. Each pixel's
    evidence is its label's weight with its label's sign, so the sum's sign, the blurred
    evidence's, decides.

    Args:
        evidence: (H, W) uint8 around `NEUTRAL`.
        window: its side, px, odd.
    """
    return _decided(_blurred(evidence, window))


def foreground_of(evidence: Image, level: Image, window: int) -> Foreground:
    """The same, and where the evidence is weak.

    Args:
        evidence: (H, W) uint8 around `NEUTRAL`.
        level: (H, W) uint8, the least difference that is foreground, by pixel: what speaks against
            it where nothing differs.
        window: the window's side, px, odd.
    """
    blurred = _blurred(evidence, window)
    given = as_image(cv2.add(blurred, level - level // WEAK))
    return Foreground(_decided(blurred), _decided(given))


def _blurred(evidence: Image, window: int) -> Image:
    if window > 1:
        return as_image(cv2.GaussianBlur(evidence, (window, window), 0))
    return evidence


def _decided(blurred: Image) -> Image:
    return as_image(cv2.threshold(blurred, NEUTRAL, 255, cv2.THRESH_BINARY)[1])
