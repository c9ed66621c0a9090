"""The light of a picture against that of its background, and whether it has colours.

A lamp, the sun or the camera's exposure changes the brightness of all things: by a step, in
proportion, or along a curve. Another lamp, or the camera's white balance, changes red, green and
blue by a curve each. Medians over the picture find it as long as bodies are the smaller part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recorders.messages import BRIGHTEST_LIGHT, DARKEST_LIGHT
from recorders.pictures import Image
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

Floats = NDArray[np.float64]
Curve = tuple[tuple[float, float], ...]

AGREES_LEVELS = 8
"""A pixel agrees with a light that predicts its brightness within this, levels."""
LEAST_STEP = 2
"""Smaller steps are none."""
BINS = 8
"""Medians are taken of so many equal parts of the picture, the darkest first."""
LEAST_RANGE = 12
"""Two parts tell of a proportion if their brightness differs by this, levels."""
DARKEST, BRIGHTEST = 6, 248
"""Outside of these a camera does not tell brightness, levels."""
TOLD, GREY = 0.05, 64.0
"""A light is told of with a frame if it differs by this share; of a light that has a curve for each
colour, that of a grey of so many levels.
"""
CLOSE = 0.75
"""Where so much of the picture agrees with a light, no other one is looked for."""
LARGE_STEP = 0.12
"""But a step of more than this, of the usual brightness, is more likely a proportion."""
BETTER = 0.05
"""A proportion or a curve holds if by so much more of the picture agrees with it than with what is
simpler,"""
LEAST_CHANGE = 0.06
"""and a proportion if it differs from 1 by this."""
GREY_LEVELS = 3
"""Cr and Cb of a grey pixel differ from 128 by at most this: compression shifts them a little."""
TINT_LEVELS = 6
"""A pixel agrees in colour, too, if its Cr and Cb together are off by no more than this, levels."""
COLOURED_LEVELS = 8
"""By how much the colours changed is told by pixels whose Cr or Cb is at least so far from grey."""
CELLS = 4
"""The picture is divided into so many rows and columns."""
COLOURED_CELL, COLOURED_CELLS = 0.05, 0.25
"""A cell has colours from this share of its pixels on; a picture from this share of its cells on."""


@dataclass(frozen=True)
class Light:
    """How the background's brightness becomes the picture's: times ``gain``, plus ``offset``
    levels; or by a curve.

    Attributes:
        chroma: factors of Cr and Cb about grey; none: ``gain``.
        curve: levels of the background and of the picture, in order; none: there is no curve.
        channels: such a curve, and the slope beyond its end, for each of blue, green and red, in
            place of all of these; none: all change alike.
        known: most of the picture agrees.
        agreeing: the share of the picture that agrees.
        level: the picture's brightness as a share of the background's, as far as it is known.
        tint: by how many levels red and blue (Cr and Cb) differ from the background's, in the
            middle, where each colour has a curve of its own.
    """

    gain: float = 1.0
    offset: int = 0
    known: bool = True
    agreeing: float = 1.0
    level: float = 1.0
    tint: tuple[float, float] = (0.0, 0.0)
    chroma: tuple[float, ...] = ()
    curve: Curve = ()
    channels: tuple[tuple[Curve, float], ...] = ()

    @property
    def same(self) -> bool:
        """The background needs no change."""
        return self.gain == 1.0 and self.offset == 0

    @property
    def factors(self) -> list[float]:
        """By how much brighter blue, green and red are than in the background, as factors; empty
        where it is not by `TOLD` of them, or not known.
        """
        found = [self.level] * 3
        if self.channels:
            found = [
                float(_along(curve, np.array([GREY]), slope)[0]) / GREY
                for curve, slope in self.channels
            ]
        if not self.known or max(abs(v - 1.0) for v in found) < TOLD:
            return []
        return [round(min(BRIGHTEST_LIGHT, max(DARKEST_LIGHT, v)), 2) for v in found]

    def over(self, colour: Image) -> Image:
        """A background (H, W, 3) uint8 in Y, Cr, Cb under this light."""
        if self.same:
            return colour
        if self.channels:
            return _by_channel(colour, self.channels)
        if self.gain == 1.0:
            lit = colour.copy()
            lit[..., 0] = np.clip(colour[..., 0].astype(np.int16) + self.offset, 0, 255)
            return lit
        factors = self.chroma or (self.gain, self.gain)
        return as_image(cv2.LUT(colour, _table(factors, self._lit)))

    def _lit(self, levels: Floats) -> Floats:
        """Levels of the background under this light."""
        if self.curve:
            return _along(self.curve, levels, self.gain)
        lit: Floats = self.gain * levels + self.offset
        return lit

    def _unlit(self, levels: Floats) -> Floats:
        """Levels of the picture in the background's own light."""
        if self.curve:
            return _along(_turned(self.curve), levels, 1 / self.gain)
        unlit: Floats = (levels - self.offset) / self.gain
        return unlit

    def off(self, picture: Image) -> Image:
        """The picture as it would be in the background's own light."""
        if self.same:
            return picture
        if self.channels:
            return _by_channel(
                picture, tuple((_turned(c), 1 / slope) for c, slope in self.channels)
            )
        factors = self.chroma or (self.gain, self.gain)
        return as_image(cv2.LUT(picture, _table([1 / f for f in factors], self._unlit)))

    def level_under(self, level: Image) -> Image:
        """The least difference that is foreground, (H, W) uint8: contrasts fall with the light,
        noise less.
        """
        if self.gain >= 1.0:
            return level
        share = (1.0 + self.gain) / 2
        table = np.array([max(1, int(v * share)) for v in range(256)], np.uint8)
        return as_image(cv2.LUT(level, table))


