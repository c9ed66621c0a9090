"""Video files, read with FFmpeg's libraries through PyAV: true presentation times, one decoding
thread.
"""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Iterator
from fractions import Fraction
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from recorders.clock import Clock
from recorders.errors import LimitError, SourceError
from recorders.files import existing_file, sha256
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import FrameConverter, Image, check_size
from recorders.sources import containers
from recorders.sources.source import (
    NANOS,
    Rate,
    SourceFrame,
    fitted,
    rate_or_assumed,
    spread,
)
from recorders.stills import upright

if TYPE_CHECKING:
    import av

EXPLODE = {"err_detect": "explode"}
_PROBED_PACKETS = 64
_SLACK_S = 0.1


class VideoSource:
    """A video file.

    Times are the file's presentation times, counted from the first frame. A container that stores
    none (AVI with B-frames, elementary streams) and ``fps`` both give a constant rate. Pictures are
    turned and mirrored as the file asks; where they change their size they are scaled to the
    first's.

    Args:
        path: the file.
        fps: a constant rate.
        limits: what a picture may ask for.
        stream: which of several video streams, from 0; None: the first, and the others are told.

    Raises:
        SourceError: no such file, empty, not a video, no picture in it.
        UsageError: no such stream.
        LimitError: the pictures are over the limits.
    """

    name = "video"
    has_images = True
    stills = False
    has_detections = False

    def __init__(
        self,
        path: Path,
        fps: Fraction | None = None,
        limits: Limits = DEFAULT_LIMITS,
        stream: int | None = None,
    ) -> None:
        self.path = existing_file(path)
        self._chosen = stream
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._limits = limits
        self._strict = False
        with self._open() as container:
            found = containers.streams(container, path)
            self._others = "" if len(found) == 1 or stream is not None else _others(found)
            self._open_stream(container, fps)
        with self._open() as container:
            self._strict = _tells_damage(container, self._stream(container))
        self._look_at_first()

    def _open_stream(self, container: Any, fps: Fraction | None) -> None:
        """Size, rate and length, as the container says them."""
        stream, path, limits = self._stream(container), self.path, self._limits
        self._orientation = 1
        self.width, self.height = stream.width, stream.height
        if not self.width or not self.height:
            limit = f"the limit of {limits.max_picture_pixels} pixels (max_picture_pixels)"
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
        elif fps is None and containers.is_elementary(container):
            self._rate = Rate(Fraction(nominal))
            self.notes.append(
                f"a bare stream without times: assuming {float(nominal):g} frames per second;"
                " say it with --fps"
            )
        elif not timed:
            self._rate = Rate(fps or Fraction(nominal))
        self.frame_ns = (
            self._rate.frame_ns if self._rate else Rate(Fraction(nominal)).frame_ns
        )
        if self.frame_count is None and stream.duration and nominal:
            self.frame_count = round(stream.duration * stream.time_base * nominal)
        self._stated_s = containers.stated_seconds(container, stream)
        aspect = containers.pixel_aspect(stream)
        if aspect:
            self.notes.append(aspect)

    def _look_at_first(self) -> None:
        with self._open() as container:
            for frame in self._decoded(container, _Trouble()):
                self._orientation = containers.orientation(frame)
                if self._orientation > 4:
                    self.width, self.height = self.height, self.width
                return
        raise SourceError("no picture of the video can be decoded", self.path)

    def _open(self) -> Any:
        import av

        options = {
            "format_whitelist": containers.CONTAINERS,
            # A clock that starts anew is a new segment, not a counter that ran over.
            "correct_ts_overflow": "0",
            "max_pixels": str(self._limits.max_picture_pixels),
        }
        try:
            return av.open(f"file:{self.path.resolve()}", options=options)
        except (av.error.FFmpegError, ValueError) as error:
            if containers.lacks_index(self.path):
                raise SourceError(
                    "the video's index (moov) is missing: its recording was cut off before"
                    " the end, where the index is written; the pictures are there, and tools"
                    " that rebuild it from a sound file of the same camera (untrunc) may save"
                    " them",
                    self.path,
                ) from error
            raise SourceError(
                f"not a video that can be read ({_reason(error)})", self.path
            ) from error

    def _stream(self, container: Any) -> Any:
        found = containers.streams(container, self.path)
        stream = containers.chosen(found, self._chosen, self.path)
        if stream.codec_context is None:
            raise SourceError("its video stream has a codec that is not known", self.path)
        stream.codec_context.thread_count = 1
        stream.codec_context.options = {"max_pixels": str(self._limits.max_picture_pixels)}
        if self._strict:
            stream.codec_context.options |= EXPLODE
        return stream

    def _decoded(
        self, container: Any, trouble: _Trouble, keys_only: bool = False
    ) -> Iterator[av.VideoFrame]:
        import av

        stream = self._stream(container)
        if keys_only:
            stream.codec_context.skip_frame = "NONKEY"
        packets = container.demux(stream)
        while True:
            try:
                packet = next(packets, None)
                if packet is None:
                    return
                trouble.seen(packet)
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
                trouble.frame(frame)
                yield frame

    def frames(self) -> Iterator[SourceFrame]:
        """All frames in the order of their presentation."""
        self.losses.clear()
        trouble = _Trouble()
        clock: Clock[Any] = Clock(self.frame_ns)
        scaled, first_scaled, last = 0, "", 0
        with self._open() as container:
            base = self._stream(container).time_base
            to_bgr = FrameConverter()
            decoded = self._decoded(container, trouble)
            stamped = (
                (_stamp_ns(frame.pts, base), (frame, trouble.between)) for frame in decoded
            )
            for index, (now, (frame, lost)) in enumerate(clock.times(stamped)):
                if self._rate is not None:
                    # A picture that cannot be decoded keeps its place.
                    now = self._rate.time_ns(index + lost)  # noqa: PLW2901
                if self._size_of(frame) != (self.width, self.height):
                    scaled += 1
                    first_scaled = first_scaled or _named(index, self._size_of(frame))
                last = now
                yield SourceFrame(index, now, partial(self._upright, to_bgr, frame))
        self._sum_up(trouble, clock, last)
        if scaled:
            self.losses.append(
                f"{scaled} pictures of another size were scaled to"
                f" {self.width}x{self.height}, the first is {first_scaled}"
            )

    def _size_of(self, frame: Any) -> tuple[int, int]:
        if self._orientation > 4:
            return frame.height, frame.width
        return frame.width, frame.height

    def _upright(self, to_bgr: FrameConverter, frame: Any) -> Image:
        check_size(frame.width, frame.height, self.path, self._limits)
        image = upright(to_bgr(frame), self._orientation)
        return fitted(np.ascontiguousarray(image), self.width, self.height)

    def _sum_up(self, trouble: _Trouble, clock: Clock[Any], last_ns: int) -> None:
        if self._rate is None:
            self.notes += [note for note in clock.notes() if note not in self.notes]
        self.losses += trouble.lines()
        announced = self._announced - trouble.hidden
        if trouble.frames < announced:
            self.losses.append(
                f"the file announces {announced} frames, {trouble.frames} could be read"
            )
        elif self._stated_s is not None and self._rate is None and not clock.joined:
            # Some files state how long they are, some when they end.
            end_s = (max(last_ns, trouble.latest_ns) + 2 * self.frame_ns) / NANOS
            whole = self._announced or trouble.starts_in_the_middle
            if self._stated_s > end_s + _SLACK_S and not whole:
                self.losses.append(
                    f"the file announces {self._stated_s:.2f} s, its pictures end after"
                    f" {last_ns / NANOS:.2f} s: it was cut short"
                )
        if self._others:
            self.losses.append(self._others)
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
        to_bgr = FrameConverter()
        with self._open() as container:
            for index, frame in enumerate(self._decoded(container, _Trouble(), keys_only)):
                if spread(index, count, among):
                    yield self._upright(to_bgr, frame)

    def pairs(self, count: int, apart: int) -> Iterator[tuple[Image, Image]]:
        """About ``count`` pictures spread over the video, each with the one ``apart`` frames
        later.
        """
        with self._open() as container:
            keys = total = 0
            for packet in container.demux(self._stream(container)):
                keys += packet.is_keyframe and packet.size > 0
                total += packet.size > 0
        to_bgr = FrameConverter()
        with self._open() as container:
            frames = (
                self._after_keys(container, count, keys, apart + 1)
                if keys >= count
                else self._decoded(container, _Trouble())
            )
            window: deque[Any] = deque(maxlen=apart + 1)
            for index, frame in enumerate(frames):
                window.append(frame)
                first = index - apart
                if keys >= count:
                    taken = index % (apart + 1) == apart
                else:
                    taken = first >= 0 and spread(first, count, max(1, total - apart))
                if taken:
                    yield self._upright(to_bgr, window[0]), self._upright(to_bgr, frame)

    def _after_keys(
        self, container: Any, count: int, keys: int, length: int
    ) -> Iterator[av.VideoFrame]:
        """Of ``count`` key frames the ``length`` frames from each on; the rest is not decoded."""
        import av

        stream = self._stream(container)
        index = -1
        run: list[av.VideoFrame] = []
        wanted = False
        start: int | None = None
        for packet in container.demux(stream):
            if packet.is_keyframe and packet.size:
                index += 1
                if not wanted and spread(index, count, keys):
                    wanted, run, start = True, [], packet.pts
                    stream.codec_context.flush_buffers()
            if not wanted:
                continue
            try:
                frames = packet.decode()
            except (av.error.FFmpegError, ValueError):
                frames, run, wanted = [], [], False
            run += [
                frame
                for frame in frames
                if start is None or frame.pts is None or frame.pts >= start
            ]
            if len(run) >= length:
                yield from run[:length]
                wanted = False

    def digests(self) -> list[tuple[str, str]]:
        """The video's SHA-256."""
        return [(self.path.name, sha256(self.path))]


