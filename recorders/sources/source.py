"""What a source is: frames in order with their times, each with a picture, with detections, or
with both.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from fractions import Fraction
from functools import cached_property
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from recorders.errors import SourceError, UsageError
from recorders.log import Attachment, Message
from recorders.messages import NO_BLOB, Box, Detections
from recorders.pictures import Image
from recorders.vision import cv2

NANOS = 1_000_000_000
ASSUMED_FPS = Fraction(25)
_MAX_FPS = 100_000
_MAX_DENOMINATOR = 100_100


class PictureError(SourceError):
    """One picture that cannot be decoded: it can be left out."""

    def __init__(self, reason: str, path: str | Path, where: str) -> None:
        super().__init__(f"{where}: {reason}", path)
        self.what = reason
        self.where = where


class SourceFrame:
    """One frame of a source. Its picture is decoded when first asked for, once.

    Attributes:
        index: from 0.
        time_ns: since the first frame.
        encoded: the picture's own bytes, to be recorded as they are, or None.
        format: ``jpeg`` or ``png`` where there are such bytes.
        detections: what the source says was detected in this frame, or None.
    """

    def __init__(
        self,
        index: int,
        time_ns: int,
        load_image: Callable[[], Image] | None = None,
        encoded: bytes | None = None,
        picture_format: str | None = None,
        detections: Detections | None = None,
    ) -> None:
        self.index = index
        self.time_ns = time_ns
        self.encoded = encoded
        self.format = picture_format
        self.detections = detections
        self._load_image = load_image

    @property
    def has_picture(self) -> bool:
        """Whether there is a picture, decoded or not."""
        return self._load_image is not None

    def without_picture(self) -> None:
        """Forget the picture: it cannot be decoded."""
        self._load_image = self.encoded = self.format = None

    @cached_property
    def image(self) -> Image | None:
        """The picture, (height, width, 3) uint8 BGR, or None. Never write into it."""
        return None if self._load_image is None else self._load_image()


class Source(Protocol):
    """Frames of one camera, readable from the start as often as wanted.

    Attributes:
        path: where it was opened.
        name: what it is, in words: ``video``, ``images``, ``MOTChallenge text``, ``CAVIAR XML``.
        width, height: of every picture, in pixels.
        frame_ns: the nominal time between frames.
        has_images: every frame has a picture.
        stills: the pictures come as JPEG or PNG bytes, which can be recorded as they are.
        has_detections: every frame has detections, if only none.
        frame_count: how many frames there are, None where only reading tells; an expectation, not
            a promise.
        notes: what had to be assumed, one line each.
        losses: what the last whole reading had to leave out, one line each.
    """

    path: Path
    name: str
    width: int
    height: int
    frame_ns: int
    has_images: bool
    stills: bool
    has_detections: bool
    frame_count: int | None
    notes: list[str]
    losses: list[str]

    def frames(self) -> Iterator[SourceFrame]:
        """All frames from the first on.

        Raises:
            SourceError: what is there cannot be read; names the file and the place.
            LimitError: it claims more than the limits allow.
        """
        ...

    def sample(self, count: int) -> Iterator[Image]:
        """About ``count`` pictures spread evenly over the source, in order; the same ones each
        time.
        """
        ...

    def digests(self) -> list[tuple[str, str]]:
        """Name and SHA-256 (hexadecimal) of each file that the last whole reading read, in order."""
        ...


@runtime_checkable
class NumberedSource(Protocol):
    """A source of pictures that may have numbers of their own.

    Attributes:
        numbers: of each picture from 1, where some numbers between them are missing; else None.
        names: of each picture's file.
    """

    numbers: list[int] | None
    names: list[str]

    def time_ns(self, index: int) -> int:
        """When the picture of number ``index + 1`` was taken, since the first number."""
        ...


@runtime_checkable
class LoggedSource(Protocol):
    """A source that is a log: its frames have times of their own, and it holds more than frames.

    Attributes:
        start_ns: the first frame's log time.
    """

    start_ns: int

    def others(self) -> Iterator[Message]:
        """The messages that are passed on as they are, by log time."""
        ...

    def attachments(self) -> Iterator[Attachment]:
        """The log's attachments."""
        ...

    def metadata(self) -> list[tuple[str, dict[str, str]]]:
        """The log's metadata records."""
        ...


