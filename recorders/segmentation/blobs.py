"""Connected components of a mask: size filter, labels, and ellipses of first and second moments.

The ellipse is the EVENTS paper's representation of a detection (section 2): a blob's first- and
second-order moments as z = (x, y, h, w, theta).
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from recorders.masks import has_few_labels
from recorders.messages import Blob, Box, Ellipse
from recorders.pictures import Image
from recorders.vision import cv2

Labels = NDArray[np.int32]

MOST_BLOBS = 2000
"""Of more components, the largest are kept (the first of equals)."""
PERSISTENT = 0.25
"""Least share of the smallest area that is kept where there was foreground before."""


def ellipse_of(mask: Image, left: float = 0.0, top: float = 0.0) -> Ellipse:
    """The ellipse of a mask's non-zero pixels (EVENTS 2).

    With Sxx, Syy, Sxy the central second moments over the area: theta = atan2(2 Sxy, Sxx - Syy) /
    2, and the full axis lengths are 4 sqrt(lambda_1) >= 4 sqrt(lambda_2) of the covariance's
    eigenvalues.

    Args:
        mask: (H, W) uint8 with at least one non-zero pixel.
        left: x of the mask's left border in the picture, px.
        top: y of the mask's top border in the picture, px.

    Returns:
        Centre in px with pixel centres at integers + 0.5; theta in (-pi/2, pi/2] from the x axis
        to the major axis.
    """
    m = cv2.moments(mask, binaryImage=True)
    area = m["m00"]
    sxx, syy, sxy = m["mu20"] / area, m["mu02"] / area, m["mu11"] / area
    mean, half = (sxx + syy) / 2, math.hypot((sxx - syy) / 2, sxy)
    theta = math.atan2(2 * sxy, sxx - syy) / 2
    return Ellipse(
        x=left + m["m10"] / area + 0.5,
        y=top + m["m01"] / area + 0.5,
        h=4 * math.sqrt(mean + half),
        w=4 * math.sqrt(max(0.0, mean - half)),
        theta=theta if theta > -math.pi / 2 else math.pi / 2,
    )


def _kept(
    mask: Image, min_area: float, before: Image | None = None
) -> tuple[Labels, int, int, list[tuple[int, ...]]]:
    """The components that are large enough, as they lie in a part of the mask that holds all of
    them.

    Returns:
        The part's labels (h, w) int32, its left and top px in the mask, and label, x, y, width,
        height (in the part) and area of each component, in the labels' order.
    """
    left, top, w, h = (int(v) for v in cv2.boundingRect(mask))
    if w == 0:
        return np.zeros((0, 0), np.int32), 0, 0, []
    # Labels are in scan order of 2 x 2 blocks, so a part that starts at even places has the same
    # order as the whole.
    left, w, top, h = left - left % 2, w + left % 2, top - top % 2, h + top % 2
    count, numbered, stats = _labelled(mask[top : top + h, left : left + w])
    areas = stats[1:count, cv2.CC_STAT_AREA]
    kept = np.flatnonzero(areas >= max(1.0, min_area)) + 1
    if before is not None:
        there = before[top : top + h, left : left + w]
        small = _persistent(numbered, stats, min_area, there)
        kept = np.union1d(kept, small)
    if len(kept) > MOST_BLOBS:
        kept = np.sort(kept[np.argsort(-areas[kept - 1], kind="stable")[:MOST_BLOBS]])
    found = [(k, *row) for k, row in zip(kept.tolist(), stats[kept].tolist(), strict=True)]
    return numbered, left, top, found


def _persistent(
    numbered: Labels, stats: Labels, min_area: float, before: Image
) -> NDArray[np.intp]:
    """Components too small by themselves that mostly lie where there was foreground in the frame
    before.

    Whoever steps behind a post or a sign is still seen at its sides: what began as a body goes on
    in its pieces.
    """
    areas = stats[:, cv2.CC_STAT_AREA]
    few = np.flatnonzero((areas < min_area) & (areas >= max(1.0, PERSISTENT * min_area)))
    found = []
    for k in few[few > 0].tolist():
        x, y, w, h, area = stats[k].tolist()
        here = (numbered[y : y + h, x : x + w] == k) & (before[y : y + h, x : x + w] > 0)
        if 2 * np.count_nonzero(here) >= area:
            found.append(k)
    return np.array(found, np.intp)


def numbered(mask: Image) -> tuple[Labels, int, int, NDArray[np.float64]]:
    """All components of a mask: labels (h, w) int32 from 1 in the part of it that holds them, the
    part's left and top px in the mask, and each one's x, y, w, h, area, (N, 5), px of the mask.
    """
    left, top, w, h = (int(v) for v in cv2.boundingRect(mask))
    if w == 0:
        return np.zeros((0, 0), np.int32), 0, 0, np.zeros((0, 5))
    count, labels, stats = _labelled(mask[top : top + h, left : left + w])
    rows = np.asarray(stats[1:count], np.float64).reshape(-1, 5)
    return labels, left, top, rows + np.array([left, top, 0, 0, 0])


def _labelled(part: Image) -> tuple[int, Labels, NDArray[np.int32]]:
    """How many labels there are with the background's, the labels (h, w) int32, and each one's x, y,
    w, h, area, in scan order of 2 x 2 blocks.
    """
    few = has_few_labels(part)
    count, labels, stats, _ = cv2.connectedComponentsWithStatsWithAlgorithm(
        np.ascontiguousarray(part),
        8,
        cv2.CV_16U if few else cv2.CV_32S,
        cv2.CCL_SPAGHETTI if few else cv2.CCL_BBDT,
    )
    return count, np.asarray(labels, np.int32), np.asarray(stats, np.int32)


def outlines(mask: Image, min_area: float) -> list[tuple[Box, int]]:
    """Box and area of each component that is large enough: what `components` says of them,
    without painting them.
    """
    _, left, top, found = _kept(mask, min_area)
    return [
        ((float(left + x), float(top + y), float(w), float(h)), area)
        for _, x, y, w, h, area in found
    ]


def components(
    mask: Image, min_area: float, before: Image | None = None
) -> tuple[Image, Labels, list[Blob]]:
    """Keep the components that are large enough, and describe them.

    Args:
        mask: (H, W) uint8, non-zero is foreground, 8-connected.
        min_area: smallest area to keep, px.
        before: the mask that was kept of the frame before, where smaller pieces of it may stay
            (`PERSISTENT`).

    Returns:
        The mask of what was kept (0 or 255), its labels (H, W) int32 from 1, and blob k of label
        k in this order.
    """
    height, width = mask.shape
    clean, labels = np.zeros((height, width), np.uint8), np.zeros((height, width), np.int32)
    blobs: list[Blob] = []
    numbered, left, top, found = _kept(mask, min_area, before)
    # Leaving some out keeps the others' order.
    for number, (k, x, y, bw, bh, area) in enumerate(found, 1):
        pixels = (numbered[y : y + bh, x : x + bw] == k).view(np.uint8)
        x, y = left + x, top + y  # noqa: PLW2901
        cv2.copyTo(
            np.full((bh, bw), number, np.int32), pixels, labels[y : y + bh, x : x + bw]
        )
        cv2.copyTo(np.full((bh, bw), 255, np.uint8), pixels, clean[y : y + bh, x : x + bw])
        box = (float(x), float(y), float(bw), float(bh))
        blobs.append(Blob(id=number, box=box, area=area, ellipse=ellipse_of(pixels, x, y)))
    return clean, labels, blobs
