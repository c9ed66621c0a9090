"""Which track of one log is which of the other: by where they are, not by their numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from replay.compare.content import Content
from replay.trackers.association import assign, iou

MATCH_IOU = 0.5


@dataclass(frozen=True)
class TrackMatch:
    """Tracks matched over the frames that both logs have.

    Attributes:
        partner: track of A to track of B.
        places: track of A to its matched rows: (K, 2) int, row in A's boxes, row in B's.
        swaps: (frame, track of A, track of B it lies on) where a track of A leaves its partner for another's place.
    """

    partner: dict[int, int]
    places: dict[int, NDArray[np.intp]]
    swaps: list[tuple[int, int, int]]


def match_tracks(a: Content, b: Content) -> TrackMatch:
    """Match tracks by the number of frames in which their boxes overlap (IoU >= 0.5), all at once.

    Within a frame boxes are paired by the assignment of greatest overlap; over the recording tracks are paired by the
    assignment of most shared frames. Ties: lower ids first.
    """
    boxes_a, boxes_b = a.boxes, b.boxes
    pairs = _frame_pairs(boxes_a, boxes_b, sorted(set(a.times) & set(b.times)))
    ids_a, ids_b = (np.unique(boxes[:, 1]).astype(int) for boxes in (boxes_a, boxes_b))
    if not len(pairs):
        return TrackMatch({}, {}, [])
    at_a = np.searchsorted(ids_a, boxes_a[pairs[:, 0], 1].astype(int))
    at_b = np.searchsorted(ids_b, boxes_b[pairs[:, 1], 1].astype(int))
    shared = np.zeros((len(ids_a), len(ids_b)))
    np.add.at(shared, (at_a, at_b), 1.0)
    # Shares, not counts, reach the solver: it takes costs up to 1000.
    best = assign(-shared / shared.max() * 900.0, shared > 0)
    partner = {int(ids_a[i]): int(ids_b[j]) for i, j in best}
    places, swaps = {}, []
    for i, track in enumerate(ids_a):
        rows = pairs[at_a == i]
        other = boxes_b[rows[:, 1], 1].astype(int)
        on_partner = other == partner.get(int(track), -1)
        places[int(track)] = rows[on_partner]
        previous = True
        for k, right in enumerate(on_partner):
            if previous and not right:
                swaps.append((int(boxes_a[rows[k, 0], 0]), int(track), int(other[k])))
            previous = bool(right)
    return TrackMatch(partner, places, sorted(swaps))


def _frame_pairs(a: NDArray[np.float64], b: NDArray[np.float64], frames: list[int]) -> NDArray[np.intp]:
    found: list[tuple[int, int]] = []
    starts_a, ends_a = _bounds(a, frames)
    starts_b, ends_b = _bounds(b, frames)
    for k in range(len(frames)):
        sa, ea, sb, eb = starts_a[k], ends_a[k], starts_b[k], ends_b[k]
        overlap = iou(a[sa:ea, 2:], b[sb:eb, 2:])
        found += [(int(sa) + i, int(sb) + j) for i, j in assign(1.0 - overlap, overlap >= MATCH_IOU)]
    return np.array(found, np.intp).reshape(-1, 2)


def _bounds(boxes: NDArray[np.float64], frames: list[int]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    return np.searchsorted(boxes[:, 0], frames), np.searchsorted(boxes[:, 0], frames, side="right")
