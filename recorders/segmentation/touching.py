"""Touching bodies of any shape told apart: by brighter cores, and by the area that one body has.

A core is a part of a blob above a second, higher level; thin and dim parts (legs, wings, blur)
where bodies touch lie below it. A core that is as large as several bodies is split into as many
ellipses. Every pixel of the blob then goes to the ellipse that it is nearest to.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob, Box, Ellipse
from recorders.pictures import Image
from recorders.segmentation.blobs import Labels, components, ellipse_of
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

MIN_CORE = 0.35
"""Least area of a core, of one body's core."""
ONE_BODY_FILL = 0.85
"""From this share of its ellipse on, a core looks like one body."""
MAX_ONE_BODY = 1.9
"""From this many typical areas on, it is not, whatever it looks like."""
MIN_TWO_BODIES = 1.4
"""A core that does not look like one body is several from this many typical areas on."""
MOST_BODIES = 40
"""What is as large as more bodies than this is none of them: a hand, a flash of light."""
ITERATIONS = 20


def single_areas(cores: list[Blob]) -> list[int]:
    """The areas of those cores that look like one body: filled ellipses."""
    return [core.area for core in cores if _fill(core) >= ONE_BODY_FILL]


def _fill(blob: Blob) -> float:
    """A blob's area over that of its ellipse: 1 for an ellipse, less for bodies that meet at an
    angle.
    """
    return blob.area / max(1.0, math.pi / 4 * blob.ellipse.h * blob.ellipse.w)


def bodies_in(core: Blob, body_area: float) -> int:
    """How many bodies a core is made of."""
    if body_area <= 0:
        return 1
    share = core.area / body_area
    if share > MOST_BODIES:
        return 1
    if _fill(core) >= ONE_BODY_FILL:
        return max(1, int(share + 0.5)) if share >= MAX_ONE_BODY else 1
    return max(2, int(share + 0.5)) if share >= MIN_TWO_BODIES else 1


def split(own: Image, core: Image, body_area: float) -> list[Image]:
    """Divide a blob's pixels among the bodies in it.

    Args:
        own: (h, w) uint8, the blob's pixels in its box, 0 or 255.
        core: (h, w) uint8, those of them above the higher level, 0 or 255.
        body_area: area of one body's core, px; 0 where it is not known.

    Returns:
        For each body its mask (h, w) uint8, 0 or 255; in the order of the cores' labels.
    """
    _, labels, cores = components(core, MIN_CORE * body_area)
    groups = np.zeros(own.shape, np.int64)
    bodies = 0
    for part in cores:
        wanted = bodies_in(part, body_area)
        y, x = np.nonzero(labels == part.id)
        groups[y, x] = (
            bodies + 1 + _clusters(x.astype(np.float64), y.astype(np.float64), wanted)
        )
        bodies += wanted
    if bodies < 2:
        return [own]
    return _spread(own, groups, bodies)


@dataclass(frozen=True, slots=True)
class TouchingBody:
    """A body in a blob: box and ellipse in px of the picture, the blob's id, how many bodies are
    in that blob.
    """

    box: Box
    ellipse: Ellipse
    blob: int
    among: int


def divide(
    blobs: list[Blob], labels: Labels, cores: Image | None, body_area: float
) -> list[TouchingBody]:
    """The bodies in all blobs, blob by blob, as `split` divides them.

    Args:
        blobs: blob k - 1 is label k.
        labels: (H, W) int32, components from 1.
        cores: (H, W) uint8, 255 above the higher level; None: blobs are their own cores.
        body_area: area of one body's core, px; 0 where it is not known.
    """
    found: list[TouchingBody] = []
    for blob in blobs:
        if cores is None and bodies_in(blob, body_area) == 1:
            found.append(TouchingBody(blob.box, blob.ellipse, blob.id, 1))
            continue
        own = pixels_of(blob, labels)
        masks = split(own, own if cores is None else own & within(blob, cores), body_area)
        left, top = int(blob.box[0]), int(blob.box[1])
        for mask in masks:
            x, y, w, h = cv2.boundingRect(mask)
            box = (float(left + x), float(top + y), float(w), float(h))
            found.append(
                TouchingBody(box, ellipse_of(mask, left, top), blob.id, len(masks))
            )
    return found


def within(blob: Blob, picture: NDArray[Any]) -> NDArray[Any]:
    """The part of a picture in a blob's box."""
    x, y, w, h = (int(v) for v in blob.box)
    return picture[y : y + h, x : x + w]


def pixels_of(blob: Blob, labels: Labels) -> Image:
    """A blob's pixels in its box, (h, w) uint8, 0 or 255."""
    return as_image((within(blob, labels) == blob.id).view(np.uint8) * np.uint8(255))


def _spread(own: Image, groups: Ints, bodies: int) -> list[Image]:
    """Give each pixel of the blob to the body with the nearest ellipse; one mask for each body."""
    y, x = np.nonzero(own)
    fx, fy = x.astype(np.float64), y.astype(np.float64)
    least = np.full(len(x), np.inf)
    nearest = np.zeros(len(x), np.int64)
    for k in range(bodies):
        cy, cx = np.nonzero(groups == k + 1)
        if len(cx):
            distance = np.sqrt(
                _mahalanobis(fx, fy, cx.astype(np.float64), cy.astype(np.float64))[0]
            )
            _take_nearer(distance, k, least, nearest)
    masks = []
    for k in range(bodies):
        mask = np.zeros_like(own)
        mask[y[nearest == k], x[nearest == k]] = 255
        if mask.any():
            masks.append(mask)
    return masks


def _clusters(x: Floats, y: Floats, count: int) -> Ints:
    """Hard assignment of points to ``count`` ellipses, started from stripes across the longest
    extent.
    """
    own = np.zeros(len(x), np.int64)
    if count < 2 or len(x) < 4 * count:
        return own
    mx, my = x.mean(), y.mean()
    sxx, syy, sxy = (
        ((x - mx) ** 2).mean(),
        ((y - my) ** 2).mean(),
        ((x - mx) * (y - my)).mean(),
    )
    theta = np.arctan2(2 * sxy, sxx - syy) / 2
    along = (x - mx) * np.cos(theta) + (y - my) * np.sin(theta)
    own[np.argsort(along, kind="stable")] = np.arange(len(x)) * count // len(x)
    for _ in range(ITERATIONS):
        least = np.full(len(x), np.inf)
        new = np.zeros(len(x), np.int64)
        for k in range(count):
            members = own == k
            if np.count_nonzero(members) >= 3:
                squared, size = _mahalanobis(x, y, x[members], y[members])
                _take_nearer(squared + size, k, least, new)
        if np.array_equal(new, own):
            break
        own = new
    return own


def _take_nearer(cost: Floats, k: int, least: Floats, nearest: Ints) -> None:
    """Put ``k`` where its cost is less than the least so far (equal costs: the first), in place."""
    nearer = cost < least
    nearest[nearer] = k
    np.copyto(least, cost, where=nearer)


def _mahalanobis(x: Floats, y: Floats, px: Floats, py: Floats) -> tuple[Floats, float]:
    """Squared distance of points from the ellipse of other points, and the log of its
    determinant.
    """
    mx, my = px.mean(), py.mean()
    dx, dy, px, py = x - mx, y - my, px - mx, py - my
    sxx, syy, sxy = (px * px).mean() + 1.0, (py * py).mean() + 1.0, (px * py).mean()
    determinant = sxx * syy - sxy * sxy
    return (syy * dx * dx - 2 * sxy * dx * dy + sxx * dy * dy) / determinant, float(
        np.log(determinant)
    )
