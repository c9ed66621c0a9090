"""Feedback (EVENTS, Figure 1): predictions are proposals that explain the foreground, also where
blobs are merged.

A target alone in its blob is measured by the blob's own box. Targets that share a blob, or whose
blob is cut, too large or in pieces, are placed one by one: a box of the target's own size is
moved over the foreground around its prediction to where it is full of foreground that no other
target explains, empty around, like the target's own colours and not far from where the target was
expected. Ties go to the place nearest to the prediction's top left.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from recorders.masks import Labels
from recorders.messages import NO_BLOB, Blob
from recorders.vision import cv2
from replay.trackers.association import clusters
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

OWN, SHARED = 4, 1
"""Weights of a foreground pixel that nobody else, or somebody else too, explains."""
LIKE, SURE = 0.25, 0.75
"""Likenesses from which on a disputed pixel begins to be, and is, a target's own: where all have
the same colours, as fish and flies do, small differences say nothing."""
CORE = 0.6
"""Share of a target's width, around its middle, in which foreground is explained by it: arms and
legs do not fill the rest, where a neighbour may be."""
GRID = 9


class Integral:
    """Sums over boxes of an image, from its integral image.

    Args:
        image: (H, W) uint8 or float32.
        left, top: place of its top left pixel in the picture.
    """

    def __init__(
        self, image: NDArray[np.uint8] | NDArray[np.float32], left: int = 0, top: int = 0
    ) -> None:
        self.height, self.width = image.shape
        self.left, self.top = left, top
        self._limits = np.array(
            [[self.width], [self.height], [self.width], [self.height]], np.float64
        )
        self._flat = np.asarray(
            cv2.integral(
                image, sdepth=cv2.CV_32S if image.dtype == np.uint8 else cv2.CV_64F
            )
        ).ravel()

    def sums(self, boxes: Floats) -> Floats:
        """Sums over boxes (N, 4) in the picture, (N,); what lies outside of the image counts
        nothing.
        """
        return self.sums_at(self.corners(boxes))

    def corners(self, boxes: Floats) -> NDArray[np.intp]:
        """Where the boxes' (N, 4) corners stand in the integral image, (4, N), for `sums_at`."""
        c = np.empty((4, len(boxes)))
        np.subtract(boxes[:, 0], self.left, out=c[0])
        np.subtract(boxes[:, 1], self.top, out=c[1])
        np.add(c[0], boxes[:, 2], out=c[2])
        np.add(c[1], boxes[:, 3], out=c[3])
        np.rint(c, out=c)
        np.maximum(c, 0.0, out=c)
        np.minimum(c, self._limits, out=c)
        at = c.astype(np.intp)
        out = np.empty_like(at)
        np.multiply(at[3], self.width + 1, out=out[0])
        np.multiply(at[1], self.width + 1, out=out[1])
        np.add(out[0], at[0], out=out[2])
        np.add(out[1], at[0], out=out[3])
        out[:2] += at[2]
        return out

    def sums_at(self, corners: NDArray[np.intp]) -> Floats:
        """Sums over boxes of which `corners` of an image of the same size at the same place is
        known.
        """
        f = self._flat.take(corners)
        return np.asarray(f[0] - f[1] - f[2] + f[3], np.float64)


@dataclass(frozen=True, slots=True)
class Place:
    """Where a target was found in this frame.

    Attributes:
        box: x, y, w, h in pixels.
        alone: measured by its blob's own box.
        own: share of the box that is foreground which no other target explains.
        shared: share of the box that is foreground which another target explains too.
        blob: the blob that it mostly lies in, `NO_BLOB` for none.
        score: the search's score, 1 where no search was needed.
        company: other targets lie in the same blobs.
        tenant: it is the only one in its blob, and the blob holds one detection at most, but of
            another size.
    """

    box: tuple[float, float, float, float]
    alone: bool
    own: float
    shared: float
    blob: int
    score: float = 1.0
    company: bool = False
    tenant: bool = False


