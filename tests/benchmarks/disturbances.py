"""What happens to real cameras: light that changes, infrared, a bump, a shake, a pan, a lost signal.

Each is a function of a picture (H, W, 3) uint8 BGR and its number in the recording, the same on
every run.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2

Image = NDArray[np.uint8]
MIDDLE = 150
"""The frame from which a change lasts."""
SPELL = range(100, 130)
"""The frames of a change that passes."""


def _gain(image: Image, gain: float) -> Image:
    return cv2.convertScaleAbs(image, alpha=gain)


def light(image: Image, number: int) -> Image:
    """Six tenths of the light for thirty frames."""
    return _gain(image, 0.6) if number in SPELL else image


def little_light(image: Image, number: int) -> Image:
    """A sixth of the light less for thirty frames."""
    return _gain(image, 0.85) if number in SPELL else image


def exposure(image: Image, number: int) -> Image:
    """An exposure that wanders by 15 %."""
    return _gain(image, 1 + 0.15 * math.sin(number / 12))


def infrared(image: Image, number: int) -> Image:
    """Grey from the middle on."""
    if number < MIDDLE:
        return image
    return cv2.cvtColor(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), cv2.COLOR_GRAY2BGR)


def bumped(image: Image, number: int) -> Image:
    """Four pixels aside and two down from the middle on."""
    return np.roll(image, (2, 4), (0, 1)) if number >= MIDDLE else image


def shaken(image: Image, number: int) -> Image:
    """Up to one pixel in each direction, another in every frame."""
    down, right = np.random.default_rng(number).integers(-1, 2, 2).tolist()
    return np.roll(image, (down, right), (0, 1))


def no_signal(image: Image, number: int) -> Image:
    """Black for thirty frames."""
    return np.zeros_like(image) if number in SPELL else image


DISTURBANCES: dict[str, Callable[[Image, int], Image]] = {
    "light": light,
    "little light": little_light,
    "exposure": exposure,
    "infrared": infrared,
    "bumped": bumped,
    "shaken": shaken,
    "no signal": no_signal,
}