class _Trouble:
    """Counts what a video's decoding met: frames, damaged ones, packets that gave none.

    Attributes:
        between: packets behind the first picture that gave none.
    """

    _MOST = 10_000

    def __init__(self) -> None:
        self.frames = 0
        self._damaged = 0
        self._first_damaged = 0
        self._packets = 0
        self.between = 0
        self._first: tuple[int, str] = (0, "")
        self._early = 0
        self.latest_ns = 0
        self._key = False
        self.hidden = 0

    def seen(self, packet: Any) -> None:
        """Note a packet before it is decoded: those that an edit list hides, and those before the
        first key frame, which nothing can be made of.
        """
        self.hidden += bool(packet.is_discard)
        self._key = self._key or packet.is_keyframe
        self._early += not self._key and packet.size > 0

    def packet(self, reason: str) -> bool:
        """Note a packet that cannot be decoded; False where there are so many that reading on is
        pointless.
        """
        if not self._packets:
            self._first = (self.frames, reason)
        self._packets += 1
        self.between += self.frames > 0
        return self._packets < self._MOST

    @property
    def starts_in_the_middle(self) -> bool:
        """Packets came before the first key frame."""
        return self._early > 0

    def frame(self, frame: Any) -> None:
        """Note a decoded frame."""
        if frame.pts is not None and frame.time_base is not None:
            self.latest_ns = max(self.latest_ns, int(frame.pts * frame.time_base * NANOS))
        if frame.is_corrupt:
            self._first_damaged = self._first_damaged if self._damaged else self.frames
            self._damaged += 1
        self.frames += 1

    def lines(self) -> list[str]:
        """One line for each kind of trouble."""
        found = []
        if self._early:
            found.append(
                f"{self._early} packets of the video before its first key frame: it starts in"
                " the middle"
            )
            self._packets = max(0, self._packets - self._early)
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


def _tells_damage(container: Any, stream: Any) -> bool:
    """Whether the decoder may be told to refuse what is damaged: of MJPEG it paints over the rest
    of a picture else; a camera whose every picture is a little off is left as it is.
    """
    import av

    if stream.codec_context.name != "mjpeg":
        return False
    stream.codec_context.options |= EXPLODE
    for packet in itertools.islice(container.demux(stream), _PROBED_PACKETS):
        try:
            if packet.decode():
                return True
        except (av.error.FFmpegError, ValueError):
            continue
    return False


def _stamp_ns(pts: int | None, base: Fraction) -> int | None:
    return None if pts is None else int(pts * base.numerator * NANOS // base.denominator)


def _named(index: int, size: tuple[int, int]) -> str:
    return f"frame {index} of {size[0]}x{size[1]}"


def _others(found: list[Any]) -> str:
    return (
        f"{len(found) - 1} of {len(found)} video streams ({containers.described(found)}):"
        " --stream N chooses one"
    )


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