class FrameForeground:
    """One frame's foreground, with each pixel's blob in ``labels`` (H, W), and what explains it."""

    def __init__(
        self,
        mask: Image,
        labels: Labels,
        components: Sequence[Blob],
        p: EventsParameters,
        inside: NDArray[np.bool_] | None = None,
    ) -> None:
        """``inside``: (N,) which of the blobs are detections by their place (EVENTS 3.2); the
        others are left out, None: all are.
        """
        self._p = p
        if inside is not None and not inside.all():
            kept = np.concatenate([[True], inside])
            mask = mask * kept[labels]
        else:
            inside = np.ones(len(components), bool)
        self.mask = mask
        self.components = components
        self.boxes = np.array(
            [component.box for component in components], np.float64
        ).reshape(-1, 4)
        self.areas = np.array([component.area for component in components], np.float64)
        self.boxes[~inside, 2:] = 0.0
        self.unit = mask & np.uint8(1)
        self.integral = Integral(self.unit)
        self.labels = labels

    def links(self, boxes: Floats) -> Floats:
        """Foreground pixels of each blob's box within each of the boxes (N, 4), (N, M)."""
        n, m = len(boxes), len(self.boxes)
        if not n or not m:
            return np.zeros((n, m))
        a, b = boxes[:, None, :], self.boxes[None, :, :]
        corner = np.maximum(a[..., :2], b[..., :2])
        size = np.minimum(a[..., :2] + a[..., 2:], b[..., :2] + b[..., 2:]) - corner
        cut = np.concatenate([corner, np.maximum(size, 0.0)], axis=2).reshape(-1, 4)
        meet = np.flatnonzero((cut[:, 2] > 0) & (cut[:, 3] > 0))
        out = np.zeros(n * m)
        out[meet] = self.integral.sums(cut[meet])
        return out.reshape(n, m)

    def cut(self, blobs: Sequence[int], around: Floats) -> MaskCut:
        """The pixels of the given blobs around boxes (N, 4)."""
        height, width = self.mask.shape
        left, top = max(0, int(around[:, 0].min())), max(0, int(around[:, 1].min()))
        right = min(width, int((around[:, 0] + around[:, 2]).max()) + 1)
        bottom = min(height, int((around[:, 1] + around[:, 3]).max()) + 1)
        part = self.labels[top : max(bottom, top + 1), left : max(right, left + 1)]
        table = np.zeros(max(len(self.components), *blobs) + 1, np.uint8)
        table[list(blobs)] = 1
        return MaskCut(table[part], left, top)


@dataclass(frozen=True, slots=True)
class ExpectedPlaces:
    """N targets as they are expected in this frame.

    Attributes:
        boxes: (N, 4) predicted boxes.
        reach: (N,) standard deviations of the predicted places, pixels.
        doubt: (N, 2) standard deviations of the predicted widths and heights, pixels.
        axes: (N, 2) their ellipses' major and minor axes, pixels.
        upright: they stand upright, so a body's width and height tell; if not, its axes do,
            however it turns.
        patient: (N,) bool: these have not fitted their blob for so long that it is believed.
    """

    boxes: Floats
    reach: Floats
    doubt: Floats
    patient: NDArray[np.bool_]
    axes: Floats
    upright: bool


@dataclass(frozen=True, slots=True)
class MaskCut:
    """A cut out of the foreground: pixels (H, W) uint8 0 or 1, and its top left corner in the
    picture.
    """

    pixels: Image
    left: int
    top: int


Likeness = NDArray[np.float32] | None
"""How much each pixel of a cut looks like a target rather than like what is around it, (H, W) in
[-1, 1].
"""
Look = Callable[[list[int], MaskCut], list[Likeness]]
"""(rows of the targets, cut) -> their likenesses."""


