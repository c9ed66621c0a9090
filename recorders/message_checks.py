"""Holding decoded messages to their meaning: sizes, places and numbers that whoever reads them
may rely on.

Decoding checks types; what a recording claims beyond them (a body of 1e300 px, a blob that is not
there, a polygon of a million vertices) is checked here, once, before anything is computed or
allocated from it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

from recorders.limits import Limits
from recorders.messages import Blob, Detections, Ellipse, Regions

LARGEST = 1e7
"""Largest coordinate in px, and largest score: beyond any picture and any detector."""
MOST_BLOBS_ID = 2**31 - 1
MOST_POLYGONS = 200
MOST_VERTICES = 500
SIZE_MODEL_NUMBERS = 5
_HIGHEST_BODY = 10.0  # of the picture's longer side


def check_detections(d: Detections, limits: Limits) -> None:
    """Hold detections to their definition in `recorders.messages.Detections`.

    Raises:
        ValueError: names the frame, the value and the rule.
    """
    n = len(d.boxes)
    for what, count in (("detections", n), ("components", len(d.components))):
        if count > limits.max_detections_per_frame:
            limit = limits.max_detections_per_frame
            raise ValueError(
                f"{count} {what}, over the limit of {limit} (max_detections_per_frame)"
            )
    for field in ("scores", "labels", "ellipses", "blobs"):
        if len(getattr(d, field)) not in (0, n):
            raise ValueError(
                f"frame {d.frame}: {len(getattr(d, field))} {field} for {n} boxes"
            )
    _check_picture(d, limits)
    _check_boxes(d)
    if any(not abs(score) <= LARGEST for score in d.scores):
        raise ValueError(
            f"frame {d.frame}: a score of {max(d.scores, key=abs)}; wanted at most"
            f" {LARGEST:g}"
        )
    _check_ellipses(d, (e for e in d.ellipses if e is not None))
    _check_blobs(d)
    if d.size_model:
        _check_size_model(d)


def _check_picture(d: Detections, limits: Limits) -> None:
    if not (d.width and d.height):
        raise ValueError(f"frame {d.frame}: made for a picture of {d.width}x{d.height}")
    if max(d.width, d.height) > limits.max_picture_side:
        limit = limits.max_picture_side
        raise ValueError(
            f"frame {d.frame}: made for a picture of {d.width}x{d.height}, over the limit"
            f" of {limit} a side (max_picture_side)"
        )
    if d.width * d.height > limits.max_picture_pixels:
        limit = limits.max_picture_pixels
        raise ValueError(
            f"frame {d.frame}: made for a picture of {d.width}x{d.height}, over the limit"
            f" of {limit} pixels (max_picture_pixels)"
        )


def _check_boxes(d: Detections) -> None:
    for k, (x, y, w, h) in enumerate(d.boxes):
        # What is not a number is not smaller than anything.
        if not (
            0 < w < LARGEST
            and 0 < h < LARGEST
            and -LARGEST < x < LARGEST
            and -LARGEST < y < LARGEST
        ):
            raise ValueError(
                f"frame {d.frame}: box {k} is {d.boxes[k]}; wanted finite x, y and w, h"
                " over 0"
            )
    for k, (x, y, w, h) in enumerate(d.boxes):
        if x >= d.width or y >= d.height or x + w <= 0 or y + h <= 0:
            raise ValueError(
                f"frame {d.frame}: box {k} is {d.boxes[k]}, beyond the picture of"
                f" {d.width}x{d.height}"
            )


def _check_ellipses(d: Detections, ellipses: Iterable[Ellipse]) -> None:
    for e in ellipses:
        if not (
            -LARGEST < e.x < LARGEST
            and -LARGEST < e.y < LARGEST
            and 0 <= e.h < LARGEST
            and 0 <= e.w < LARGEST
            and -LARGEST < e.theta < LARGEST
        ):
            raise ValueError(
                f"frame {d.frame}: an ellipse is {e}; wanted finite places and axes of 0 or"
                " more"
            )


def _check_blobs(d: Detections) -> None:
    most = len(d.components) or MOST_BLOBS_ID
    for blob in d.blobs:
        if not -1 <= blob <= most:
            raise ValueError(
                f"frame {d.frame}: a detection of blob {blob}; the blobs are 1 to {most},"
                " -1 for none"
            )
    for number, c in enumerate(d.components, 1):
        if c.id != number:
            raise ValueError(
                f"frame {d.frame}: component {number} has the id {c.id}; ids count from 1"
                " in order"
            )
        if not _in_picture(c, d):
            raise ValueError(
                f"frame {d.frame}: component {number} with the box {c.box} and area"
                f" {c.area} is not in the picture of {d.width}x{d.height}"
            )
    _check_ellipses(d, (c.ellipse for c in d.components))


def _in_picture(c: Blob, d: Detections) -> bool:
    x, y, w, h = c.box
    return (
        x >= 0
        and y >= 0
        and w >= 1
        and h >= 1
        and x + w <= d.width
        and y + h <= d.height
        and 1 <= c.area <= w * h
    )


def _check_size_model(d: Detections) -> None:
    """Slope, intercept, aspect, low, high, as `recorders.segmentation.sizes.SizeModel` has them."""
    highest = _HIGHEST_BODY * max(d.width, d.height)
    if len(d.size_model) == SIZE_MODEL_NUMBERS and all(map(math.isfinite, d.size_model)):
        slope, intercept, aspect, low, high = d.size_model
        if (
            0 <= slope <= LARGEST
            and abs(intercept) <= LARGEST
            and 0 < aspect <= 10
            and 0 < low <= high <= highest
        ):
            return
    raise ValueError(
        f"frame {d.frame}: the size model {d.size_model} is of no body in a picture of this"
        " size"
    )


def check_regions(r: Regions) -> None:
    """Hold regions to what `recorders.sources.regions` takes from a file, as far as a reader
    relies on it.

    Raises:
        ValueError: names the polygon, the value and the rule.
    """
    named = [("roi", p) for p in r.roi] + [("border", p) for p in r.border]
    named += [(f"zone {z.name[:40]!r}", z.polygon) for z in r.zones]
    if len(named) > 3 * MOST_POLYGONS:
        raise ValueError(f"{len(named)} polygons, at most {3 * MOST_POLYGONS}")
    for name, polygon in named:
        if not 3 <= len(polygon) <= MOST_VERTICES:
            raise ValueError(
                f"{name} has {len(polygon)} vertices, wanted 3 to {MOST_VERTICES}"
            )
        if not all(abs(v) <= LARGEST for point in polygon for v in point):
            raise ValueError(f"{name} has a vertex beyond any picture")
