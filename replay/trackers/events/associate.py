"""Low-level association: gates, costs, and the order in which tracks may choose (EVENTS 2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Ellipse
from replay.trackers.appearance import distance
from replay.trackers.association import assign, boxes_of, clusters, sizes_of, widened_iou
from replay.trackers.belief import LIKELY
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.places import FrameForeground, linked_to
from replay.trackers.events.tracks import EventsTracks

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
WIDENED = 2.0
"""Boxes are widened by so many times the scene's unrest."""
KNOWN = 5
"""Sightings from which on a target's motion is known."""
STEP = 2.0
"""The longest step that who is not known yet makes from one picture to the next, in sizes."""
ALIKE = 0.7
"""Shapes are alike whose axes' ratios, as logarithms, add up to no more: one is twice the other's."""
ALONE = 2.0
"""And by so much farther off has everything else to be that may be the same."""
MOVING = 3
"""Sightings from which on a path says where it goes on, if not yet how fast."""
UNRESTFUL = 4.0
"""How far off it may then be, in standard deviations of the scene's unrest."""


@dataclass(frozen=True)
class SeenDetections:
    """Detections of one frame that may be associated.

    Attributes:
        boxes: (N, 4) x, y, w, h in pixels.
        scores: (N,) in [0, 1].
        blobs: (N,) the blobs they came from.
        ellipses: for each its ellipse, or None.
        look: asked for a detection's colour histograms as `appearance.histograms` gives them;
            None: there are none.
        fused: a detector and the masks agreed on them: few bodies are missing, so one that is
            near where somebody may be by now is likely that one.
    """

    boxes: Floats
    scores: Floats
    blobs: NDArray[np.int64]
    ellipses: Sequence[Ellipse | None]
    look: Callable[[int], Floats | None] | None
    fused: bool = False


def match(
    tracks: EventsTracks,
    rows: Rows,
    seen: SeenDetections,
    columns: Rows,
    parameters: EventsParameters,
) -> list[tuple[int, int]]:
    """Associate some tracks with some detections, (row, column) pairs by row.

    A pair is possible within the gate on the centre's Mahalanobis distance and with some overlap;
    it costs the distance, the overlap that is missing, and the difference of colours where both
    are known. For the overlap, boxes are wider by the scene's unrest and, where they are
    fused, by how far the target may be off by now.
    """
    if not len(rows) or not len(columns):
        return []
    boxes, state = seen.boxes[columns], tracks.bank.value[rows]
    variance = tracks.place_variance(sizes_of(boxes))
    residual = boxes[:, :2] + boxes[:, 2:] / 2 - state[:, None, :2]
    spread = tracks.bank.p00[rows, None, :2] + variance[:, None]
    distance2 = np.add.reduce(residual * residual / spread, axis=2)
    sizes = sizes_of(state)[:, None]
    wider = WIDENED * sizes * tracks.unrest.off
    if seen.fused:
        doubt = tracks.doubt(rows)
        wider = np.sqrt(wider * wider + doubt * doubt)
    overlap = widened_iou(boxes_of(state), boxes, wider)
    gate2 = parameters.gate * parameters.gate
    allowed = (distance2 <= gate2) & (overlap >= parameters.min_overlap)
    cost = (
        (1.0 - overlap)
        + distance2 / gate2
        + _colour_costs(tracks, rows, seen, columns, allowed)
    )
    row, column = rows.tolist(), columns.tolist()
    scores = seen.scores[columns].tolist()
    pairs = assign(cost, allowed)
    known = [
        (i, j)
        for i, j in pairs
        if tracks.items[row[i]].hits >= KNOWN and scores[j] >= LIKELY
    ]
    if known:
        i, j = (list(side) for side in zip(*known, strict=True))
        tracks.unrest.take(residual[i, j] / sizes[i])
    return [(row[i], column[j]) for i, j in pairs]


def first_steps(
    tracks: EventsTracks, rows: Rows, seen: SeenDetections, columns: Rows
) -> list[tuple[int, int]]:
    """Associate tracks whose motion is not known yet with detections that nobody else is, (row,
    column) pairs by row.

    Who is small, fast or filmed rarely moves by more than his own width from one picture to the
    next: overlap says nothing, and how fast he is, is only known once he has been associated.
    What counts is the distance in his own sizes, up to `STEP`, that the shapes are alike, and
    that there is no other choice: nothing of his shape, and nobody of the detection's, within
    `ALONE` times the distance. Of those left, who has been followed is the nearest one that the
    scene's unrest allows.
    """
    if not len(rows) or not len(columns):
        return []
    boxes, sizes = seen.boxes[columns], tracks.sizes[rows]
    off = boxes[:, :2] + boxes[:, 2:] / 2 - tracks.bank.value[rows, None, :2]
    off /= sizes[:, None, None]
    shapes = np.array([_axes(seen.boxes[c].tolist(), seen.ellipses[c]) for c in columns])
    mine = np.maximum(tracks.bank.value[rows, 4:6], 1.0)
    unlike = np.abs(np.log(shapes[None] / mine[:, None])).sum(axis=2)
    away = np.where(unlike > ALIKE, np.inf, np.hypot(off[..., 0], off[..., 1]))
    pairs = []
    for i, j in enumerate(away.argmin(axis=1).tolist()):
        least = float(away[i, j])
        others = np.concatenate([np.delete(away[i], j), np.delete(away[:, j], i)])
        if least <= STEP and float(others.min(initial=np.inf)) > ALONE * least:
            pairs.append((i, j))
    moving = np.array([tracks.items[row].hits >= MOVING for row in rows], bool)
    left = moving[:, None] & (away <= min(STEP, UNRESTFUL * np.hypot(*tracks.unrest.off)))
    for i, j in pairs:
        left[i] = left[:, j] = False
    pairs = sorted(pairs + assign(np.where(left, away, 0.0), left))
    known = [(i, j) for i, j in pairs if moving[i]]
    if known:
        at = np.array(known, np.intp)
        tracks.unrest.take(off[at[:, 0], at[:, 1]])
    return [(int(rows[i]), int(columns[j])) for i, j in pairs]


