"""Candidates: where each target may be in this frame (PARTS 2.1, 3 and 3.1).

What is observed are blobs and recorded detections. One that is of the target's predicted size, within the occlusion
test, is a candidate as it is. In a blob that is larger, the target hangs from every head in five sizes; in one that is
smaller it is aligned with a head or the blob is dismissed. Observations and heads at one place are one *anchor*: no
two targets may take the same. Deviation: detections that the segmentation recorded within a merged blob are candidates
too, which the paper, without them, has to find by heads alone.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Detections
from replay.trackers.association import iou
from replay.trackers.parts.heads import HeadDetector
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.regions import hung
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Rows = NDArray[np.intp]
STEPS = np.array([0, -1, 1, -2, 2])
"""i of eq. 9 and 10, the plain size first: ties go to it."""


@dataclass(frozen=True)
class Observed:
    """What is to be seen in a frame.

    Attributes:
        boxes: (K, 4) blobs first, then detections that are not just their blob.
        blobs: (K,) the blob of each.
        centroids: (K, 2) centroids of blobs, nan for detections.
        scores: (K,) detections' scores; a blob has that of its only detection, else 0.
        crowd: (K,) bool: the blob holds several detections.
        held: (M + 1,) detections by blob id.
        blob_boxes: (M, 4) all blobs.
    """

    boxes: Floats
    blobs: Ints
    centroids: Floats
    scores: Floats
    crowd: NDArray[np.bool_]
    held: Ints
    blob_boxes: Floats


def observe(d: Detections) -> Observed:
    """Blobs and detections of a frame; a detection that is alone in its blob and covers it is left out for the blob."""
    m = len(d.components)
    blob_boxes = np.array([c.box for c in d.components], np.float64).reshape(-1, 4)
    n = len(d.boxes)
    boxes = np.array(d.boxes, np.float64).reshape(-1, 4)
    blobs = np.array(d.blobs if d.blobs else [NO_BLOB] * n, np.int64)
    scores = np.array(d.scores if d.scores else [1.0] * n, np.float64)
    held = np.bincount(np.clip(blobs, 0, m), minlength=m + 1)
    own = np.zeros(m)
    kept = []
    for k in range(n):
        b = int(blobs[k])
        if 0 < b <= m and held[b] == 1 and iou(boxes[k : k + 1], blob_boxes[b - 1 : b])[0, 0] > 0.5:
            own[b - 1] = scores[k]
        else:
            kept.append(k)
    centroids = np.array([(c.ellipse.x, c.ellipse.y) for c in d.components], np.float64).reshape(-1, 2)
    ids = np.array([c.id for c in d.components], np.int64)
    return Observed(
        np.concatenate([blob_boxes, boxes[kept]]),
        np.concatenate([ids, blobs[kept]]),
        np.concatenate([centroids, np.full((len(kept), 2), np.nan)]),
        np.concatenate([own, scores[kept]]),
        np.concatenate([held[ids] > 1, held[np.clip(blobs[kept], 0, m)] > 1]) if m else np.zeros(n, bool),
        held,
        blob_boxes,
    )


@dataclass(frozen=True)
class Candidates:
    """N pairs of a target and a place, by target, then in the order of the observations.

    Attributes:
        rows: (N,) the targets.
        boxes: (N, 4).
        anchors: (N,) which anchor; ``count`` of them.
        blobs: (N,) the blobs they lie in.
        direct: (N,) bool: measured as they are, the target is not occluded.
        sources: (N,) row of the observation, -1 for those hung from heads.
        whole: (N,) bool: a blob in which nobody else was found.
        fitting: (N,) bool: an observation of the target's size, within the parameter ``crowd_change``.
    """

    rows: Rows
    boxes: Floats
    anchors: Ints
    blobs: Ints
    direct: NDArray[np.bool_]
    sources: Ints
    whole: NDArray[np.bool_]
    fitting: NDArray[np.bool_]
    count: int


class Anchors:
    """Places that one target at most may take; places close to one another are one anchor."""

    def __init__(self) -> None:
        self._tops: list[tuple[float, float]] = []

    def __len__(self) -> int:
        return len(self._tops)

    def at(self, x: float, y: float, height: float) -> int:
        """The anchor at a head's top; ``height`` of the body says how close is close."""
        for k, (ax, ay) in enumerate(self._tops):
            if abs(x - ax) <= 0.12 * height and abs(y - ay) <= 0.12 * height:
                return k
        self._tops.append((x, y))
        return len(self._tops) - 1


