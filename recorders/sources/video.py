"""Video files, read with FFmpeg's libraries through PyAV: true presentation times, one decoding
thread.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

from recorders.errors import LimitError, SourceError
from recorders.files import existing_file, sha256
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import FrameConverter, check_size
from recorders.sources.source import (
    NANOS,
    Image,
    Rate,
    SourceFrame,
    rate_or_assumed,
    spread,
)

if TYPE_CHECKING:
    import av

# Only containers that hold their pictures themselves: playlists would reach for other files, and
# FFmpeg draws plain text as video where nothing forbids it.
_CONTAINERS = "avi,mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,mpeg,mpegvideo,mpegts,h264,hevc,m4v,mjpeg,flv,asf,ogg,dv,mxf,gif,nut,ivf"  # noqa: E501
_PROBED_PACKETS = 64


class VideoSource:
    """A video file.

    Times are the file's presentation times, counted from the first frame. A container that stores
    none (AVI with B-frames) and ``fps`` both give a constant rate. Pictures are turned upright as
    the file asks.

    Raises:
        SourceError: no such file, empty, not a video, no picture in it.
        LimitError: the pictures are over the limits.
    """

    name = "video"
    has_images = True
    stills = False
    has_detections = False

    def __init__(
        self, path: Path, fps: Fraction | None = None, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.path = existing_file(path)
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._limits = limits
        with self._open() as container:
            stream = self._stream(container)
            self._turns = 0
            self.width, self.height = stream.width, stream.height
            if not self.width or not self.height:
                limit = (
                    f"the limit of {limits.max_picture_pixels} pixels (max_picture_pixels)"
                )
                raise LimitError(
                    f"the video's pictures have no known size, or one over {limit}", path
                )
            check_size(self.width, self.height, path, limits)
            self.frame_count: int | None = stream.frames or None
            self._announced = stream.frames
            nominal = stream.guessed_rate or stream.average_rate
            timed = fps is None and _has_times(container, stream)
            self._rate: Rate | None = None
            if fps is None and not nominal:
                self._rate = rate_or_assumed(None, self.notes)
            elif not timed:
                self._rate = Rate(fps or Fraction(nominal))
            self.frame_ns = (
                self._rate.frame_ns if self._rate else Rate(Fraction(nominal)).frame_ns
            )
            if self.frame_count is None and stream.duration and nominal:
                self.frame_count = round(stream.duration * stream.time_base * nominal)
        self._look_at_first()

    def _look_at_first(self) -> None:
        with self._open() as container:
            for frame in self._decoded(container, _Trouble()):
                self._turns = round(frame.rotation / 90) % 4
                if self._turns % 2:
                    self.width, self.height = self.height, self.width
                return
        raise SourceError("no picture of the video can be decoded", self.path)

    def _open(self) -> Any:
        import av

        options = {
            "format_whitelist": _CONTAINERS,
            "max_pixels": str(self._limits.max_picture_pixels),
        }
        try:
            return av.open(f"file:{self.path.resolve()}", options=options)
        except (av.error.FFmpegError, ValueError) as error:
            raise SourceError(
                f"not a video that can be read ({_reason(error)})", self.path
            ) from error

    def _stream(self, container: Any) -> Any:
        if not container.streams.video:
            raise SourceError("holds no video stream", self.path)
        stream = container.streams.video[0]
        if stream.codec_context is None:
            raise SourceError("its video stream has a codec that is not known", self.path)
        stream.codec_context.thread_count = 1
        stream.codec_context.options = {"max_pixels": str(self._limits.max_picture_pixels)}
        return stream

    def _decoded(
        self, container: Any, trouble: _Trouble, keys_only: bool = False
    ) -> Iterator[av.VideoFrame]:
        import av

        stream = self._stream(container)
        if keys_only:
            stream.codec_context.skip_frame = "NONKEY"
        size = (stream.width, stream.height)
        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets, None)
                if packet is None:
                    return
                frames = packet.decode()
            except (av.error.EOFError, StopIteration):
                return
            except (av.error.FFmpegError, ValueError) as error:
                check_size(
                    stream.codec_context.width,
                    stream.codec_context.height,
                    self.path,
                    self._limits,
                )
                if not trouble.packet(_reason(error)):
                    return
                continue
            for frame in frames:
                if (frame.width, frame.height) != size:
                    now = (
                        f"{frame.width} x {frame.height}, it began with {size[0]} x"
                        f" {size[1]}"
                    )
                    raise SourceError(
                        f"the pictures change size: after frame {trouble.frames} they are"
                        f" {now}",
                        self.path,
                    )
                trouble.frame(frame.is_corrupt)
                yield frame

    def frames(self) -> Iterator[SourceFrame]:
        """All frames in the order of their presentation."""
        self.losses.clear()
        trouble = _Trouble()
        mended = 0
        with self._open() as container:
            time_base = container.streams.video[0].time_base
            to_bgr = FrameConverter(self._turns)
            first, last = 0, -1
            for index, frame in enumerate(self._decoded(container, trouble)):
                if self._rate is not None:
                    now = self._rate.time_ns(index)
                elif frame.pts is None:
                    now = last + self.frame_ns if index else 0
                else:
                    stamp = int(
                        frame.pts * time_base.numerator * NANOS // time_base.denominator
                    )
                    first = first if index else stamp
                    now = stamp - first
                if now <= last:
                    now = last + self.frame_ns
                    mended += 1
                last = now
                yield SourceFrame(index, now, _loader(to_bgr, frame))
        self._sum_up(trouble, mended)

    def _sum_up(self, trouble: _Trouble, mended: int) -> None:
        if mended:
            note = (
                f"{mended} frames had times that did not increase; they follow their"
                " predecessors by one frame time"
            )
            if note not in self.notes:
                self.notes.append(note)
        self.losses += trouble.lines()
        if trouble.frames < self._announced:
            self.losses.append(
                f"the file announces {self._announced} frames, {trouble.frames} could be"
                " read"
            )
        self.frame_count = trouble.frames

    def sample(self, count: int) -> Iterator[Image]:
        """About ``count`` pictures spread over the video: key frames where there are enough of
        them.
        """
        with self._open() as container:
            stream = self._stream(container)
            keys = total = 0
            for packet in container.demux(stream):
                keys += packet.is_keyframe and packet.size > 0
                total += packet.size > 0
        keys_only = keys >= count
        among = keys if keys_only else total
        to_bgr = FrameConverter(self._turns)
        with self._open() as container:
            for index, frame in enumerate(self._decoded(container, _Trouble(), keys_only)):
                if spread(index, count, among):
                    yield to_bgr(frame)

    def digests(self) -> list[tuple[str, str]]:
        """The video's SHA-256."""
        return [(self.path.name, sha256(self.path))]


