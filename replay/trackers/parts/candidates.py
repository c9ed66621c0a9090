"""Candidates: where each target may be in this frame (PARTS 2.1, 3 and 3.1).

What is observed are blobs and recorded detections. One that is of the target's predicted size,
within the occlusion test, is a candidate as it is. In a blob that is larger, the target hangs
from every head in five sizes; in one that is smaller it is aligned with a head or the blob is
dismissed. Observations and heads at one place are one *anchor*: no two targets may take the same.
Deviation: detections that the segmentation recorded within a merged blob are candidates too,
which the paper, without them, has to find by heads alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Detections
from replay.trackers.association import iou_of_pairs
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

    @cached_property
    def named(self) -> tuple[Anchors, Ints]:
        """The observations' anchors, and which one is whose, (K,)."""
        anchors = Anchors()
        names = [anchors.at(x + w / 2, y, h) for x, y, w, h in self.boxes.tolist()]
        return anchors, np.array(names, np.int64)


def observe(d: Detections) -> Observed:
    """Blobs and detections of a frame; a detection that is alone in its blob and covers it is
    left out for the blob.
    """
    # What a detector and the masks make up together says where bodies are; blobs alone do not.
    components = [] if d.fused else d.components
    m = len(components)
    blob_boxes = np.array([component.box for component in components], np.float64).reshape(
        -1, 4
    )
    n = len(d.boxes)
    boxes = np.array(d.boxes, np.float64).reshape(-1, 4)
    blobs = np.array(d.blobs if d.blobs else [NO_BLOB] * n, np.int64)
    if not m:
        # Without pixels every detection is a blob of its own.
        blobs = np.arange(1, n + 1)
    scores = np.array(d.scores if d.scores else [1.0] * n, np.float64)
    held = np.bincount(np.clip(blobs, 0, m), minlength=m + 1)
    own = np.zeros(m)
    alone = (blobs > 0) & (blobs <= m)
    lone = np.flatnonzero(alone)[held[blobs[alone]] == 1]
    lone = lone[iou_of_pairs(boxes[lone], blob_boxes[blobs[lone] - 1]) > 0.5]
    own[blobs[lone] - 1] = scores[lone]
    rest = np.ones(n, bool)
    rest[lone] = False
    kept = np.flatnonzero(rest)
    centroids = np.array(
        [(component.ellipse.x, component.ellipse.y) for component in components], np.float64
    ).reshape(-1, 2)
    ids = np.array([component.id for component in components], np.int64)
    return Observed(
        np.concatenate([blob_boxes, boxes[kept]]),
        np.concatenate([ids, blobs[kept]]),
        np.concatenate([centroids, np.full((len(kept), 2), np.nan)]),
        np.concatenate([own, scores[kept]]),
        (
            np.concatenate([held[ids] > 1, held[np.clip(blobs[kept], 0, m)] > 1])
            if m
            else np.zeros(n, bool)
        ),
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
        fitting: (N,) bool: an observation of the target's size, within the parameter
            ``crowd_change``.
        stage: (N,) which targets are associated together; rising.
    """

    rows: Rows
    boxes: Floats
    anchors: Ints
    blobs: Ints
    direct: NDArray[np.bool_]
    sources: Ints
    whole: NDArray[np.bool_]
    fitting: NDArray[np.bool_]
    stage: Rows
    count: int

    def kept(
        self, keep: NDArray[np.bool_] | Rows | slice, count: int | None = None
    ) -> Candidates:
        """Some of them, in the order of ``keep`` if that is rows, of ``count`` anchors (default:
        as many as before).
        """
        some: dict[str, Any] = {n: getattr(self, n)[keep] for n in _BY_CANDIDATE}
        return Candidates(**some, count=self.count if count is None else count)

    def beside(self, other: Candidates) -> Candidates:
        """These and others, by target; of each these first."""
        both: dict[str, Any] = {
            n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in _BY_CANDIDATE
        }
        together = Candidates(**both, count=self.count)
        return together.kept(np.argsort(together.rows, kind="stable"))


_BY_CANDIDATE = (
    "rows",
    "boxes",
    "anchors",
    "blobs",
    "direct",
    "sources",
    "whole",
    "fitting",
    "stage",
)


CLOSE = 0.12
"""Tops within this of one another, of the body's height, are one anchor: a head's half width."""


def same_anchor(boxes: Floats, taken: Floats, wider: float) -> NDArray[np.bool_]:
    """Whether boxes (N, 4) have the anchor of any box (M, 4) that was taken before, (N,); one that
    is so much ``wider`` may hold several heads.
    """
    top = boxes[:, :2] + boxes[:, 2:] * (0.5, 0.0)
    other = taken[:, :2] + taken[:, 2:] * (0.5, 0.0)
    away = np.abs(top[:, None] - other[None]).max(axis=2)
    one = taken[None, :, 2] <= (1 + wider) * boxes[:, None, 2]
    return np.asarray(((away <= CLOSE * boxes[:, 3:]) & one).any(axis=1))


class Anchors:
    """Places that one target at most may take; places close to one another are one anchor."""

    def __init__(self, tops: Iterable[tuple[float, float]] = ()) -> None:
        self._tops = list(tops)

    def __len__(self) -> int:
        return len(self._tops)

    def copy(self) -> Anchors:
        """The same anchors, to which others can be added."""
        return Anchors(self._tops)

    def at(self, x: float, y: float, height: float) -> int:
        """The anchor at a head's top; ``height`` of the body says how close is close."""
        close = CLOSE * height
        for k, (ax, ay) in enumerate(self._tops):
            if abs(x - ax) <= close and abs(y - ay) <= close:
                return k
        self._tops.append((x, y))
        return len(self._tops) - 1


@dataclass(frozen=True)
class Expected:
    """Where T targets are looked for.

    Attributes:
        boxes: (T, 4) of predicted size at their last places.
        alpha: (T,) where their centroids lie across.
        gates: (T,) half sides of their gates.
    """

    boxes: Floats
    alpha: Floats
    gates: Floats


def gather(
    seen: Observed, stages: Sequence[Rows], at: Expected, heads: Heads, p: PartsParameters
) -> tuple[Candidates, list[int]]:
    """All candidates of some targets.

    Args:
        seen: the frame's observations.
        stages: the targets, T in all; those of a stage are associated together and have their
            anchors in common.
        at: where they are looked for.
        heads: the frame's heads.
        p: the parameters.

    Returns:
        The candidates, and how many anchors each stage has.
    """
    expected, gates = at.boxes, at.gates
    centres, middle = (
        seen.boxes[:, :2] + seen.boxes[:, 2:] / 2,
        expected[:, :2] + expected[:, 2:] / 2,
    )
    within = np.asarray(
        (np.abs(centres[None] - middle[:, None]) <= gates[:, None, None]).all(axis=2)
    )
    change = seen.boxes[None, :, 2:] / np.maximum(expected[:, None, 2:], 1.0)
    larger = np.asarray((change > 1 + p.occlusion).any(axis=2))
    smaller = np.asarray((change < 1 - p.occlusion).any(axis=2))
    # Where the segmentation itself found several people in a blob, half as much again is too much
    # to be one of them.
    m = len(seen.blob_boxes)
    several = np.zeros(len(seen.boxes), bool)
    several[:m] = seen.crowd[:m]
    direct = (
        within
        & ~larger
        & ~smaller
        & ~(several[None, :] & (change > 1 + p.crowd_change).any(axis=2))
    )
    owner, source = np.nonzero(direct)
    crowd = larger[:, :m] | seen.crowd[None, :m]
    sizes = np.where(crowd, len(STEPS), smaller[:, :m] & within[:, :m]) * _meeting(
        expected, seen.blob_boxes, gates
    )
    _several_heads(sizes, direct[:, :m], seen, expected, heads)
    known, names = seen.named
    anchors = [known.copy() for _ in stages]
    stage = np.repeat(np.arange(len(stages)), [len(s) for s in stages])
    fitting = np.asarray((np.abs(change[owner, source] - 1) <= p.crowd_change).all(axis=1))
    measured = Candidates(
        rows=owner,
        boxes=seen.boxes[source],
        anchors=names[source],
        blobs=seen.blobs[source],
        direct=np.ones(len(owner), bool),
        sources=source,
        whole=(source < m) & ~several[source],
        fitting=fitting,
        stage=stage[owner],
        count=0,
    )
    hanging = _from_heads(seen, sizes, stage, at, heads, anchors, p)
    found = measured if hanging is None else measured.beside(hanging)
    return replace(found, rows=np.concatenate(stages)[found.rows]), [
        len(anchor) for anchor in anchors
    ]


def _several_heads(
    sizes: Ints, direct: NDArray[np.bool_], seen: Observed, expected: Floats, heads: Heads
) -> None:
    """A blob of a target's size in which there are two heads and more may be two bodies: the
    target hangs from them, too. Changes ``sizes`` (T, M).
    """
    for t, b in np.argwhere(direct & (sizes == 0)).tolist():
        found = heads.of(b, seen.blob_boxes[b], float(expected[t, 3]))
        if len(found) > 1:
            sizes[t, b] = len(STEPS)


def _from_heads(
    seen: Observed,
    sizes: Ints,
    stage: Rows,
    at: Expected,
    heads: Heads,
    anchors: Sequence[Anchors],
    p: PartsParameters,
) -> Candidates | None:
    """Candidates that hang from the heads in blobs, in so many ``sizes`` (T, M) of each target
    and blob, or none.
    """
    expected = at.boxes
    places: list[tuple[int, int, float, float]] = []
    for t, b in np.argwhere(sizes).tolist():
        places += [
            (t, b, x, y) for x, y in heads.of(b, seen.blob_boxes[b], float(expected[t, 3]))
        ]
    if not places:
        return None
    owners, blobs, x, y = zip(*places, strict=True)
    owner, blob = np.array(owners, np.intp), np.array(blobs, np.intp)
    top, size = np.stack([np.array(x), np.array(y)], axis=1), expected[owner, 2:]
    plain = hung(top, size, at.alpha[owner])
    middle, last = (
        plain[:, :2] + plain[:, 2:] / 2,
        expected[owner, :2] + expected[owner, 2:] / 2,
    )
    near = np.flatnonzero((np.abs(middle - last) <= at.gates[owner][:, None]).all(axis=1))
    if not len(near):
        return None
    who = owner[near]
    found = zip(
        stage[who].tolist(), top[near].tolist(), expected[who, 3].tolist(), strict=True
    )
    names = [anchors[k].at(tx, ty, height) for k, (tx, ty), height in found]
    times = sizes[who, blob[near]]
    each = np.repeat(near, times)
    # The plain size first, alone or followed by the four others.
    step = STEPS[np.concatenate([np.arange(n) for n in times.tolist()])]
    n, no = len(each), np.zeros(len(each), bool)
    boxes = hung(
        top[each], size[each] * (1 + p.size_step * step)[:, None], at.alpha[owner[each]]
    )
    return Candidates(
        rows=owner[each],
        boxes=boxes,
        anchors=np.repeat(np.array(names, np.int64), times),
        blobs=blob[each] + 1,
        direct=no,
        sources=np.full(n, -1),
        whole=no,
        fitting=no,
        stage=stage[owner[each]],
        count=0,
    )


def _meeting(expected: Floats, blobs: Floats, gates: Floats) -> NDArray[np.bool_]:
    """Whether blobs (M, 4) reach into targets' boxes (T, 4), grown by their gates (T,): (T, M)."""
    reach = gates[:, None]
    low, high = expected[:, :2] - reach, expected[:, :2] + expected[:, 2:] + reach
    end = np.minimum(high[:, None], (blobs[:, :2] + blobs[:, 2:])[None])
    return np.asarray((end > np.maximum(low[:, None], blobs[None, :, :2])).all(axis=2))


class Heads:
    """One frame's heads by blob, looked for when asked for, once for each size of body (four
    sizes to an octave).
    """

    def __init__(
        self,
        find: HeadDetector | None,
        image: Callable[[], Image | None],
        mask: Image | None,
    ) -> None:
        self._find, self._image, self._mask = find, image, mask
        self._known: dict[tuple[int, int], list[tuple[float, float]]] = {}

    def of(self, blob: int, box: Floats, height: float) -> list[tuple[float, float]]:
        """Tops of the heads in a blob."""
        size = round(4 * np.log2(max(height, 1.0)))
        if (blob, size) not in self._known:
            found = (
                ()
                if self._find is None
                else self._find(self._image(), self._mask, box, 2.0 ** (size / 4))
            )
            self._known[blob, size] = [(h.x, h.y) for h in found]
        return self._known[blob, size]
