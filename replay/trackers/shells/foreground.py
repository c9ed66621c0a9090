"""One frame's foreground: blobs, their labels where pixels are asked for, and which objects lie
over which blobs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.masks import Labels
from recorders.messages import Blob
from replay.trackers.association import intersection
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class Cut:
    """A part of the picture's foreground, which may reach out of the picture.

    Attributes:
        own: (H, W) bool, the foreground pixels that are meant.
        empty: (H, W) bool, pixels in the picture that are no foreground at all.
        labels: (H, W) uint16, the blobs' labels where ``own``, else 0.
        left, top: place of the top left pixel in the picture.
    """

    own: Bools
    empty: Bools
    labels: Labels
    left: int
    top: int


class Foreground:
    """Blobs by row; blob k's label in ``labels`` (H, W), as of `recorders.masks.label_blobs`, is
    k + 1.
    """

    def __init__(self, mask: Image, labels: Labels, components: Sequence[Blob]) -> None:
        self.mask = mask
        self.components = components
        self.boxes: Floats = np.array(
            [component.box for component in components], np.float64
        ).reshape(-1, 4)
        self.areas: Floats = np.array(
            [component.area for component in components], np.float64
        )
        self.labels = labels

    def links(self, boxes: Floats) -> Floats:
        """Pixels of each blob within each of the boxes (N, 4), (N, M).

        Where a box meets one blob's box alone and that blob no other, no pixel is looked at: the
        blob's pixels are taken to fill its box evenly.
        """
        n, m = len(boxes), len(self.boxes)
        if not n or not m:
            return np.zeros((n, m))
        common = intersection(boxes, self.boxes)
        meets = common > 0
        out = (
            common
            * (self.areas / np.maximum(self.boxes[:, 2] * self.boxes[:, 3], 1.0))[None, :]
        )
        crowded = meets[:, meets.sum(axis=0) > 1].any(axis=1) | (meets.sum(axis=1) > 1)
        height, width = self.mask.shape
        for i in np.flatnonzero(crowded).tolist():
            x, y, w, h = boxes[i].tolist()
            x1, y1 = max(0, round(x)), max(0, round(y))
            x2, y2 = min(width, round(x + w)), min(height, round(y + h))
            inside = self.labels[y1 : max(y1, y2), x1 : max(x1, x2)]
            out[i] = np.bincount(inside.ravel(), minlength=m + 1)[1 : m + 1]
        return out

    def pixels(self, blob: int) -> Bools:
        """A blob's own pixels within its box, (h, w)."""
        x, y, w, h = (int(v) for v in self.components[blob].box)
        return np.asarray(self.labels[y : y + h, x : x + w] == blob + 1)

    def cut(self, blobs: Sequence[int], x1: int, y1: int, x2: int, y2: int) -> Cut:
        """The pixels of some blobs (rows) in a rectangle, which may reach out of the picture."""
        height, width = self.mask.shape
        shape = (y2 - y1, x2 - x1)
        labels = np.zeros(shape, np.uint16)
        empty = np.zeros(shape, bool)
        a, b, c, d = max(0, x1), max(0, y1), min(width, x2), min(height, y2)
        if c > a and d > b:
            part = self.labels[b:d, a:c]
            table = np.zeros(len(self.components) + 1, np.uint16)
            chosen = np.array(blobs, np.intp) + 1
            table[chosen] = chosen
            where = (slice(b - y1, d - y1), slice(a - x1, c - x1))
            labels[where] = table[part]
            empty[where] = part == 0
        return Cut(labels > 0, empty, labels, x1, y1)


def touches(boxes: Floats, width: int, height: int) -> NDArray[np.bool_]:
    """Which of the boxes (N, 4) reach the picture's border, (N,)."""
    right, bottom = boxes[:, 0] + boxes[:, 2], boxes[:, 1] + boxes[:, 3]
    return np.asarray(
        (boxes[:, 0] <= 1)
        | (boxes[:, 1] <= 1)
        | (right >= width - 1)
        | (bottom >= height - 1)
    )
