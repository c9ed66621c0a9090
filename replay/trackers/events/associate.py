"""Low-level association: gates, costs, and the order in which tracks may choose (EVENTS 2)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Ellipse
from replay.trackers.appearance import distance
from replay.trackers.association import assign, boxes_of, sizes_of, widened_iou
from replay.trackers.belief import LIKELY
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.places import FrameForeground
from replay.trackers.events.tracks import EventsTracks

Floats = NDArray[np.float64]
Rows = NDArray[np.intp]
WIDENED = 2.0
"""Boxes are widened by so many times the scene's unrest."""
KNOWN = 5
"""Sightings from which on a target's motion is known."""


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
        + parameters.colour_cost * _colour_costs(tracks, rows, seen, columns, allowed)
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


def one_each(
    tracks: EventsTracks,
    rows: Sequence[int],
    fg: FrameForeground,
    seen: SeenDetections,
    parameters: EventsParameters,
) -> dict[int, int]:
    """Blobs that several targets share and that hold as many detections: each target has its own,
    column by row.

    Such a blob is not searched for its targets, its detections say where they are; unless one is
    out of reach.
    """
    given = np.bincount(np.clip(seen.blobs, 0, len(fg.boxes)), minlength=len(fg.boxes) + 1)
    if not len(rows) or given[1:].max(initial=0) < 2:
        return {}
    pixels = fg.links(tracks.boxes[np.array(rows)])
    home = np.where(pixels.max(axis=1) > 0, pixels.argmax(axis=1) + 1, NO_BLOB)
    found: dict[int, int] = {}
    for blob in np.flatnonzero(given[1:] >= 2) + 1:
        here = np.array(rows, np.intp)[home == blob]
        if len(here) == given[blob]:
            pairs = match(
                tracks, here, seen, np.flatnonzero(seen.blobs == blob), parameters
            )
            if len(pairs) == len(here):
                found.update(pairs)
    return found


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
