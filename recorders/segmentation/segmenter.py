"""What a segmenter is: a picture in, its foreground mask and its detections out.

A plug-in is a class of this shape and a line in `recorders.segmentation.SEGMENTERS`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Protocol, cast, runtime_checkable

from recorders.messages import Detections, SceneChange
from recorders.pictures import Image
from recorders.segmentation.parameters import SegmentationParameters


def as_image(picture: object) -> Image:
    """What OpenCV gives for 8-bit input, for the type checker."""
    return cast("Image", picture)


@dataclass(frozen=True)
class Segmented:
    """One frame, segmented.

    Attributes:
        mask: (H, W) uint8, 0 or 255; only components that passed the size filter, so that label k
            of ``cv2.connectedComponents(mask, connectivity=8)`` is blob k of
            ``detections.components``.
        detections: the boxes found in the mask, and the components themselves.
    """

    mask: Image
    detections: Detections


@runtime_checkable
class Segmenter(Protocol):
    """Foreground and detections of one recording. Its answers are a function of the pictures so
    far, alone.
    """

    def prepare(self, frames: Iterable[Image]) -> None:
        """Optional first reading of the whole recording, for a background in hindsight.

        Args:
            frames: every picture in order, (H, W, 3) uint8 BGR; a bounded number of them is kept.
        """
        ...

    def segment(self, index: int, image: Image) -> Segmented:
        """Segment the next frame.

        Args:
            index: the frame's number, from 0.
            image: (H, W, 3) uint8 BGR of the size that the segmenter was made for.
        """
        ...


@runtime_checkable
class SegmenterInParts(Segmenter, Protocol):
    """A segmenter whose detecting may go on in another thread while it finds the next frame's
    foreground.
    """

    def begin(self, index: int, image: Image) -> tuple[Image, Callable[[], Detections]]:
        """The next frame's mask, and what gives its detections: called once, frame after frame in
        their order.

        Together they are `segment`. What is called shares no state with later frames' `begin`.
        """
        ...


@runtime_checkable
class SegmenterInTwoLooks(Segmenter, Protocol):
    """A segmenter that learns more from pairs of pictures, a moment apart."""

    def prepare_twice(self, pairs: Iterable[tuple[Image, Image]]) -> None:
        """`prepare` from pairs of pictures `recorders.segmentation.usual.MOMENT_S` apart, spread
        over the whole recording.
        """
        ...


@runtime_checkable
class SegmenterThatWatches(Segmenter, Protocol):
    """A segmenter that knows when the picture changes as a whole."""

    def changes(self) -> tuple[SceneChange, ...]:
        """What is told of that with the last frame that was begun."""
        ...


def neighbours(frames: Iterable[Image]) -> Iterator[tuple[Image, Image]]:
    """Each picture with the next one, the last one with itself."""
    before: Image | None = None
    for frame in frames:
        if before is not None:
            yield before, frame
        before = frame
    if before is not None:
        yield before, before


SegmenterFactory = Callable[[SegmentationParameters, int, int, float], Segmenter]
"""Parameters, width and height in pixels, frames per second -> a segmenter."""
