"""A picture as a network wants it, and its boxes back in the picture's pixels."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, cast

import numpy as np
from numpy.typing import NDArray

from recorders.vision import cv2

Floats = NDArray[np.float64]
Fit = Literal["letterbox", "corner", "stretch"]
PADDING = 114
"""Grey of what a letterbox leaves empty, as its networks were trained."""


@dataclass(frozen=True)
class Preparation:
    """How a network's input is made.

    Attributes:
        width, height: of the input, px.
        fit: ``letterbox`` keeps the picture's proportions and centres it, ``corner`` keeps them
            and puts it into the top left, ``stretch`` fills the input.
        rgb: red first; else blue first.
        mean, spread: taken off each channel, and what it is divided by, in the input's order of
            channels, of 255 levels.
        channels_last: (1, H, W, 3) in place of (1, 3, H, W).
        whole: 8-bit levels in place of floats.
    """

    width: int
    height: int
    fit: Fit = "letterbox"
    rgb: bool = True
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spread: tuple[float, float, float] = (255.0, 255.0, 255.0)
    channels_last: bool = False
    whole: bool = False


@dataclass(frozen=True)
class Placement:
    """Where a picture lies in the input: input = picture * scale + offset, (x, y) each."""

    scale: tuple[float, float]
    offset: tuple[float, float]

    def back(self, corners: Floats) -> Floats:
        """Boxes (N, 4) x1, y1, x2, y2 in the input's px -> x, y, w, h in the picture's."""
        scale = np.array(self.scale * 2)
        out: Floats = (np.asarray(corners, np.float64) - np.array(self.offset * 2)) / scale
        out[:, 2:] -= out[:, :2]
        return out


def placement(prepared: Preparation, width: int, height: int) -> Placement:
    """Where a picture of a size is put."""
    across, down = prepared.width / width, prepared.height / height
    if prepared.fit == "stretch":
        return Placement((across, down), (0.0, 0.0))
    scale = min(across, down)
    inner = _inner(prepared, width, height)
    left, top = (0, 0)
    if prepared.fit == "letterbox":
        left, top = (prepared.width - inner[0]) // 2, (prepared.height - inner[1]) // 2
    return Placement((scale, scale), (float(left), float(top)))


def _inner(prepared: Preparation, width: int, height: int) -> tuple[int, int]:
    """Width and height that a picture has in the input."""
    if prepared.fit == "stretch":
        return prepared.width, prepared.height
    scale = min(prepared.width / width, prepared.height / height)
    return max(1, round(width * scale)), max(1, round(height * scale))


def as_input(image: NDArray[np.uint8], prepared: Preparation) -> NDArray[np.generic]:
    """A picture (H, W, 3) uint8 BGR as a network's input, float32 or uint8."""
    height, width = image.shape[:2]
    inner = _inner(prepared, width, height)
    smaller = inner[0] < width or inner[1] < height
    how = cv2.INTER_AREA if smaller else cv2.INTER_LINEAR
    picture = cast("NDArray[np.uint8]", cv2.resize(image, inner, interpolation=how))
    if inner != (prepared.width, prepared.height):
        left, top = (int(v) for v in placement(prepared, width, height).offset)
        canvas = np.full((prepared.height, prepared.width, 3), PADDING, np.uint8)
        canvas[top : top + inner[1], left : left + inner[0]] = picture
        picture = canvas
    if prepared.rgb:
        picture = picture[..., ::-1]
    if not prepared.channels_last:
        picture = picture.transpose(2, 0, 1)
    if prepared.whole:
        return np.ascontiguousarray(picture[None])
    shape = (1, 1, 3) if prepared.channels_last else (3, 1, 1)
    mean = np.array(prepared.mean, np.float32).reshape(shape)
    spread = np.array(prepared.spread, np.float32).reshape(shape)
    return np.ascontiguousarray(((picture - mean) / spread)[None], np.float32)
