"""Hiding bystanders: of everybody but the subjects no pixel is left in a picture.

What is hidden is painted over in one plain colour, which nothing can be reckoned back from: the
boxes of all other tracks, held to be present or not, withheld or only detected, with a margin;
where a track was missing for a while, the boxes before and after it; and every pixel of the
foreground that lies outside the subjects' own boxes. Whoever stood still since before the
recording began and was never seen to move is no track and no foreground, and stays.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Sequence

import numpy as np

from recorders.annotated.reader import AnnotatedLog
from recorders.channels import NANOS
from recorders.messages import Box
from recorders.pictures import Image
from recorders.scene import Frame
from recorders.vision import cv2

COVER = (128, 128, 128)
"""The colour of what is hidden, BGR."""
_MARGIN, _MARGIN_PX = 0.12, 3.0
_AROUND_NS = NANOS
_SPREAD_PX = 9
_SAME = 0.5


class Bystanders:
    """Where everybody was, to be hidden.

    Args:
        log: the annotated log; read once.
    """

    def __init__(self, log: AnnotatedLog) -> None:
        self._times: dict[int, list[int]] = {}
        self._boxes: dict[int, list[Box]] = {}
        self._withheld: dict[int, list[Box]] = {}
        for frame in log.frames(("tracks", "held_back")):
            for track in frame.tracks:
                self._times.setdefault(track.id, []).append(frame.time_ns)
                self._boxes.setdefault(track.id, []).append(track.box)
            if frame.held_back:
                self._withheld[frame.time_ns] = [w.box for w in frame.held_back]

    def boxes(self, time_ns: int, subjects: Iterable[int]) -> list[Box]:
        """Boxes of all but the subjects at a moment, without a margin."""
        shown = frozenset(subjects)
        found = list(self._withheld.get(time_ns, ()))
        for track, times in self._times.items():
            if track not in shown:
                found += self._near(track, times, time_ns)
        return found

    def subjects(self, time_ns: int, subjects: Iterable[int]) -> list[Box]:
        """Boxes of the subjects at a moment."""
        found = []
        for track in sorted(subjects):
            times = self._times.get(track, [])
            k = bisect_left(times, time_ns)
            if k < len(times) and times[k] == time_ns:
                found.append(self._boxes[track][k])
        return found

    def _near(self, track: int, times: list[int], time_ns: int) -> list[Box]:
        """Its box; in a gap what holds those on both sides; shortly before and after it the first
        and the last one.
        """
        k, boxes = bisect_left(times, time_ns), self._boxes[track]
        if k < len(times) and times[k] == time_ns:
            return [boxes[k]]
        sides = []
        if k > 0 and (k < len(times) or time_ns - times[k - 1] <= _AROUND_NS):
            sides.append(boxes[k - 1])
        if k < len(times) and (k > 0 or times[k] - time_ns <= _AROUND_NS):
            sides.append(boxes[k])
        return [_union(sides)] if sides else []

    def hidden(self, image: Image, frame: Frame, subjects: Iterable[int]) -> Image:
        """The picture, (height, width, 3) BGR, in which only the subjects are to be seen; the
        picture that is given stays as it is.
        """
        shown = list(subjects)
        own = self.subjects(frame.time_ns, shown)
        out = image.copy()
        mask = frame.mask
        if mask is not None:
            stray = np.where(mask > 0, np.uint8(255), np.uint8(0))
            kernel = np.ones((_SPREAD_PX, _SPREAD_PX), np.uint8)
            stray = np.asarray(cv2.dilate(stray, kernel), np.uint8)
            for x0, y0, x1, y1 in (_pixels(box, image.shape, 0.0) for box in own):
                stray[y0:y1, x0:x1] = 0
            out[stray > 0] = COVER
        others = self.boxes(frame.time_ns, shown)
        others += [box for box in frame.detections.boxes if not _is_one_of(box, own)]
        for box in others:
            x0, y0, x1, y1 = _pixels(box, image.shape, _MARGIN)
            out[y0:y1, x0:x1] = COVER
        return out


def _union(boxes: Sequence[Box]) -> Box:
    x, y = min(b[0] for b in boxes), min(b[1] for b in boxes)
    right, foot = max(b[0] + b[2] for b in boxes), max(b[1] + b[3] for b in boxes)
    return x, y, right - x, foot - y


def _pixels(box: Box, shape: Sequence[int], margin: float) -> tuple[int, int, int, int]:
    """Left, top, right, foot of a box with a margin of its longer side, within the picture."""
    grown = margin * max(box[2], box[3]) + (_MARGIN_PX if margin else 0.0)
    x0, y0 = int(np.floor(box[0] - grown)), int(np.floor(box[1] - grown))
    x1, y1 = int(np.ceil(box[0] + box[2] + grown)), int(np.ceil(box[1] + box[3] + grown))
    height, width = shape[:2]
    return max(0, x0), max(0, y0), min(width, max(0, x1)), min(height, max(0, y1))


def _is_one_of(box: Box, own: Sequence[Box]) -> bool:
    """Whether a detection is a subject's own: each holds half of the other and more."""
    for other in own:
        w = min(box[0] + box[2], other[0] + other[2]) - max(box[0], other[0])
        h = min(box[1] + box[3], other[1] + other[3]) - max(box[1], other[1])
        if w > 0 and h > 0 and w * h >= _SAME * max(box[2] * box[3], other[2] * other[3]):
            return True
    return False
