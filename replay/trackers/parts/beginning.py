"""How targets begin (PARTS 3): at new blobs and where blobs split, or by hand; and how they are
confirmed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from reasoning.regions import SceneRegions
from recorders.errors import ConfigError
from recorders.messages import NO_BLOB, Notice
from recorders.names import whole
from replay.trackers.association import intersection, iou
from replay.trackers.belief import LIKELY
from replay.trackers.life import TENTATIVE, Life
from replay.trackers.parts.candidates import Observed
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.targets import PartsTarget, PartsTargets
from replay.trackers.tracker import Frame

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Start:
    """A target started by hand: frame from 0, box x, y, w, h in pixels."""

    frame: int
    box: tuple[float, float, float, float]


def parse_init(words: str) -> tuple[Start, ...]:
    """Targets started by hand, by frame, then in the order of the words.

    >>> parse_init("frame:3:10,20,30,60; frame:0:1,2,3,4")
    (Start(frame=0, box=(1.0, 2.0, 3.0, 4.0)), Start(frame=3, box=(10.0, 20.0, 30.0, 60.0)))

    Raises:
        ConfigError: not ``frame:N:x,y,w,h``, or a box without a size.
    """
    out: list[Start] = []
    for word in (w.strip() for w in words.split(";")):
        if not word:
            continue
        kind, _, rest = word.partition(":")
        number, _, box = rest.partition(":")
        try:
            x, y, w, h = (float(v) for v in box.split(","))
            index = whole(number)
            if (
                kind != "frame"
                or index is None
                or not all(map(math.isfinite, (x, y, w, h)))
                or min(w, h) <= 0
            ):
                raise ValueError(word)
        except ValueError:
            raise ConfigError(
                f"parts.init: {word!r} must be frame:N:x,y,w,h with N from 0 and w and h over 0"
            ) from None
        out.append(Start(index, (x, y, w, h)))
    return tuple(sorted(out, key=lambda s: s.frame))


class Beginning:
    """Starts and confirms targets."""

    def __init__(self, p: PartsParameters, targets: PartsTargets) -> None:
        self._p = p
        self._targets = targets

    def by_hand(self, frame: Frame, starts: Sequence[Start]) -> None:
        """Start what was drawn into this frame; a bystander of the same place gives way to it."""
        for start in starts:
            if start.frame == frame.index:
                box = np.array(start.box, np.float64)
                same = iou(box[None], self._targets.boxes)[0]
                strangers = [
                    k
                    for k, item in enumerate(self._targets.items)
                    if not item.manual and same[k] >= self._p.same_place
                ]
                self._targets.keep(
                    [k for k in range(len(self._targets)) if k not in strangers]
                )
                target = PartsTarget(
                    TENTATIVE, frame.index, frame.time_ns, frame.time_ns, manual=True
                )
                target.measured = start.box
                self._targets.start(box, target)

    def automatic(
        self, frame: Frame, seen: Observed, unexplained: Floats, regions: SceneRegions
    ) -> None:
        """Start a tentative target at every detection that nobody explains and whose centroid
        lies in the region of interest or its security border (EVENTS 3.2).

        Args:
            frame: the frame.
            seen: its observations.
            unexplained: (K,) share of each that belongs to no target.
            regions: where targets may start.
        """
        has_mask = bool(len(seen.blob_boxes))
        before = self._targets.boxes.copy()
        crowded = {
            item.blob
            for item in self._targets.items
            if item.observed and item.blob != NO_BLOB
        }
        free = np.flatnonzero((unexplained >= self._p.min_unexplained) & (seen.scores > 0))
        centres = seen.boxes[free, :2] + seen.boxes[free, 2:] / 2
        centroids = np.where(np.isnan(seen.centroids[free]), centres, seen.centroids[free])
        for k in free[regions.may_start_low_level_all(centroids)].tolist():
            # Whatever its score: the score of a body within a blob means little once nobody
            # explains it.
            if not has_mask and seen.scores[k] < LIKELY:
                continue
            blob = int(seen.blobs[k])
            target = PartsTarget(
                TENTATIVE, frame.index, frame.time_ns, frame.time_ns, blob=blob
            )
            share = intersection(seen.boxes[k : k + 1], before) / max(
                float(seen.boxes[k, 2] * seen.boxes[k, 3]), 1.0
            )
            target.split = blob in crowded or bool((share >= self._p.split_share).any())
            target.sightings.append([float(frame.index), *seen.boxes[k].tolist()])
            target.measured = tuple(seen.boxes[k].tolist())
            self._targets.start(seen.boxes[k], target)

    def confirm(
        self, frame: Frame, life: Life, next_bystander: int, only_by_hand: bool
    ) -> tuple[int, list[Notice]]:
        """Give ids to what has had enough support, in the order of birth.

        Args:
            frame: the frame.
            life: gives the targets' ids.
            next_bystander: the next bystander's id.
            only_by_hand: whoever was not started by hand becomes a bystander.

        Returns:
            The next bystander's id, and what is to be told of the targets.
        """
        notices: list[Notice] = []
        for target in self._targets.items:
            ripe = life.is_ripe(target, frame.time_ns)
            if target.manual and target.id == TENTATIVE and target.observed:
                rule = "PARTS 3: started by hand"
                notices.append(life.confirm(target, frame.time_ns, rule))
            elif ripe and only_by_hand:
                target.id, target.sightings = next_bystander, []
                next_bystander += 1
            elif ripe:
                notices.append(life.confirm(target, frame.time_ns))
        return next_bystander, notices
