"""Who is born of a split (EVENTS 3.1): the region of pixels that a target lay in has come apart,
and holds two now.

A part that has come off is seen only once it is apart, when no target's box covers it any more,
so the regions of the time just before are what it is compared with.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob
from replay.trackers.association import intersection
from replay.trackers.events.tracks import EventsTracks
from replay.trackers.life import TENTATIVE

Floats = NDArray[np.float64]

SPLIT_NS = 500_000_000
"""So long a region is remembered."""
EVERY_NS = 60_000_000
"""At most so often one is taken note of, whatever the frame rate."""
COVERED = 0.5
"""Share of both boxes, the target's and the newcomer's, that a region must have covered to have
held both.
"""


def remember_regions(tracks: EventsTracks, blobs: Sequence[Blob], time_ns: int) -> None:
    """Take note of the region that each observed target lies in: its blob, or without masks what
    was measured.
    """
    for row, track in enumerate(tracks.items):
        track.regions = [
            region for region in track.regions if time_ns - region[0] <= SPLIT_NS
        ]
        if track.id == TENTATIVE or track.lost or not (track.observed or track.hidden):
            continue
        if track.regions and time_ns - track.regions[-1][0] < EVERY_NS:
            continue
        box = track.measured or tracks.box(row)
        if 0 < track.blob <= len(blobs):
            box = blobs[track.blob - 1].box
        track.regions.append([float(time_ns), *box])


def came_from(tracks: EventsTracks, boxes: Floats) -> NDArray[np.bool_]:
    """Whether each of some new boxes (N, 4) lay in one region with a confirmed target just
    before, (N,).
    """
    out = np.zeros(len(boxes), bool)
    area = np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)
    for row, track in enumerate(tracks.items):
        if track.id == TENTATIVE or track.lost or not track.regions:
            continue
        regions = np.array([region[1:] for region in track.regions])
        mine = np.array([tracks.box(row)])
        both = intersection(mine, regions)[0] >= COVERED * mine[0, 2] * mine[0, 3]
        out |= (intersection(boxes, regions[both]) >= COVERED * area[:, None]).any(axis=1)
    return out