def search(
    cut: MaskCut,
    boxes: Floats,
    reach: Floats,
    extra: Sequence[Floats],
    likeness: Sequence[Likeness],
    parameters: EventsParameters,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Place N targets in the foreground by moving boxes of their size, each against the places of
    all others.

    Args:
        cut: the foreground that they share.
        boxes: (N, 4) predictions.
        reach: (N,) standard deviation of the predicted places, pixels.
        extra: for each target further centres (K, 2) to be tried.
        likeness: for each target the pixels' scores.
        parameters: the parameters.

    Returns:
        Boxes (N, 4), own and shared shares of foreground (N,), scores (N,).
    """
    pixels, left, top = cut.pixels, cut.left, cut.top
    now = boxes.copy()
    scores, weighted = np.zeros(len(boxes)), np.zeros(len(boxes))
    order = np.argsort(-(boxes[:, 1] + boxes[:, 3]), kind="stable")
    whole = pixels * np.uint8(OWN)
    everything = Integral(whole, left, top)
    colours = [None if a is None else Integral(a * pixels, left, top) for a in likeness]
    disputed = [_disputed(pixels, a) for a in likeness]
    claims = [_claim(box, left, top) for box in boxes.tolist()]
    for sweep in range(parameters.sweeps):
        for t in order.tolist():
            rest = whole.copy()
            for index, (x1, y1, x2, y2) in enumerate(claims):
                if index != t:
                    rest[y1:y2, x1:x2] = disputed[t][y1:y2, x1:x2]
            free = Integral(rest, left, top)
            tried = _candidates(
                boxes[t], now[t] if sweep else boxes[t], float(reach[t]), extra[t], sweep
            )
            score, inside = _score(
                tried, free, colours[t], boxes[t], float(reach[t]), parameters
            )
            best = int(np.argmax(score))
            now[t], scores[t], weighted[t] = tried[best], score[best], inside[best]
            claims[t] = _claim(now[t].tolist(), left, top)
    # weighted = OWN own + SHARED shared, total = OWN (own + shared)
    area = np.maximum(1.0, now[:, 2] * now[:, 3])
    total = everything.sums(now)
    shared = (total - weighted) / (OWN - SHARED) / area
    return now, total / OWN / area - shared, shared, scores


def _disputed(pixels: Image, likeness: Likeness) -> Image:
    """What pixels (H, W) that somebody else explains are worth to a target: as its own where they
    look like it.
    """
    if likeness is None:
        return pixels * np.uint8(SHARED)
    scale = np.float32((OWN - SHARED) / (SURE - LIKE))
    worth = np.rint(
        np.clip((likeness - np.float32(LIKE)) * scale, 0.0, OWN - SHARED)
    ).astype(np.uint8)
    return np.asarray(pixels * (np.uint8(SHARED) + worth))


def _claim(box: Sequence[float], left: int, top: int) -> tuple[int, int, int, int]:
    """x1, y1, x2, y2 of the pixels that a target's box explains, in a cut with that top left
    corner.
    """
    x, y, w, h = box
    x1, x2 = round(x + (0.5 - CORE / 2) * w) - left, round(x + (0.5 + CORE / 2) * w) - left
    return max(0, x1), max(0, round(y) - top), max(0, x2), max(0, round(y + h) - top)


def _grid(side: int) -> tuple[Floats, Ints, Ints]:
    """The steps' numbers along one axis, and for each place of the grid its column and its row."""
    columns, rows = np.meshgrid(np.arange(side), np.arange(side))
    return np.arange(side, dtype=np.float64), columns.ravel(), rows.ravel()


_COARSE, _FINE = _grid(GRID), _grid(5)


def _candidates(
    expected: Floats, now: Floats, reach: float, extra: Floats, sweep: int
) -> Floats:
    """Places to try: a grid around the expected place first, later a finer one around the best so
    far.
    """
    size = float(np.sqrt(expected[2] * expected[3]))
    span = min(max(2.0 * reach, 0.2 * size), 0.6 * size) if not sweep else 0.12 * size
    numbers, columns, rows = _FINE if sweep else _COARSE
    steps = numbers * (2 * span / (len(numbers) - 1)) - span
    steps[-1] = span
    more = len(extra) if not sweep else 0
    out = np.empty((len(columns) + more, 4))
    np.add(now[0], steps[columns], out=out[: len(columns), 0])
    np.add(now[1], steps[rows], out=out[: len(columns), 1])
    if more:
        out[len(columns) :, 0] = extra[:, 0] - expected[2] / 2
        out[len(columns) :, 1] = extra[:, 1] - expected[3] / 2
    out[:, 2:] = expected[2:]
    return out


def _score(
    tried: Floats,
    free: Integral,
    colour: Integral | None,
    expected: Floats,
    reach: float,
    parameters: EventsParameters,
) -> tuple[Floats, Floats]:
    """Scores (K,) of the places tried, and what they hold of the foreground, weighted, (K,)."""
    area = max(1.0, float(expected[2] * expected[3]))
    ring = 0.3 * expected[2]
    count = len(tried)
    both = np.empty((2 * count, 4))
    both[:count] = tried
    np.add(tried, np.array([-ring, -ring / 2, 2 * ring, ring]), out=both[count:])
    corners = free.corners(both)
    held = free.sums_at(corners)
    inside = held[:count]
    outside = held[count:] - inside
    score = (inside - parameters.ring_weight * outside) / (OWN * area)
    if colour is not None:
        score = score + parameters.colour_weight * colour.sums_at(corners[:, :count]) / area
    offset2 = (tried[:, 0] - expected[0]) ** 2 + (tried[:, 1] - expected[1]) ** 2
    scale2 = max(reach * reach, (0.05 * float(np.sqrt(area))) ** 2)
    return np.asarray(score - parameters.prior_weight * offset2 / scale2), inside


def place(
    fg: FrameForeground,
    expected: ExpectedPlaces,
    detections: Floats,
    detection_blobs: Ints,
    look: Look,
    parameters: EventsParameters,
) -> list[Place | None]:
    """Find each of N targets in the foreground.

    Args:
        fg: the frame's foreground.
        expected: the targets.
        detections: (K, 4) recorded boxes, further proposals.
        detection_blobs: (K,) the blobs they came from.
        look: asked for the targets' likenesses where blobs are shared.
        parameters: the parameters.

    Returns:
        For each target its place, None where there is no foreground at all.
    """
    boxes = expected.boxes
    n, m = len(boxes), len(fg.boxes)
    if not n or not m:
        return [None] * n
    pixels = fg.links(boxes)
    linked = linked_to(fg, boxes, pixels)
    tenants = linked.sum(axis=0)
    held = np.bincount(np.clip(detection_blobs, 0, m), minlength=m + 1)[1:]
    fits = _fits(expected, fg, parameters) | expected.patient[:, None]
    out: list[Place | None] = [None] * n
    searched: list[int] = []
    tenants_only = [False] * n
    mains = np.argmax(np.where(linked, pixels, -1.0), axis=1).tolist()
    for i in np.flatnonzero(linked.any(axis=1)).tolist():
        main = mains[i]
        if tenants[main] == 1 and held[main] <= 1 and fits[i, main]:
            box = fg.boxes[main]
            fill = float(fg.areas[main] / max(1.0, box[2] * box[3]))
            out[i] = Place(
                (float(box[0]), float(box[1]), float(box[2]), float(box[3])),
                True,
                fill,
                0.0,
                main + 1,
            )
        else:
            searched.append(i)
            tenants_only[i] = bool(tenants[main] == 1 and held[main] <= 1)
    for rows in clusters(searched, linked):
        blobs = (np.flatnonzero(linked[rows].any(axis=0)) + 1).tolist()
        near = detections[(detection_blobs[:, None] == np.array(blobs)).any(axis=1)]
        for i, at in zip(
            rows,
            _place_cluster(fg, blobs, rows, expected, near, look, parameters),
            strict=True,
        ):
            company = bool((tenants[linked[i]] > 1).any())
            out[i] = replace(at, company=company, tenant=tenants_only[i])
    return out


def linked_to(fg: FrameForeground, boxes: Floats, pixels: Floats) -> NDArray[np.bool_]:
    """Which of M blobs each of N boxes (N, 4) has a part in, (N, M).

    Args:
        fg: the frame's foreground.
        boxes: of targets.
        pixels: (N, M) what `FrameForeground.links` gives for them.
    """
    area = np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)
    linked = (pixels >= 0.08 * area[:, None]) | (pixels >= 0.5 * fg.areas[None, :])
    return np.asarray(linked & (pixels > 0))


