"""Whether the camera shows colours: one that goes over to infrared shows none, and looks can be
compared by their brightness alone, until the colours are back.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from recorders.vision import cv2
from replay.trackers.tracker import Frame, Image

_STEP = 8
"""Every so many pixels, across and down, are looked at."""
_CHROMA = 2
"""Cr and Cb of a picture without colours differ from 128 by at most this."""
_COLOURLESS = 0.998
"""Share of such places from which on a camera shows no colours."""


class Light:
    """Follows whether a recording shows colours.

    Attributes:
        grey: the last picture had none.
    """

    def __init__(self) -> None:
        self._seen = False
        self.grey = False

    def lit(self, frame: Frame, turned: Callable[[], None] = lambda: None) -> Frame:
        """A frame that tells, once its picture is asked for, whether that has colours; ``turned``
        is called then if colours are gone, or are back.
        """
        if not frame.has_picture:
            return frame
        mask, labels = frame.mask, frame.labels
        return Frame(
            frame.index,
            frame.time_ns,
            lambda: frame.detections,
            frame.regions,
            lambda: None if frame.image is None else self._take(frame.image, turned),
            None if mask is None else lambda: mask,
            load_labels=None if labels is None else lambda: labels,
            changes=frame.changes,
        )

    def _take(self, image: Image, turned: Callable[[], None]) -> Image:
        places = np.ascontiguousarray(image[::_STEP, ::_STEP])
        chroma = cv2.cvtColor(places, cv2.COLOR_BGR2YCrCb)[..., 1:]
        neutral = np.abs(chroma.astype(np.int16) - 128).max(axis=2) <= _CHROMA
        grey = int(np.count_nonzero(neutral)) >= _COLOURLESS * neutral.size
        before, seen = self.grey, self._seen
        self.grey, self._seen = grey, True
        if seen and grey != before:
            turned()
        return image

    def state(self) -> dict[str, Any]:
        """Plain data for a checkpoint."""
        return {"seen": self._seen, "grey": self.grey}

    def restore(self, state: Mapping[str, Any]) -> None:
        """Continue from what `state` gave."""
        self._seen, self.grey = state["seen"], state["grey"]
