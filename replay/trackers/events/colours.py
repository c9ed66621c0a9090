"""Appearance of the targets (EVENTS 2): learnt while a target is alone, asked where blobs are
shared.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from replay.trackers import appearance
from replay.trackers.appearance import Colours
from replay.trackers.events.places import Likeness, MaskCut
from replay.trackers.events.tracks import EventsTrack
from replay.trackers.tracker import Image

Floats = NDArray[np.float64]


LATEST = 4
"""Looks that count while it is not yet sure who a target is."""


def learn(track: EventsTrack, seen: Floats) -> None:
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


KNOWN = 2
"""So often must a target's colours have been learnt before they say that it is not seen."""
USUAL = 0.6
"""A target that is seen whole shares this much of its histograms with itself, at least."""


def alike(track: EventsTrack, rivals: Sequence[EventsTrack], seen: Floats) -> float | None:
    """How much of a target's own colours is seen where it was placed (EVENTS 2), in [0, 1].

    The intersection of its histograms with those that are seen, over the features that tell it
    best from those who are in the same blob, against what is usual of one who is seen whole. Where
    all look the same it says nothing, and is high.

    Args:
        track: the target.
        rivals: who shares the blob with it.
        seen: the histograms at its place, as `look_at` gives them.

    Returns:
        None where its colours, or all rivals', are not known.
    """
    total = float(seen[0].sum())
    known = [
        rival.colours.body
        for rival in rivals
        if _is_known(rival) and rival.colours is not None
    ]
    if track.colours is None or not _is_known(track) or not known or total <= 0:
        return None
    mine, here = track.colours.body, seen.sum(axis=1) / total
    chosen = appearance.choose(mine, sum(known, np.zeros_like(mine)) / len(known))
    shared = np.minimum(mine, here).sum(axis=1)[chosen]
    return min(1.0, float(shared.mean()) / USUAL)


def _is_known(track: EventsTrack) -> bool:
    return track.colours is not None and track.colours.updates >= KNOWN


def likenesses(tracks: Sequence[EventsTrack], image: Image, cut: MaskCut) -> list[Likeness]:
    """Each target's likeness against the others', None where its own or all others' colours are
    not known.
    """
    known = [
        track.colours.body if track.colours is not None and track.colours.updates else None
        for track in tracks
    ]
    if sum(k is not None for k in known) < 2:
        return [None] * len(tracks)
    told: list[tuple[Floats, Floats, list[int]] | None] = []
    for k, mine in enumerate(known):
        if mine is None:
            told.append(None)
            continue
        rivals = [
            other for index, other in enumerate(known) if index != k and other is not None
        ]
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
