"""Appearance of the targets (EVENTS 2): learnt while a target is alone, asked where blobs are
shared.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from replay.trackers import appearance
from replay.trackers.appearance import Colours
from replay.trackers.events.places import Cut, Likeness
from replay.trackers.events.tracks import Track
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]


LATEST = 4
"""Looks that count while it is not yet sure who a target is."""


def learn(track: Track, seen: Floats) -> None:
    """Learn a target's colours as `look_at` gives them."""
    if track.company:
        track.fresh = track.fresh or Colours()
        track.fresh.learn(seen, LATEST)
        return
    if track.colours is None:
        track.colours = Colours()
    track.colours.learn(seen)
    track.signed = True


def look_at(
    image: Image, mask: Image | None, box: tuple[float, float, float, float]
) -> Floats | None:
    """Colour histograms of a box's foreground, weighted towards the ellipse's centre, None where
    less than a few of its pixels lie in the picture.
    """
    height, width = image.shape[:2]
    x1, y1 = max(0, round(box[0])), max(0, round(box[1]))
    x2, y2 = min(width, round(box[0] + box[2])), min(height, round(box[1] + box[3]))
    if x2 - x1 < 3 or y2 - y1 < 6:
        return None
    weights = appearance.kernel(y2 - y1, x2 - x1)
    if mask is not None:
        weights = weights * (mask[y1:y2, x1:x2] > 0)
    return appearance.histograms(appearance.bins_of(image[y1:y2, x1:x2]), weights)


def likenesses(tracks: Sequence[Track], image: Image, cut: Cut) -> list[Likeness]:
    """Each target's likeness against the others', None where its own or all others' colours are
    not known.
    """
    known = [
        t.colours.body if t.colours is not None and t.colours.updates else None
        for t in tracks
    ]
    if sum(k is not None for k in known) < 2:
        return [None] * len(tracks)
    told: list[tuple[Floats, Floats, list[int]] | None] = []
    for k, mine in enumerate(known):
        if mine is None:
            told.append(None)
            continue
        rivals = [other for j, other in enumerate(known) if j != k and other is not None]
        others = np.zeros_like(mine)
        for rival in rivals:
            others += rival / len(rivals)
        told.append((mine, others, appearance.choose(mine, others)))
    height, width = cut.pixels.shape
    part = image[cut.top : cut.top + height, cut.left : cut.left + width]
    bins = appearance.bins_of(
        part, sorted({k for t in told if t is not None for k in t[2]})
    )
    return [None if t is None else appearance.back_project(bins, *t) for t in told]
