"""From a source's frames to bytes, in order: decoding, segmentation and encoding run side by
side.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction

from recorders.errors import SceneTraceError
from recorders.left_out import LeftOut
from recorders.messages import Detections, SceneChange
from recorders.pictures import Image, VideoEncoder, encode_jpeg, encode_mask, encode_png
from recorders.recording.finding import Finder
from recorders.sources import Source, SourceFrame
from recorders.sources.prefetch import read_ahead
from recorders.sources.source import NANOS, PictureError

_DEPTH = 4
_DEPTH_WITHOUT_PICTURES = 256


def segment_of(time_ns: int, segment_ns: int | None) -> int:
    """The number of the log that a frame of this time goes into."""
    return 0 if segment_ns is None else time_ns // segment_ns


@dataclass(frozen=True, slots=True)
class Encoded:
    """One frame as it will be written."""

    index: int
    time_ns: int
    picture: tuple[bytes, str] | None
    mask: bytes | None
    detections: Detections
    changes: tuple[SceneChange, ...] = ()


@dataclass(frozen=True, slots=True)
class _Seen:
    """A frame's picture and mask as they will be written."""

    index: int
    time_ns: int
    picture: tuple[bytes, str] | None
    mask: bytes | None
    changes: tuple[SceneChange, ...]


def encoded(
    source: Source, finder: Finder, codec: str | None, segment_ns: int | None = None
) -> Generator[Encoded]:
    """The source's frames, looked through and encoded, in order; a video begins anew with every
    ``segment_ns``.
    """
    encoder = _PictureEncoder(source, codec, segment_ns)
    decode = finder.sees or encoder.decodes
    depth = _DEPTH if source.has_images else _DEPTH_WITHOUT_PICTURES
    failures: list[SceneTraceError] = []
    ahead = _until_failure(read_ahead(source.frames(), depth, decode), failures)
    # One worker each: what detects and what encodes take the frames in their order.
    detecting, encoding = (
        ThreadPoolExecutor(1, "scenetrace-detect"),
        ThreadPoolExecutor(1, "scenetrace-encode"),
    )
    line = _Line()
    try:
        with closing(ahead) as frames:
            for frame in _decodable(frames, source, finder.sees, encoder.decodes):
                mask, detect = finder.begin(frame)
                line.found.append(
                    detecting.submit(detect).result if finder.sees else detect
                )
                changes = finder.changes()
                line.seen.append(encoding.submit(encoder.encode, frame, mask, changes))
                if len(line.seen) > _DEPTH + finder.behind:
                    yield line.next()
        line.found.append(detecting.submit(finder.finish).result)
        while line.seen:
            yield line.next()
    finally:
        detecting.shutdown(cancel_futures=True)
        encoding.shutdown(cancel_futures=True)
    if failures:
        raise failures[0]


class _Line:
    """Frames that wait for their pictures to be encoded, and for their detections to be known.

    Attributes:
        seen: of each frame its picture and mask, encoded.
        found: what gives the detections that were known with each frame.
    """

    def __init__(self) -> None:
        self.seen: deque[Future[_Seen]] = deque()
        self.found: deque[Callable[[], list[Detections]]] = deque()
        self._known: deque[Detections] = deque()

    def next(self) -> Encoded:
        """The oldest frame, whole."""
        while not self._known:
            self._known.extend(self.found.popleft()())
        seen, detections = self.seen.popleft().result(), self._known.popleft()
        return Encoded(
            seen.index, seen.time_ns, seen.picture, seen.mask, detections, seen.changes
        )


def _until_failure(
    frames: Generator[SourceFrame], failures: list[SceneTraceError]
) -> Generator[SourceFrame]:
    """The frames up to where the source breaks, so that those before it are still recorded."""
    with closing(frames):
        try:
            yield from frames
        except SceneTraceError as error:
            failures.append(error)


def _decodable(
    frames: Iterator[SourceFrame], source: Source, needed: bool, decode: bool
) -> Iterator[SourceFrame]:
    """The frames without those whose picture is bad, where it is needed; they are counted in the
    source's losses. Where detections were given a frame may do without its picture.
    """
    bad = LeftOut()
    for frame in frames:
        if decode or needed:
            try:
                missing = frame.image is None
            except PictureError as error:
                bad.note(error.what, error.where)
                frame.without_picture()
                missing = True
            if missing and (needed or frame.detections is None):
                continue
        yield frame
    source.losses.extend(bad.lines())


class _PictureEncoder:
    """Pictures and masks to bytes, one after the other (H.264 builds on the picture before)."""

    def __init__(
        self, source: Source, codec: str | None, segment_ns: int | None = None
    ) -> None:
        self._source = source
        self._codec = codec
        self._segment_ns = segment_ns
        self._segment = 0
        self.decodes = codec == "h264" or (
            codec != "none" and source.has_images and not source.stills
        )
        self._video = self._new_video() if codec == "h264" else None

    def _new_video(self) -> VideoEncoder:
        source = self._source
        return VideoEncoder(source.width, source.height, Fraction(NANOS, source.frame_ns))

    def encode(
        self,
        frame: SourceFrame,
        mask: Image | None,
        changes: tuple[SceneChange, ...] = (),
    ) -> _Seen:
        """One frame's bytes."""
        bits = None if mask is None else encode_mask(mask)
        return _Seen(frame.index, frame.time_ns, self._picture(frame), bits, changes)

    def _picture(self, frame: SourceFrame) -> tuple[bytes, str] | None:
        if self._codec == "none" or not frame.has_picture:
            return None
        if (
            frame.encoded is not None
            and frame.format is not None
            and self._codec in (None, frame.format)
        ):
            return frame.encoded, frame.format
        image = frame.image
        assert image is not None
        if self._video is not None:
            segment = segment_of(frame.time_ns, self._segment_ns)
            if segment != self._segment:
                self._segment, self._video = segment, self._new_video()
            return self._video.encode(image), "h264"
        return (
            (encode_png(image), "png")
            if self._codec == "png"
            else (encode_jpeg(image), "jpeg")
        )