@runtime_checkable
class GivenDetections(Protocol):
    """A source whose detections can be read without its pictures."""

    def given(self, count: int) -> Iterator[Detections]:
        """The detections of about ``count`` frames spread evenly over the source."""
        ...


@runtime_checkable
class SourceOfPairs(Protocol):
    """A source that gives pictures together with those a moment later."""

    def pairs(self, count: int, apart: int) -> Iterator[tuple[Image, Image]]:
        """About ``count`` pictures spread evenly over the source, in order, each with the one
        ``apart`` frames later; the same ones each time.
        """
        ...


def pairs_of(source: Source, count: int, apart: int) -> Iterator[tuple[Image, Image]]:
    """`SourceOfPairs.pairs`, or the same by reading all frames, of which those alone are decoded."""
    if isinstance(source, SourceOfPairs):
        yield from source.pairs(count, apart)
        return
    among = max(1, (source.frame_count or 0) - apart)
    firsts: dict[int, Image] = {}
    for frame in source.frames():
        first = firsts.pop(frame.index - apart, None)
        picture = None
        if frame.index < among and spread(frame.index, count, among):
            picture = frame.image
            if picture is not None:
                firsts[frame.index] = picture
        if first is not None:
            picture = frame.image if picture is None else picture
            if picture is not None:
                yield first, picture


class Rate:
    """A constant frame rate with exact times: frame k is at floor(k / fps) in ns."""

    def __init__(self, fps: Fraction) -> None:
        self.fps = fps
        self.frame_ns = max(1, round(NANOS / fps))

    def time_ns(self, index: int) -> int:
        """The time of a frame since the first, in ns."""
        return index * NANOS * self.fps.denominator // self.fps.numerator


def parse_fps(fps: float | Fraction | str) -> Fraction:
    """A frame rate as an exact fraction: ``25``, ``29.97``, ``30000/1001``.

    Raises:
        UsageError: it is not a number over 0.
    """
    try:
        exact = (
            Fraction(fps)
            if not isinstance(fps, float) or math.isfinite(fps)
            else Fraction(0)
        )
        exact = exact.limit_denominator(_MAX_DENOMINATOR)
    except (ValueError, ZeroDivisionError, OverflowError):
        exact = Fraction(0)
    if not 0 < exact <= _MAX_FPS:
        raise UsageError(
            f"--fps {fps}: must be a number of frames per second over 0 and at most"
            f" {_MAX_FPS}"
        )
    return exact


def rate_or_assumed(fps: Fraction | None, notes: list[str]) -> Rate:
    """The given rate, or the assumed one with a note that says so."""
    if fps is None:
        notes.append(
            f"no frame rate is known: assuming {ASSUMED_FPS} frames per second; say it with"
            " --fps"
        )
    return Rate(fps or ASSUMED_FPS)


def detections_of(
    frame: int,
    width: int,
    height: int,
    boxes: Sequence[Box],
    scores: Sequence[float],
    labels: Sequence[str] = (),
) -> Detections:
    """The detections of a frame that come without pixels."""
    count = len(boxes)
    named = list(labels) or [""] * count
    return Detections(
        frame=frame,
        width=width,
        height=height,
        boxes=list(boxes),
        scores=list(scores),
        labels=named,
        ellipses=[None] * count,
        blobs=[NO_BLOB] * count,
    )


def fitted(image: Image, width: int, height: int) -> Image:
    """A picture in the recording's size: itself, or scaled."""
    if image.shape[:2] == (height, width):
        return image
    scaled = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
    return np.asarray(scaled, np.uint8)


def outside(box: Box, width: float, height: float) -> bool:
    """Whether a box (x, y, w, h) shares no pixel with the picture."""
    x, y, w, h = box
    return x >= width or y >= height or x + w <= 0 or y + h <= 0


def spread(index: int, count: int, among: int) -> bool:
    """Whether to take item ``index`` where ``count`` of ``among`` are wanted, evenly spaced, the
    first included.

    >>> [i for i in range(10) if spread(i, 4, 10)]
    [0, 3, 5, 8]
    >>> [i for i in range(3) if spread(i, 4, 3)]
    [0, 1, 2]
    """
    return index == 0 or index * count // among != (index - 1) * count // among