def _axes(box: Sequence[float], ellipse: Ellipse | None) -> tuple[float, float]:
    """Major and minor axis of a detection, at least a pixel."""
    long, short = (ellipse.h, ellipse.w) if ellipse else (max(box[2:]), min(box[2:]))
    return max(long, 1.0), max(short, 1.0)


def one_each(
    tracks: EventsTracks,
    rows: Sequence[int],
    fg: FrameForeground,
    seen: SeenDetections,
    parameters: EventsParameters,
    *,
    divided: bool,
) -> dict[int, int]:
    """Blobs that several targets share and that hold as many detections: each target has its own,
    column by row.

    Such a blob is not searched for its targets, its detections say where they are; unless one is
    out of reach.

    Args:
        tracks: all targets.
        rows: those that are looked for.
        fg: the frame's foreground.
        seen: the frame's detections.
        parameters: the parameters.
        divided: the segmentation divides what bodies of one size share that turn: boxes of theirs
            say little, and what it divided is taken from it, also by fewer targets, and from one
            blob or from several that the same targets reach into.
    """
    given = np.bincount(np.clip(seen.blobs, 0, len(fg.boxes)), minlength=len(fg.boxes) + 1)
    if not len(rows) or given[1:].sum() < 2:
        return {}
    boxes = tracks.boxes[np.array(rows)]
    pixels = fg.links(boxes)
    home = np.where(pixels.max(axis=1) > 0, pixels.argmax(axis=1) + 1, NO_BLOB)
    sharing = [
        (np.flatnonzero(home == blob).tolist(), [blob])
        for blob in (np.flatnonzero(given[1:] >= 2) + 1).tolist()
    ]
    if divided:
        linked = linked_to(fg, boxes, pixels)
        sharing += [
            (group, (np.flatnonzero(linked[group].any(axis=0)) + 1).tolist())
            for group in clusters(list(range(len(rows))), linked)
            if len(group) > 1
        ]
    found: dict[int, int] = {}
    for group, blobs in sharing:
        here = np.array(rows, np.intp)[group]
        columns = np.flatnonzero(np.isin(seen.blobs, blobs))
        fewer = divided and len(blobs) == 1 and 0 < len(here) < len(columns)
        if not fewer and len(here) != len(columns):
            continue
        if found.keys() & set(here.tolist()):
            continue
        pairs = (
            _nearest(tracks, here, seen, columns)
            if divided
            else match(tracks, here, seen, columns, parameters)
        )
        if len(pairs) == len(here):
            found.update(pairs)
    return found


def _nearest(
    tracks: EventsTracks, rows: Rows, seen: SeenDetections, columns: Rows
) -> list[tuple[int, int]]:
    """Associate some targets with what the segmentation divided, (row, column) pairs by row: with
    what overlaps and lies no farther off than a body is long, however fast that would be. Where
    blobs meet and part it leaps.
    """
    mine, theirs = tracks.boxes[rows], seen.boxes[columns]
    off = (mine[:, None, :2] + mine[:, None, 2:] / 2) - (theirs[:, :2] + theirs[:, 2:] / 2)
    away = np.hypot(off[..., 0], off[..., 1]) / sizes_of(mine)[:, None]
    overlap = widened_iou(mine, theirs, np.zeros((len(mine), 2)))
    pairs = assign(away + 1.0 - overlap, (away <= 1.0) & (overlap > 0.0))
    return [(int(rows[i]), int(columns[j])) for i, j in pairs]


def _colour_costs(
    tracks: EventsTracks,
    rows: Rows,
    seen: SeenDetections,
    columns: Rows,
    allowed: NDArray[np.bool_],
) -> Floats:
    """Hellinger distances where two pairs compete, 0 elsewhere: colours are asked only where
    places do not decide.
    """
    out = np.zeros(allowed.shape)
    if seen.look is None:
        return out
    rivals = (allowed.sum(axis=1, keepdims=True) > 1) | (
        allowed.sum(axis=0, keepdims=True) > 1
    )
    for i, j in np.argwhere(allowed & rivals).tolist():
        mine, theirs = tracks.items[rows[i]].colours, seen.look(int(columns[j]))
        # A target whose colours are not known is as far as strangers usually are, so that it wins
        # nothing by that.
        out[i, j] = 0.4 if mine is None or theirs is None else distance(mine.table, theirs)
    return out