class _Trouble:
    """Counts what a video's decoding met: frames, damaged ones, packets that gave none."""

    _MOST = 10_000

    def __init__(self) -> None:
        self.frames = 0
        self._damaged = 0
        self._first_damaged = 0
        self._packets = 0
        self._first: tuple[int, str] = (0, "")

    def packet(self, reason: str) -> bool:
        """Note a packet that cannot be decoded; False where there are so many that reading on is
        pointless.
        """
        if not self._packets:
            self._first = (self.frames, reason)
        self._packets += 1
        return self._packets < self._MOST

    def frame(self, corrupt: bool) -> None:
        """Note a decoded frame."""
        if corrupt:
            self._first_damaged = self._first_damaged if self._damaged else self.frames
            self._damaged += 1
        self.frames += 1

    def lines(self) -> list[str]:
        """One line for each kind of trouble."""
        found = []
        if self._packets:
            after, reason = self._first
            found.append(
                f"{self._packets} packets of the video cannot be decoded, the first after"
                f" frame {after} ({reason})"
            )
        if self._damaged:
            found.append(
                f"{self._damaged} frames of the video are damaged, the first is frame"
                f" {self._first_damaged}"
            )
        return found


def _loader(to_bgr: FrameConverter, frame: Any) -> Callable[[], Image]:
    return lambda: to_bgr(frame)


def _has_times(container: Any, stream: Any) -> bool:
    """Whether packets carry presentation times of their own.

    Where frames are stored in another order than they are shown (B-frames), true presentation
    times cannot grow from packet to packet: those that do are the container's packet count.
    """
    stamps = []
    for packet in container.demux(stream):
        if packet.size:
            stamps.append(packet.pts)
        if len(stamps) == _PROBED_PACKETS:
            break
    if not stamps or any(stamp is None for stamp in stamps):
        return False
    growing = all(a <= b for a, b in itertools.pairwise(stamps))
    return not (growing and stream.codec_context.has_b_frames)


def _reason(error: Exception) -> str:
    return str(getattr(error, "strerror", None) or error)
