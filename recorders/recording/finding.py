"""What is found in a frame: its mask, and its detections from masks, detector and source
together.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import cast

import msgspec
import numpy as np

from recorders.detectors import Detector, as_detections
from recorders.errors import SceneTraceError
from recorders.fusion import FusedFrames
from recorders.masks import label_blobs
from recorders.messages import NO_BLOB, Detections, SceneChange
from recorders.pictures import Image
from recorders.segmentation import (
    Segmented,
    Segmenter,
    SegmenterInParts,
    SegmenterThatWatches,
)
from recorders.segmentation.usual import ious
from recorders.sources import Source, SourceFrame

COMPARED_EVERY = 10
"""Detector and masks are compared in every so-manieth frame."""
ALIKE = 0.2
"""A box has a body in the masks if they overlap by this (intersection over union)."""
Detect = Callable[[], list[Detections]]


class Finder:
    """Looks through a source's frames, in their order.

    Attributes:
        source: whose frames.
        segmenter: gives masks, and what lies in them; None: no masks.
        detector: looks at each picture; None: what the source says, if anything.
        detector_name: for its errors.
        boxes, boxes_in_masks: of the frames that were compared, how many boxes the detector or the
            source gave, and how many of them have a body in the masks.
        fusion: makes one set of detections of masks and detector; None: what the detector or the
            source says gets blobs, and nothing else is done to it.
    """

    def __init__(
        self,
        source: Source,
        segmenter: Segmenter | None = None,
        detector: Detector | None = None,
        detector_name: str = "",
        fusion: FusedFrames | None = None,
    ) -> None:
        self.source = source
        self.segmenter = segmenter
        self.detector = detector
        self.detector_name = detector_name
        self.fusion = fusion
        self.boxes = self.boxes_in_masks = 0

    @property
    def sees(self) -> bool:
        """It needs the pictures."""
        return self.segmenter is not None or self.detector is not None

    @property
    def behind(self) -> int:
        """A frame's detections are known so many frames later."""
        return 0 if self.fusion is None else self.fusion.ahead

    def begin(self, frame: SourceFrame) -> tuple[Image | None, Detect]:
        """The frame's mask, and what gives the detections that are known with it: called once, in
        the frames' order, from whatever thread.
        """
        if self.segmenter is None:
            return None, lambda: [self._given(frame) or self._nothing(frame.index)]
        assert frame.image is not None
        if _works_in_parts(type(self.segmenter)):
            in_parts = cast(SegmenterInParts, self.segmenter)
            mask, detect = in_parts.begin(frame.index, frame.image)
        else:
            whole = self.segmenter.segment(frame.index, frame.image)
            mask, detect = whole.mask, lambda: whole.detections
        return mask, lambda: self._together(frame, mask, detect)

    def changes(self) -> tuple[SceneChange, ...]:
        """How the picture changed as a whole, as far as it is told with the last frame begun."""
        if self.segmenter is None or not _watches(type(self.segmenter)):
            return ()
        return cast(SegmenterThatWatches, self.segmenter).changes()

    def finish(self) -> list[Detections]:
        """The detections that are known once there are no more frames."""
        return [] if self.fusion is None else self.fusion.finish()

    def _nothing(self, index: int) -> Detections:
        return Detections(index, self.source.width, self.source.height)

    def _together(
        self, frame: SourceFrame, mask: Image, detect: Callable[[], Detections]
    ) -> list[Detections]:
        found, given = detect(), self._given(frame)
        if given is None:
            return [found]
        if not found.frame % COMPARED_EVERY:
            self._compare(found, given)
        given = with_blobs(given, Segmented(mask, found))
        return [given] if self.fusion is None else self.fusion.add(found, given)

    def _compare(self, found: Detections, given: Detections) -> None:
        """How many of the detector's boxes have a body in the masks."""
        self.boxes += len(given.boxes)
        if found.boxes and given.boxes:
            shares = ious(*(np.array(d.boxes, np.float64) for d in (given, found)))
            self.boxes_in_masks += int(np.count_nonzero((shares >= ALIKE).any(axis=1)))

    def _given(self, frame: SourceFrame) -> Detections | None:
        """What the detector finds in the frame, or the source says of it."""
        if self.detector is None:
            return frame.detections
        assert frame.image is not None
        return self.detected(frame.index, frame.image)

    def detected(self, index: int, image: Image) -> Detections:
        """What the detector finds in a picture.

        Raises:
            SceneTraceError: it fails, or its answer is none.
        """
        assert self.detector is not None
        size = self.source.width, self.source.height
        try:
            found = list(self.detector.detect(image))
        except SceneTraceError:
            raise
        except Exception as error:  # of others' code anything may come
            raise SceneTraceError(
                f"the detector {self.detector_name} in frame {index}:"
                f" {type(error).__name__}: {error}"
            ) from error
        return as_detections(self.detector_name, index, *size, found)


@cache
def _works_in_parts(kind: type) -> bool:
    """`SegmenterInParts`: what a class can, Python takes long to find out; so once, not every frame."""
    return issubclass(kind, SegmenterInParts)


@cache
def _watches(kind: type) -> bool:
    return issubclass(kind, SegmenterThatWatches)


def with_blobs(given: Detections, found: Segmented) -> Detections:
    """Given detections with the blobs of a segmented frame: each has the blob that fills most of
    its box.

    Equal shares: the blob with the smaller id. `NO_BLOB` where no foreground lies in the box.
    """
    count, labels = label_blobs(found.mask)
    height, width = labels.shape
    blobs = []
    for x, y, w, h in given.boxes:
        left, top = max(0, round(x)), max(0, round(y))
        right, bottom = (
            max(left, min(width, round(x + w))),
            max(top, min(height, round(y + h))),
        )
        areas = np.bincount(labels[top:bottom, left:right].ravel(), minlength=count + 1)
        areas[0] = 0
        best = int(areas.argmax())
        blobs.append(best if areas[best] else NO_BLOB)
    masked = found.detections
    return msgspec.structs.replace(
        given,
        blobs=blobs,
        components=masked.components,
        light=masked.light,
        moved=masked.moved,
    )
