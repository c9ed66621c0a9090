"""Touching bodies of any shape told apart: by brighter cores, and by the area that one body has.

A core is a part of a blob above a second, higher level; thin and dim parts (legs, wings, blur)
where bodies touch lie below it. A core that is as large as several bodies is split into as many
ellipses. Every pixel of the blob then goes to the ellipse that it is nearest to.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
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
MOST_POINTS = 4000
"""Of a core with more pixels than this every second one, or third, is looked at: the work of a
frame is bounded.
"""


def single_areas(cores: list[Blob]) -> list[int]:
    """The areas of those cores that look like one body: filled ellipses."""
    return [core.area for core in cores if compact(core)]


def compact(blob: Blob) -> bool:
    """Whether a blob looks like one body: a filled ellipse."""
    return _fill(blob) >= ONE_BODY_FILL


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
    if compact(core):
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
        # Ellipses of so many points are those of all of them; `_spread` takes each pixel.
        some = np.s_[:: max(1, len(y) // MOST_POINTS) if wanted > 1 else 1]
        y, x = y[some], x[some]
        groups[y, x] = (
            bodies + 1 + _clusters(x.astype(np.float64), y.astype(np.float64), wanted)
        )
        bodies += wanted
    if bodies < 2:
        return [own]
    return _spread(own, groups, bodies)


def parted(own: Image, left: int, top: int, bodies: Sequence[Ellipse]) -> list[Image]:
    """Divide a blob's pixels among bodies that were seen before.

    Args:
        own: (h, w) uint8, the blob's pixels in its box, 0 or 255.
        left: of that box in the picture, px.
        top: likewise.
        bodies: where each is expected, px of the picture.

    Returns:
        For each body its mask (h, w) uint8, 0 or 255; empty where nothing is nearest to it.
    """
    y, x = np.nonzero(own)
    fx, fy = x.astype(np.float64) + (left + 0.5), y.astype(np.float64) + (top + 0.5)
    least = np.full(len(x), np.inf)
    nearest = np.zeros(len(x), np.int64)
    for k, body in enumerate(bodies):
        _take_nearer(_distance(fx, fy, body), k, least, nearest)
    nearest = _settled(fx, fy, nearest, len(bodies))
    masks = []
    for k in range(len(bodies)):
        mask = np.zeros_like(own)
        mask[y[nearest == k], x[nearest == k]] = 255
        masks.append(mask)
    return masks


def _distance(x: Floats, y: Floats, body: Ellipse) -> Floats:
    """Squared distance of points from an ellipse, in its own half axes."""
    cos, sin = math.cos(body.theta), math.sin(body.theta)
    dx, dy = x - body.x, y - body.y
    along, across = dx * cos + dy * sin, dy * cos - dx * sin
    squared: Floats = (along / max(1.0, body.h / 2)) ** 2 + (
        across / max(1.0, body.w / 2)
    ) ** 2
    return squared


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
    blobs: list[Blob],
    labels: Labels,
    cores: Image,
    body_area: float,
) -> list[TouchingBody]:
    """The bodies in all blobs, blob by blob, as `split` divides them.

    Args:
        blobs: blob k - 1 is label k.
        labels: (H, W) int32, components from 1.
        cores: (H, W) uint8, 255 above the higher level.
        body_area: area of one body's core, px; 0 where it is not known.
    """
    found: list[TouchingBody] = []
    for blob in blobs:
        own = pixels_of(blob, labels)
        masks = split(own, own & within(blob, cores), body_area)
        found += [body_of(mask, blob, len(masks)) for mask in masks]
    return found


def body_of(mask: Image, blob: Blob, among: int) -> TouchingBody:
    """The body with these pixels of a blob, (h, w) uint8 in the blob's box."""
    left, top = int(blob.box[0]), int(blob.box[1])
    x, y, w, h = cv2.boundingRect(mask)
    box = (float(left + x), float(top + y), float(w), float(h))
    return TouchingBody(box, ellipse_of(mask, left, top), blob.id, among)


def within(blob: Blob, picture: NDArray[Any]) -> NDArray[Any]:
    """The part of a picture in a blob's box."""
    x, y, w, h = (int(v) for v in blob.box)
    return picture[y : y + h, x : x + w]


def pixels_of(blob: Blob, labels: Labels) -> Image:
    """A blob's pixels in its box, (h, w) uint8, 0 or 255."""
    return as_image((within(blob, labels) == blob.id).view(np.uint8) * np.uint8(255))


def shared_out(own: Image, bodies: int) -> list[Image]:
    """Divide a blob's pixels, (h, w) uint8, 0 or 255, among so many bodies of which nothing is
    known: for each its mask.
    """
    if bodies < 2:
        return [own]
    y, x = np.nonzero(own)
    groups = np.zeros(own.shape, np.int64)
    groups[y, x] = 1 + _clusters(x.astype(np.float64), y.astype(np.float64), bodies)
    return _spread(own, groups, bodies)


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
    return _settled(x, y, own, count)


def _settled(x: Floats, y: Floats, own: Ints, count: int) -> Ints:
    """An assignment of points to ellipses, repeated until each goes to the nearest one."""
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