def _turned(curve: Curve) -> Curve:
    """The way back."""
    return tuple((b, a) for a, b in curve)


def _by_channel(picture: Image, channels: Sequence[tuple[Curve, float]]) -> Image:
    """A picture in Y, Cr, Cb whose blue, green and red go along a curve each."""
    v = np.arange(256.0)
    levels = np.stack([_along(curve, v, slope) for curve, slope in channels], -1)
    table = np.clip(np.rint(levels), 0, 255).astype(np.uint8)[:, None]
    colours = cv2.LUT(cv2.cvtColor(picture, cv2.COLOR_YCrCb2BGR), table)
    return as_image(cv2.cvtColor(colours, cv2.COLOR_BGR2YCrCb))


def _along(curve: Curve, levels: Floats, slope: float) -> Floats:
    """Levels along a curve, from black on and beyond its end by a slope."""
    x, y = (list(v) for v in zip(*curve, strict=True))
    ends = y[-1] + slope * (255 - x[-1])
    xs = np.maximum.accumulate(np.array([0.0, *x, 255.0]))
    ys = np.maximum.accumulate(np.array([0.0, *y, ends]))
    there: Floats = np.interp(levels, xs, ys)
    return there


def _table(factors: Sequence[float], lit: Callable[[Floats], Floats]) -> Image:
    """Y by a function; Cr and Cb by a factor each about grey, (256, 1, 3) uint8."""
    v = np.arange(256.0)
    levels = [lit(v), *(128 + factor * (v - 128) for factor in factors)]
    table: Image = np.clip(np.rint(np.stack(levels, -1)), 0, 255).astype(np.uint8)
    return table[:, None]