def gather(
    seen: Observed,
    rows: Rows,
    expected: Floats,
    alpha: Floats,
    gates: Floats,
    heads: Heads,
    p: PartsParameters,
) -> Candidates:
    """All candidates of some targets.

    Args:
        seen: the frame's observations.
        rows: (T,) the targets.
        expected: (T, 4) boxes of predicted size at their last places.
        alpha: (T,) where their centroids lie across.
        gates: (T,) half sides of their gates.
        heads: the frame's heads.
        p: the parameters.
    """
    centres, at = seen.boxes[:, :2] + seen.boxes[:, 2:] / 2, expected[:, :2] + expected[:, 2:] / 2
    within = np.asarray((np.abs(centres[None] - at[:, None]) <= gates[:, None, None]).all(axis=2))
    change = seen.boxes[None, :, 2:] / np.maximum(expected[:, None, 2:], 1.0)
    larger = np.asarray((change > 1 + p.occlusion).any(axis=2))
    smaller = np.asarray((change < 1 - p.occlusion).any(axis=2))
    # Where the segmentation itself found several people in a blob, half as much again is too much to be one of them.
    several = np.zeros(len(seen.boxes), bool)
    several[: len(seen.blob_boxes)] = seen.crowd[: len(seen.blob_boxes)]
    direct = within & ~larger & ~smaller & ~(several[None, :] & (change > 1 + p.crowd_change).any(axis=2))
    anchors = Anchors()
    names = [anchors.at(b[0] + b[2] / 2, b[1], b[3]) for b in seen.boxes.tolist()]
    found: list[tuple[int, list[float], int, int, bool, int]] = []
    for t in range(len(rows)):
        for k in np.flatnonzero(direct[t]).tolist():
            found.append((t, seen.boxes[k].tolist(), names[k], int(seen.blobs[k]), True, k))
        for b, box in enumerate(seen.blob_boxes):
            if not _meets(expected[t], box, float(gates[t])):
                continue
            crowd = larger[t, b] or seen.crowd[b]
            if not crowd and not (smaller[t, b] and within[t, b]):
                continue
            steps = STEPS if crowd else STEPS[:1]
            for x, y in heads.of(b, box, float(expected[t, 3])):
                sizes = expected[t, 2:][None] * (1 + p.size_step * steps)[:, None]
                boxes = hung(np.array([[x, y]] * len(steps)), sizes, np.full(len(steps), alpha[t]))
                middle = boxes[0, :2] + boxes[0, 2:] / 2
                if (np.abs(middle - at[t]) <= gates[t]).all():
                    name = anchors.at(x, y, float(expected[t, 3]))
                    found += [(t, hang, name, b + 1, False, -1) for hang in boxes.tolist()]
    if not found:
        none, no = np.zeros(0, np.int64), np.zeros(0, bool)
        return Candidates(none.astype(np.intp), np.zeros((0, 4)), none, none, no, none, no, no, 0)
    owners, boxes_, names_, blobs, are_direct, sources = zip(*found, strict=True)
    alone = np.zeros(len(seen.boxes) + 1, bool)
    alone[: len(seen.blob_boxes)] = ~seen.crowd[: len(seen.blob_boxes)]
    owner, source = np.array(owners, np.intp), np.array(sources, np.intp)
    fitting = (source >= 0) & (np.abs(change[owner, source] - 1) <= p.crowd_change).all(axis=1)
    return Candidates(
        rows[np.array(owners, np.intp)],
        np.array(boxes_, np.float64),
        np.array(names_, np.int64),
        np.array(blobs, np.int64),
        np.array(are_direct, bool),
        np.array(sources, np.int64),
        alone[np.array(sources, np.intp)],
        fitting,
        len(anchors),
    )


def _meets(expected: Floats, blob: Floats, gate: float) -> bool:
    """Whether a blob reaches into a target's box, grown by its gate."""
    x, y, w, h = expected.tolist()
    bx, by, bw, bh = blob.tolist()
    across = min(x + w + gate, bx + bw) > max(x - gate, bx)
    return bool(across and min(y + h + gate, by + bh) > max(y - gate, by))


class Heads:
    """One frame's heads by blob, looked for when asked for, once for each size of body (four sizes to an octave)."""

    def __init__(self, find: HeadDetector | None, image: Callable[[], Image | None], mask: Image | None) -> None:
        self._find, self._image, self._mask = find, image, mask
        self._known: dict[tuple[int, int], list[tuple[float, float]]] = {}

    def of(self, blob: int, box: Floats, height: float) -> list[tuple[float, float]]:
        """Tops of the heads in a blob."""
        size = round(4 * np.log2(max(height, 1.0)))
        if (blob, size) not in self._known:
            found = () if self._find is None else self._find(self._image(), self._mask, box, 2.0 ** (size / 4))
            self._known[blob, size] = [(h.x, h.y) for h in found]
        return self._known[blob, size]
