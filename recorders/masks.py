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
_MOST_LABELS = np.iinfo(np.uint16).max


def label_blobs(mask: Mask) -> tuple[int, Labels]:
    """The number of a mask's blobs, and each pixel's, (H, W): k + 1 for component k of the
    detections, 0 for none.
    """
    depth = cv2.CV_16U if has_few_labels(mask) else cv2.CV_32S
    count, labels = cv2.connectedComponents(mask, connectivity=8, ltype=depth)
    return count - 1, np.asarray(labels, np.uint16)


def has_few_labels(mask: Mask) -> bool:
    """Whether 16 bits cannot run out while a mask of one value (and 0) is labelled, which takes less
    than half the time of 32.

    While its pixels are walked over, a label is begun for a block of 2 x 2 pixels at most, and only
    where no pixel before is touched: at the begin of a run of pixels in their row.
    """
    height, width = mask.shape
    if ((height + 1) // 2) * ((width + 1) // 2) < _MOST_LABELS:
        return True
    if cv2.countNonZero(mask) < _MOST_LABELS:
        return True
    runs = np.count_nonzero(mask[:, 0]) + np.count_nonzero(mask[:, 1:] > mask[:, :-1])
    return bool(runs < _MOST_LABELS)


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