def light_of(picture: Image, colour: Image) -> Light:
    """The light of a picture against a background, both (H, W, 1 or 3) uint8 with Y first.

    A step in brightness, as the median difference, holds where half of the picture agrees; a
    proportion where clearly more of the picture agrees with it.
    """
    step = max(1, min(picture.shape[:2]) // 48)
    now = picture[::step, ::step, 0].astype(np.int16)
    behind = colour[::step, ::step, 0]
    difference = now - behind
    counts = np.bincount((difference + 255).ravel(), minlength=511)
    offset = int(np.searchsorted(np.cumsum(counts), difference.size / 2)) - 255
    agreeing = int(counts[max(0, offset + 247) : offset + 264].sum())
    share = agreeing / difference.size
    stepped = Light(known=False, agreeing=share)
    if 2 * agreeing >= difference.size:
        stepped = Light(1.0, offset if abs(offset) >= LEAST_STEP else 0, agreeing=share)
    found = stepped
    large = abs(offset) > LARGE_STEP * float(np.median(behind))
    if share < CLOSE or large:
        found = _proportional(now, behind, stepped)
    coloured = min(picture.shape[2], colour.shape[2]) > 1
    if coloured:
        found = _in_colours(picture[::step, ::step], colour[::step, ::step], found)
    if found.same or found.channels:
        return found
    if found.curve and coloured:
        chroma = _chroma(picture[::step, ::step], colour[::step, ::step])
        found = replace(found, chroma=chroma)
    usual = np.array([float(np.median(behind))])
    lit = float(found._lit(usual)[0]) if found.gain != 1.0 else usual[0] + found.offset
    return replace(found, level=max(0.0, float(lit)) / max(1.0, float(usual[0])))


def _proportional(now: NDArray[np.int16], behind: Image, stepped: Light) -> Light:
    """A light in proportion, or along a curve, where one of them holds better than a step."""
    if behind.size < BINS:
        return stepped
    pairs, gain = _medians(now, behind)
    if not 0.05 <= gain <= 20:
        return stepped
    found = stepped
    if abs(gain - 1.0) >= LEAST_CHANGE:
        offset = round(float(np.median([b - gain * a for a, b in pairs])))
        found = _better(Light(gain, offset), found, now, behind)
    if found.agreeing < CLOSE and len(pairs) >= BINS // 2:
        curve = Light(gain if gain != 1.0 else 1.001, curve=tuple(pairs))
        found = _better(curve, found, now, behind)
    return found


def _medians(now: NDArray[np.int16], behind: Image) -> tuple[Curve, float]:
    """Levels of the background and of the picture over `BINS` parts of it, the darkest first, and
    the slope that is usual between them.
    """
    order = np.argsort(behind, axis=None, kind="stable")
    pairs = [
        (float(np.median(behind.ravel()[part])), float(np.median(now.ravel()[part])))
        for part in np.array_split(order, BINS)
    ]
    pairs = [p for p in pairs if min(p) >= DARKEST and max(p) <= BRIGHTEST]
    slopes = [
        (d - b) / (c - a)
        for k, (a, b) in enumerate(pairs)
        for c, d in pairs[k + 1 :]
        if c - a >= LEAST_RANGE
    ]
    return tuple(pairs), float(np.median(slopes)) if slopes else 1.0


def _in_colours(now: Image, behind: Image, found: Light) -> Light:
    """A light that changes blue, green and red by a curve each, where clearly more of the picture
    agrees with it, in its colours as well, than with the one that was found.
    """
    now, behind = np.ascontiguousarray(now), np.ascontiguousarray(behind)
    lit = found.over(behind)
    share = _agreeing(now, lit)
    if share >= CLOSE or now.size < 3 * BINS:
        return found
    tint = np.abs(np.median(now[..., 1:].astype(np.int16) - lit[..., 1:], axis=(0, 1)))
    if tint.max() < LEAST_STEP:
        return found
    colours, grounds = (
        cv2.cvtColor(p, cv2.COLOR_YCrCb2BGR).astype(np.int16) for p in (now, behind)
    )
    channels = [_medians(colours[..., k], as_image(grounds[..., k])) for k in range(3)]
    if any(len(c) < BINS // 2 or not 0.05 <= slope <= 20 for c, slope in channels):
        return found
    light = Light(2.0, channels=tuple(channels))
    lit = light.over(behind)
    better = _agreeing(now, lit)
    if better < 0.5 or better - share < BETTER:
        return found
    level = float(np.median(lit[..., 0])) / max(1.0, float(np.median(behind[..., 0])))
    gain = level if level != 1.0 else 1.001
    red, blue = np.median(
        lit[..., 1:].astype(np.int16) - behind[..., 1:], axis=(0, 1)
    ).tolist()
    return replace(light, gain=gain, agreeing=better, level=level, tint=(red, blue))


def _agreeing(now: Image, lit: Image) -> float:
    """The share of a picture that agrees with a background under a light in brightness and
    colours.
    """
    apart = np.abs(now.astype(np.int16) - lit)
    tint = apart[..., 1] + apart[..., 2]
    held: NDArray[np.bool_] = (apart[..., 0] <= AGREES_LEVELS) & (tint <= TINT_LEVELS)
    return int(np.count_nonzero(held)) / held.size


def _chroma(now: Image, behind: Image) -> tuple[float, float]:
    """By which factor Cr and Cb differ from grey against the background's, in the middle."""
    factors = []
    for k in (1, 2):
        before = behind[..., k].astype(np.float64) - 128
        told = np.abs(before) >= COLOURED_LEVELS
        ratio = (now[..., k][told].astype(np.float64) - 128) / before[told]
        middle = float(np.median(ratio)) if ratio.size >= BINS else 1.0
        factors.append(min(4.0, max(0.25, middle)))
    return factors[0], factors[1]


def _better(light: Light, other: Light, now: NDArray[np.int16], behind: Image) -> Light:
    """The light with which more of the picture agrees, the other one where it is not clear."""
    said = np.clip(np.rint(light._lit(behind.astype(np.float64))), 0, 255)
    share = int(np.count_nonzero(np.abs(now - said) <= AGREES_LEVELS)) / now.size
    if share < 0.5 or share - other.agreeing < BETTER:
        return other
    return replace(light, agreeing=share)


def coloured_share(picture: Image) -> float:
    """The share of a picture's cells that have colours; (H, W, 3) uint8 in Y, Cr, Cb."""
    step = max(1, min(picture.shape[:2]) // 48)
    small = picture[::step, ::step, 1:]
    coloured = (small < 128 - GREY_LEVELS) | (small > 128 + GREY_LEVELS)
    either = coloured[..., 0] | coloured[..., 1]
    rows = [k * len(either) // CELLS for k in range(CELLS)]
    columns = [k * either.shape[1] // CELLS for k in range(CELLS)]
    if min(either.shape) < CELLS:
        return float(np.count_nonzero(either) >= COLOURED_CELL * either.size)
    counts = np.add.reduceat(np.add.reduceat(either, rows, 0, np.int64), columns, 1)
    held = np.count_nonzero(counts * CELLS**2 >= COLOURED_CELL * either.size)
    return int(held) / CELLS**2


def one_colour_share(picture: Image) -> tuple[float, str]:
    """The share of a picture that has its most usual colour, and what that is called."""
    step = max(1, min(picture.shape[:2]) // 48)
    small = picture[::step, ::step].reshape(-1, 3).astype(np.int16)
    middle = np.median(small, axis=0)
    near = (np.abs(small - middle) <= 10).all(axis=1)
    luma, red, blue = (float(v) for v in middle - (0, 128, 128))
    name = "grey"
    if max(abs(red), abs(blue)) > 16:
        name = "blue" if blue > abs(red) else "red" if red > 16 else "green"
    elif luma < 40:
        name = "black"
    elif luma > 215:
        name = "white"
    return float(np.count_nonzero(near)) / len(small), name
