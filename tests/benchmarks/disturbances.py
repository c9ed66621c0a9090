"""What happens to real cameras: light that changes, infrared, a bump, a shake, a pan, a lost signal.

Each is a function of a picture (H, W, 3) uint8 BGR, its number and the number of frames in the
recording, the same on every run.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from recorders.pictures import Image
from recorders.vision import cv2


def _later(number: int, frames: int) -> bool:
    """The second half, where a change lasts."""
    return number >= frames // 2


def _spell(number: int, frames: int) -> bool:
    """A tenth of the recording from its third on, where a change passes."""
    return frames // 3 <= number < frames // 3 + frames // 10


def _gain(image: Image, gain: float) -> Image:
    return np.asarray(cv2.convertScaleAbs(image, alpha=gain), np.uint8)


def light(image: Image, number: int, frames: int) -> Image:
    """Six tenths of the light for a tenth of the time."""
    return _gain(image, 0.6) if _spell(number, frames) else image


def little_light(image: Image, number: int, frames: int) -> Image:
    """A sixth of the light less for a tenth of the time."""
    return _gain(image, 0.85) if _spell(number, frames) else image


def lamp(image: Image, number: int, frames: int) -> Image:
    """Another lamp for a tenth of the time: blue, green and red along a curve each."""
    if not _spell(number, frames):
        return image
    levels = np.arange(256) / 255
    curves = [np.rint(255 * levels**power).astype(np.uint8) for power in (1.5, 1.2, 0.9)]
    return np.dstack([curve[image[..., k]] for k, curve in enumerate(curves)])


def exposure(image: Image, number: int, frames: int) -> Image:
    """An exposure that wanders by 15 %."""
    return _gain(image, 1 + 0.15 * math.sin(number / 12))


def infrared(image: Image, number: int, frames: int) -> Image:
    """Grey from the middle on."""
    if not _later(number, frames):
        return image
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)


def bump_of(number: int, frames: int, width: int) -> tuple[int, int]:
    """Pixels right and down: four and two from the middle on."""
    del width
    return (4, 2) if _later(number, frames) else (0, 0)


def pan_of(number: int, frames: int, width: int) -> tuple[int, int]:
    """A fourth of the width to the left within a twentieth of the time, from the middle on."""
    done = min(1.0, max(0.0, (number - frames // 2) / max(1, frames // 20)))
    return -round(done * width / 4), 0


def _moved(image: Image, right: int, down: int) -> Image:
    """What leaves on one side comes back on the other."""
    return np.roll(image, (down, right), (0, 1))


def bumped(image: Image, number: int, frames: int) -> Image:
    """A camera that is bumped."""
    return _moved(image, *bump_of(number, frames, image.shape[1]))


def panned(image: Image, number: int, frames: int) -> Image:
    """A camera that turns and rests."""
    return _moved(image, *pan_of(number, frames, image.shape[1]))


def shaken(image: Image, number: int, frames: int) -> Image:
    """Up to one pixel in each direction, another in every frame."""
    down, right = np.random.default_rng(number).integers(-1, 2, 2).tolist()
    return np.roll(image, (down, right), (0, 1))


def no_signal(image: Image, number: int, frames: int) -> Image:
    """Black for a tenth of the time."""
    return np.zeros_like(image) if _spell(number, frames) else image


DISTURBANCES: dict[str, Callable[[Image, int, int], Image]] = {
    "light": light,
    "little light": little_light,
    "lamp": lamp,
    "exposure": exposure,
    "infrared": infrared,
    "bumped": bumped,
    "shaken": shaken,
    "panned": panned,
    "no signal": no_signal,
}
MOVED: dict[str, Callable[[int, int, int], tuple[int, int]]] = {
    "bumped": bump_of,
    "panned": pan_of,
}
"""How far the truth moves with the picture: number, frames and width -> pixels right and down."""