def _fits(
    expected: ExpectedPlaces, fg: FrameForeground, parameters: EventsParameters
) -> NDArray[np.bool_]:
    """Whether each of M blobs may be each of N targets alone, by its size, (N, M).

    What the picture's border cuts may be smaller.
    """
    boxes, doubt, blobs = expected.boxes, expected.doubt, fg.boxes
    height, width = fg.mask.shape
    ratio = blobs[None, :, 2:] / np.maximum(boxes[:, None, 2:], 1.0)
    allowed = (
        1.0
        + parameters.size_tolerance
        + 2.0 * (doubt / np.maximum(boxes[:, 2:], 1.0))[:, None, :]
    )
    # Legs and arms change the width twice as much as the height.
    allowed = np.stack([allowed[..., 0] ** 2, allowed[..., 1]], axis=2)
    low = ratio >= 1 / allowed
    low[..., 0] |= ((blobs[:, 0] <= 0) | (blobs[:, 0] + blobs[:, 2] >= width))[None, :]
    low[..., 1] |= ((blobs[:, 1] <= 0) | (blobs[:, 1] + blobs[:, 3] >= height))[None, :]
    fits = (low & (ratio <= allowed)).all(axis=2)
    if expected.upright:
        return np.asarray(fits)
    ellipses = np.array(
        [(component.ellipse.h, component.ellipse.w) for component in fg.components]
    ).reshape(-1, 2)
    turned = ellipses[None] / np.maximum(expected.axes[:, None], 1.0)
    allowed = allowed[..., ::-1]
    return np.asarray(fits | ((turned <= allowed) & (turned >= 1 / allowed)).all(axis=2))


