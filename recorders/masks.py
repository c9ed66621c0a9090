"""Recorded foreground masks and their blobs."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.errors import RecordingError
from recorders.log import Message
from recorders.vision import cv2

Mask = NDArray[np.uint8]
Labels = NDArray[np.uint16]


def label_blobs(mask: Mask) -> tuple[int, Labels]:
    """The number of a mask's blobs, and each pixel's, (H, W): k + 1 for component k of the
    detections, 0 for none.
    """
    height, width = mask.shape
    # 16 bits take half the time of 32. Every label needs a foreground pixel, and a block of 2 x 2
    # pixels to itself.
    most = min(((height + 1) // 2) * ((width + 1) // 2), cv2.countNonZero(mask))
    depth = cv2.CV_16U if most < 1 << 16 else cv2.CV_32S
    count, labels = cv2.connectedComponents(mask, connectivity=8, ltype=depth)
    return count - 1, np.asarray(labels, np.uint16)


class RecordedMask:
    """A frame's recorded mask: decoded, held against the detections and labelled in one go, for
    whoever asks first.
    """

    def __init__(
        self,
        picture: Callable[[], Mask],
        blobs: Callable[[], int],
        message: Message,
        path: Path,
    ) -> None:
        """Prepare.

        Args:
            picture: decodes it.
            blobs: how many components the detections list.
            message: that holds it.
            path: for the error's text.
        """
        self._picture = picture
        self._blobs = blobs
        self._message = message
        self._path = path
        self._labels: Labels | None = None

    def load(self) -> Mask:
        """The mask.

        Raises:
            RecordingError: it is damaged, or has other components than the detections list.
        """
        mask = self._picture()
        # Whoever counts pixels by blob relies on it: blob k is component k of this mask.
        found, self._labels = label_blobs(mask)
        if found != (listed := self._blobs()):
            when = self._message.log_time_ns
            raise RecordingError(
                f"the foreground at {when} ns has {found} components, its detections list {listed}",
                self._path,
                record=self._message.topic,
            )
        return mask

    def labels(self) -> Labels:
        """Its labels, as `label_blobs` gives them; call `load` before."""
        assert self._labels is not None
        return self._labels
