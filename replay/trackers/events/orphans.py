"""Targets without a detection or blob of their own: case 3 of matching (EVENTS 2), and merged
detections where there are no masks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from recorders.messages import NO_BLOB, Box
from replay.trackers import appearance
from replay.trackers.association import intersection
from replay.trackers.events.associate import SeenDetections
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracks import EventsTracks
from replay.trackers.life import NANOS, TENTATIVE
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]
UNLIKE = 0.45
"""Hellinger distance of a target's colours from those around it, from which on they tell where it
is: its own looks differ by less. A stain of the ground, once taken for a target, has the ground's.
"""

GROUP_SIZE = 1.6
"""From so many areas of one target on, a detection may be of two."""


def orphans(tracks: EventsTracks) -> list[int]:
    """Rows of the targets that should be in the picture and have no observation yet."""
    return [
        index
        for index, item in enumerate(tracks.items)
        if item.id != TENTATIVE and not item.lost and not item.observed
    ]


def share_detections(
    tracks: EventsTracks,
    seen: SeenDetections,
    used: NDArray[np.bool_],
    parameters: EventsParameters,
) -> None:
    """Recognise merged detections: one that another target took and that covers where this one is
    expected.

    Both lie in one blob then; its number is the detection's place in the recording, from 1.
    """
    without = orphans(tracks)
    taken = np.flatnonzero(used)
    if not without or not len(taken):
        return
    boxes = tracks.boxes[without]
    share = (
        intersection(boxes, seen.boxes[taken])
        / np.maximum(boxes[:, 2] * boxes[:, 3], 1.0)[:, None]
    )
    owners = {
        item.column: item for item in tracks.items if item.observed and item.column >= 0
    }
    for index, row in enumerate(without):
        best = int(np.argmax(share[index]))
        owner = owners.get(int(taken[best]))
        if (
            share[index, best] >= parameters.min_shared
            and owner is not None
            and owner.id != TENTATIVE
        ):
            # Hidden; kept for as long as that is seen only where it is too large for one body: a
            # detector's box of a usual size is one body, and no proof of a group.
            box, own = seen.boxes[taken[best]], boxes[index]
            tracks.items[row].hidden = True
            tracks.items[row].grouped = bool(
                box[2] * box[3] >= GROUP_SIZE * own[2] * own[3]
            )
            if owner.blob == NO_BLOB:
                owner.blob = int(taken[best]) + 1
            tracks.items[row].blob = owner.blob


def follow_colours(
    tracks: EventsTracks, image: Image, time_ns: int, parameters: EventsParameters
) -> list[tuple[int, Box, float]]:
    """Mean shift of every orphan's colours against its surroundings' from where it is expected.

    Returns:
        (row, box, likeness) of those that are found, at least `min_likeness`.
    """
    found: list[tuple[int, Box, float]] = []
    others = tracks.boxes
    height, width = image.shape[:2]
    for row in orphans(tracks):
        colours = tracks.items[row].colours
        if colours is None or colours.updates < 2:
            continue
        if (time_ns - tracks.items[row].found_ns) / NANOS > parameters.top_down_s:
            continue
        x, y, w, h = tracks.box(row)
        size = math.sqrt(w * h)
        left, top = max(0, round(x - size / 2)), max(0, round(y - size / 2))
        right, bottom = (
            min(width, round(x + w + size / 2)),
            min(height, round(y + h + size / 2)),
        )
        if right - left < 4 or bottom - top < 8:
            continue
        bins = appearance.bins_of(image[top:bottom, left:right])
        around = np.ones(bins.shape[1:])
        around[
            max(0, round(y) - top) : max(0, round(y + h) - top),
            max(0, round(x) - left) : round(x + w) - left,
        ] = 0
        mine, background = colours.body, appearance.histograms(bins, around).sum(axis=1)
        background /= max(1.0, float(background[0].sum()))
        if appearance.distance(mine[:, None], background[:, None]) < UNLIKE:
            continue
        likeness = appearance.back_project(
            bins, mine, background, appearance.choose(mine, background)
        )
        for index, item in enumerate(tracks.items):
            if index != row and item.observed:
                a, b, c, d = others[index]
                likeness[
                    max(0, round(b) - top) : max(0, round(b + d) - top),
                    max(0, round(a) - left) : max(0, round(a + c) - left),
                ] = 0.0
        (u, v, _, _), score = appearance.mean_shift(likeness, (x - left, y - top, w, h))
        near = math.hypot(u + left - x, v + top - y) <= 0.5 * size
        if score >= parameters.min_likeness and near:
            found.append((row, (u + left, v + top, w, h), min(1.0, score)))
    return found