def _place_cluster(
    fg: FrameForeground,
    blobs: list[int],
    rows: list[int],
    expected: ExpectedPlaces,
    detections: Floats,
    look: Look,
    parameters: EventsParameters,
) -> list[Place]:
    """Place the targets of some rows that share some blobs."""
    mine = expected.boxes[rows]
    size = np.sqrt(mine[:, 2] * mine[:, 3])
    margin = size[:, None] * np.array([-1.0, -1.0, 2.0, 2.0])
    cut = fg.cut(blobs, mine + margin)
    centres = detections[:, :2] + detections[:, 2:] / 2
    extra = []
    for b, s in zip(mine, size, strict=True):
        away = np.abs(centres - (b[:2] + b[2:] / 2)) if len(centres) else np.zeros((0, 2))
        extra.append(centres[(away <= 0.6 * s).all(axis=1)])
    found, own, shared, scores = search(
        cut, mine, expected.reach[rows], extra, look(rows, cut), parameters
    )
    links = fg.links(found)[:, [b - 1 for b in blobs]]
    out: list[Place] = []
    for k in range(len(rows)):
        x, y, w, h = found[k].tolist()
        blob = blobs[int(np.argmax(links[k]))] if links[k].max() > 0 else NO_BLOB
        out.append(
            Place(
                (x, y, w, h), False, float(own[k]), float(shared[k]), blob, float(scores[k])
            )
        )
    return out


class Rest:
    """The foreground that nothing explains, as explanations are taken away from it."""

    def __init__(self, fg: FrameForeground) -> None:
        self._fg = fg
        self._pixels = fg.unit.copy()

    def take(self, boxes: Iterable[tuple[float, float, float, float]]) -> None:
        """Explain what lies in the boxes and right beside them."""
        for x, y, w, h in boxes:
            x1, y1 = max(0, round(x - 0.1 * w)), max(0, round(y - 0.05 * h))
            x2, y2 = max(0, round(x + 1.1 * w)), max(0, round(y + 1.05 * h))
            self._pixels[y1:y2, x1:x2] = 0

    def share(self, boxes: Floats) -> Floats:
        """Share of each box's (N, 4) foreground that is not explained, (N,)."""
        left = np.array([_count(self._pixels, *box) for box in boxes.tolist()], np.float64)
        return np.asarray(left / np.maximum(self._fg.integral.sums(boxes), 1.0))


def _count(pixels: Image, x: float, y: float, w: float, h: float) -> int:
    """Pixels of a box that are not 0: a few boxes are read sooner than a whole picture is summed
    up.
    """
    part = pixels[
        max(0, round(y)) : max(0, round(y + h)), max(0, round(x)) : max(0, round(x + w))
    ]
    return cv2.countNonZero(part) if part.size else 0
