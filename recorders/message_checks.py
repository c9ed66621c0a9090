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
from recorders.messages import (
    BRIGHTEST_LIGHT,
    DARKEST_LIGHT,
    Blob,
    Detections,
    Ellipse,
    Regions,
)

LARGEST = 1e7
"""Largest coordinate in px, and largest score: beyond any picture and any detector."""
MOST_BLOBS_ID = 2**31 - 1
MOST_POLYGONS = 200
MOST_VERTICES = 500
SIZE_MODEL_NUMBERS = 5
_HIGHEST_BODY = 10.0  # of the picture's longer side


def check_detections(detections: Detections, limits: Limits) -> None:
    """Hold detections to their definition in `recorders.messages.Detections`.

    Raises:
        ValueError: names the frame, the value and the rule.
    """
    n = len(detections.boxes)
    for what, count in (("detections", n), ("components", len(detections.components))):
        if count > limits.max_detections_per_frame:
            limit = limits.max_detections_per_frame
            raise ValueError(
                f"{count} {what}, over the limit of {limit} (max_detections_per_frame)"
            )
    for field in ("scores", "labels", "ellipses", "blobs"):
        if len(getattr(detections, field)) not in (0, n):
            raise ValueError(
                f"frame {detections.frame}: {len(getattr(detections, field))} {field} for {n} boxes"
            )
    _check_picture(detections, limits)
    _check_boxes(detections)
    if any(not abs(score) <= LARGEST for score in detections.scores):
        raise ValueError(
            f"frame {detections.frame}: a score of {max(detections.scores, key=abs)}; wanted at most"
            f" {LARGEST:g}"
        )
    _check_ellipses(
        detections, (ellipse for ellipse in detections.ellipses if ellipse is not None)
    )
    _check_blobs(detections)
    if detections.size_model:
        _check_size_model(detections)
    if detections.light and not (
        len(detections.light) == 3
        and all(DARKEST_LIGHT <= v <= BRIGHTEST_LIGHT for v in detections.light)
    ):
        raise ValueError(
            f"frame {detections.frame}: the light {detections.light}; wanted three factors, of"
            f" blue, green and red, from {DARKEST_LIGHT:g} to {BRIGHTEST_LIGHT:g}"
        )
    most = max(detections.width, detections.height)
    if detections.moved and not (
        len(detections.moved) == 2 and max(map(abs, detections.moved)) <= most
    ):
        raise ValueError(
            f"frame {detections.frame}: the picture moved by {detections.moved}; wanted pixels right"
            f" and down, up to {most}"
        )


def _check_picture(detections: Detections, limits: Limits) -> None:
    if not (detections.width and detections.height):
        raise ValueError(
            f"frame {detections.frame}: made for a picture of {detections.width}x{detections.height}"
        )
    if max(detections.width, detections.height) > limits.max_picture_side:
        limit = limits.max_picture_side
        raise ValueError(
            f"frame {detections.frame}: made for a picture of {detections.width}x{detections.height}, over the limit"
            f" of {limit} a side (max_picture_side)"
        )
    if detections.width * detections.height > limits.max_picture_pixels:
        limit = limits.max_picture_pixels
        raise ValueError(
            f"frame {detections.frame}: made for a picture of {detections.width}x{detections.height}, over the limit"
            f" of {limit} pixels (max_picture_pixels)"
        )


def _check_boxes(detections: Detections) -> None:
    for index, (x, y, w, h) in enumerate(detections.boxes):
        # What is not a number is not smaller than anything.
        if not (
            0 < w < LARGEST
            and 0 < h < LARGEST
            and -LARGEST < x < LARGEST
            and -LARGEST < y < LARGEST
        ):
            raise ValueError(
                f"frame {detections.frame}: box {index} is {detections.boxes[index]}; wanted finite x, y and w, h"
                " over 0"
            )
    for index, (x, y, w, h) in enumerate(detections.boxes):
        if x >= detections.width or y >= detections.height or x + w <= 0 or y + h <= 0:
            raise ValueError(
                f"frame {detections.frame}: box {index} is {detections.boxes[index]}, beyond the picture of"
                f" {detections.width}x{detections.height}"
            )


def _check_ellipses(detections: Detections, ellipses: Iterable[Ellipse]) -> None:
    for ellipse in ellipses:
        if not (
            -LARGEST < ellipse.x < LARGEST
            and -LARGEST < ellipse.y < LARGEST
            and 0 <= ellipse.h < LARGEST
            and 0 <= ellipse.w < LARGEST
            and -LARGEST < ellipse.theta < LARGEST
        ):
            raise ValueError(
                f"frame {detections.frame}: an ellipse is {ellipse}; wanted finite places and axes of 0 or"
                " more"
            )


def _check_blobs(detections: Detections) -> None:
    most = len(detections.components) or MOST_BLOBS_ID
    for blob in detections.blobs:
        if not -1 <= blob <= most:
            raise ValueError(
                f"frame {detections.frame}: a detection of blob {blob}; the blobs are 1 to {most},"
                " -1 for none"
            )
    for number, component in enumerate(detections.components, 1):
        if component.id != number:
            raise ValueError(
                f"frame {detections.frame}: component {number} has the id {component.id}; ids count from 1"
                " in order"
            )
        if not _in_picture(component, detections):
            raise ValueError(
                f"frame {detections.frame}: component {number} with the box {component.box} and area"
                f" {component.area} is not in the picture of {detections.width}x{detections.height}"
            )
    _check_ellipses(detections, (component.ellipse for component in detections.components))


def _in_picture(blob: Blob, detections: Detections) -> bool:
    x, y, w, h = blob.box
    return (
        x >= 0
        and y >= 0
        and w >= 1
        and h >= 1
        and x + w <= detections.width
        and y + h <= detections.height
        and 1 <= blob.area <= w * h
    )


def _check_size_model(detections: Detections) -> None:
    """Slope, intercept, aspect, low, high, as `recorders.segmentation.sizes.SizeModel` has them."""
    highest = _HIGHEST_BODY * max(detections.width, detections.height)
    if len(detections.size_model) == SIZE_MODEL_NUMBERS and all(
        map(math.isfinite, detections.size_model)
    ):
        slope, intercept, aspect, low, high = detections.size_model
        if (
            0 <= slope <= LARGEST
            and abs(intercept) <= LARGEST
            and 0 < aspect <= 10
            and 0 < low <= high <= highest
        ):
            return
    raise ValueError(
        f"frame {detections.frame}: the size model {detections.size_model} is of no body in a picture of this"
        " size"
    )


def check_regions(regions: Regions) -> None:
    """Hold regions to what `recorders.sources.regions` takes from a file, as far as a reader
    relies on it.

    Raises:
        ValueError: names the polygon, the value and the rule.
    """
    named = [("roi", p) for p in regions.roi] + [("border", p) for p in regions.border]
    named += [(f"zone {zone.name[:40]!r}", zone.polygon) for zone in regions.zones]
    if len(named) > 3 * MOST_POLYGONS:
        raise ValueError(f"{len(named)} polygons, at most {3 * MOST_POLYGONS}")
    for name, polygon in named:
        if not 3 <= len(polygon) <= MOST_VERTICES:
            raise ValueError(
                f"{name} has {len(polygon)} vertices, wanted 3 to {MOST_VERTICES}"
            )
        if not all(abs(v) <= LARGEST for point in polygon for v in point):
            raise ValueError(f"{name} has a vertex beyond any picture")
