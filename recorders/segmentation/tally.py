"""What the second reading says of a recording: detections that flicker or never move, and how often
the picture changed as a whole.

Every tenth frame and its neighbours are looked at, and for rests a frame each half second: that is
enough for shares.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Box, Detections, SceneChange
from recorders.segmentation.change.landmarks import Shift
from recorders.segmentation.change.light import Light
from recorders.segmentation.change.watch import Look
from recorders.segmentation.usual import ious

Floats = NDArray[np.float64]
EVERY = 10
REST_EVERY_S = 0.5
GOES_ON = 0.2
"""A body overlaps its own box in the next frame by this (intersection over union)."""
SAME_PLACE = 0.5
"""A body rests while its box overlaps the first one by this (intersection over union)."""
FORGOTTEN_S = 2.0
"""A rest ends when nothing was seen in its place for so long."""


@dataclass
class _Stay:
    """A place where something rests: its box, first and last frame, and how often it was seen."""

    box: Box
    first: int
    last: int
    count: int = 1


class Tally:
    """Counts over the frames of one recording, in their order.

    Attributes:
        frames: how many were counted.
        told: how often each kind of change was told.
        largest_shift: from one frame to the next, px.
        levels: the least and the largest brightness, as shares of the usual one.
    """

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._rest_every = max(1, round(REST_EVERY_S * fps))
        self._recent: list[Floats] = []
        self._alone = self._judged = 0
        self._stays: list[_Stay] = []
        self._ended: list[_Stay] = []
        self._sampled = 0
        self.frames = 0
        self.told: Counter[str] = Counter()
        self._looked = self._shaken = self._lost = 0
        self._shift: Shift | None = None
        self.largest_shift = 0
        self.levels = (1.0, 1.0)

    def see(self, look: Look, light: Light, told: tuple[SceneChange, ...]) -> None:
        """A frame's look and light, and what was told with it."""
        self.told.update(change.kind for change in told)
        self._looked += 1
        if look.place is None:
            self._lost += 1
            self._shift = None
            return
        before, self._shift = self._shift, look.shift
        if before is not None and before != look.shift:
            self._shaken += 1
            by = (look.shift[0] - before[0], look.shift[1] - before[1])
            self.largest_shift = max(self.largest_shift, *map(abs, by))
        if light.known:
            low, high = self.levels
            self.levels = (min(low, light.level), max(high, light.level))

    def count(self, detections: Detections) -> None:
        """A frame's detections."""
        phase = self.frames % EVERY
        if phase < 3:
            if phase == 0:
                self._recent = []
            self._recent.append(np.array(detections.boxes, np.float64).reshape(-1, 4))
            if phase == 2 and len(self._recent) == 3:
                self._judge(*self._recent)
        if self.frames % self._rest_every == 0:
            self._rest(detections)
        self.frames += 1

    def _judge(self, before: Floats, now: Floats, after: Floats) -> None:
        """How many detections stand alone in time: not seen both before and after."""
        self._judged += len(now)
        seen = np.ones(len(now), bool)
        for other in (before, after):
            if not len(other):
                seen[:] = False
            elif len(now):
                seen &= (ious(now, other) >= GOES_ON).any(axis=1)
        self._alone += int(np.count_nonzero(~seen))

    def _rest(self, detections: Detections) -> None:
        boxes = detections.boxes
        self._sampled += len(boxes)
        taken = np.zeros(len(boxes), bool)
        now = np.array(boxes, np.float64).reshape(-1, 4)
        if self._stays and boxes:
            shares = ious(np.array([s.box for s in self._stays], np.float64), now)
            for stay, row in zip(self._stays, shares, strict=True):
                best = int(row.argmax())
                if row[best] >= SAME_PLACE and not taken[best]:
                    taken[best] = True
                    stay.last, stay.count = self.frames, stay.count + 1
        old = [s for s in self._stays if self.frames - s.last > FORGOTTEN_S * self._fps]
        self._ended += [s for s in old if s.last > s.first]
        self._stays = [s for s in self._stays if s not in old]
        self._stays += [
            _Stay(box, self.frames, self.frames)
            for box, known in zip(boxes, taken.tolist(), strict=True)
            if not known
        ]

    @property
    def flicker(self) -> float:
        """The share of detections that are not there in the frame before, or not in the one after."""
        return self._alone / self._judged if self._judged else 0.0

    def longest_rest_s(self) -> float:
        """How long something rested at one place, at most."""
        stays = [*self._ended, *self._stays]
        return max((s.last - s.first for s in stays), default=0) / self._fps

    def still_share(self, least_s: float, share: float) -> float:
        """The share of detections that rest at one place for so long, and for this share of the
        recording.
        """
        least = max(least_s * self._fps, share * self.frames)
        stays = [*self._ended, *self._stays]
        resting = sum(s.count for s in stays if s.last - s.first >= least)
        return resting / self._sampled if self._sampled else 0.0

    @property
    def shaken(self) -> float:
        """The share of frames that are shifted against the frame before."""
        return self._shaken / self._looked if self._looked else 0.0

    @property
    def unseen(self) -> float:
        """The share of frames that show no view that is known."""
        return self._lost / self._looked if self._looked else 0.0
