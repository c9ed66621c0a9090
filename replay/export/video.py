"""Video: the recorded pictures with the scene drawn into them, H.264 in an MP4."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.channels import NANOS
from recorders.clock import seconds
from recorders.errors import RecordingError, UsageError
from recorders.messages import Event
from recorders.pictures import Image
from recorders.told_times import clock_text
from replay.draw import DrawOptions, Overlay, draw_frame, title_card
from replay.export.output import whole_file

Progress = Callable[[str, int], None]
CLOCK = 90_000
THREADS = 2
GROUND = 96
CRF = "23"
TITLE_S = 3.0
"""How long a title stands in place of a longer gap,"""
GAP_STEPS = 10
"""which is longer than so many steps between frames."""


@dataclass(frozen=True)
class VideoOptions:
    """What is drawn and which part of the recording.

    Attributes:
        draw: what to leave out, how large.
        from_ns: first log time, None: the beginning.
        to_ns: end, excluded, None: the end.
        events_s: how long an event's text stays, in seconds of the recording.
        max_events: how many stay at most.
        quiet: kinds of events that are not written: the box shows a change of mode by itself.
        size: (width, height) of the ground where the log holds neither pictures nor their size.
    """

    draw: DrawOptions = field(default_factory=DrawOptions)
    from_ns: int | None = None
    to_ns: int | None = None
    events_s: float = 2.0
    max_events: int = 5
    quiet: tuple[str, ...] = ("mode_changed",)
    size: tuple[int, int] | None = None


def write_video(
    log: AnnotatedLog,
    out: str | Path,
    options: VideoOptions | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> int:
    """Write the overlaid video; every picture stays as long as it did in the recording. Returns
    the frames written.

    Where nothing was recorded for longer than `TITLE_S`, a title of that length says so instead.

    A recording without pictures is drawn on a plain ground.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: the log is damaged, or has no frame in the span.
        UsageError: there are neither pictures nor a size.
    """
    options = options or VideoOptions()
    with whole_file(out, force=force) as file:
        encoder: Encoder | None = None
        try:
            for time_ns, image in overlaid(log, options):
                if encoder is None:
                    encoder = Encoder(file.part, image, time_ns)
                encoder.add(image, time_ns)
                if progress is not None:
                    progress("drawing", encoder.frames - 1)
            if encoder is None:
                raise RecordingError("no frame in the span to draw", log.path)
            encoder.finish()
        finally:
            if encoder is not None:
                encoder.close()
        return encoder.frames


def overlaid(log: AnnotatedLog, options: VideoOptions) -> Iterator[tuple[int, Image]]:
    """Log time and drawn picture of every frame of the span."""
    pictures = _pictures(log, options)
    recent: deque[Event] = deque(maxlen=options.max_events)
    for frame in log.frames():
        if options.to_ns is not None and frame.time_ns >= options.to_ns:
            return
        recent.extend(
            event
            for event in frame.events
            if event.kind not in options.quiet and options.draw.tells(event)
        )
        while recent and frame.time_ns - recent[0].time_ns > options.events_s * NANOS:
            recent.popleft()
        if options.from_ns is None or frame.time_ns >= options.from_ns:
            overlay = frame_overlay(log, frame, list(recent))
            yield frame.time_ns, draw_frame(pictures(frame.time_ns), overlay, options.draw)


def frame_overlay(
    log: AnnotatedLog,
    frame: AnnotatedFrame,
    events: list[Event] | None = None,
    zone: str = "UTC",
) -> Overlay:
    """What `draw_frame` draws of an annotated frame; ``events`` in place of the frame's own. The
    clock's time stands beside the seconds where there is a clock.
    """
    seconds = (frame.time_ns - log.start_ns) / NANOS
    title = "   ".join(
        x
        for x in (
            f"frame {frame.index}",
            f"{seconds:.2f} s",
            clock_text(frame.time_ns, zone),
            log.tracker,
        )
        if x
    )
    shown = frame.events if events is None else events
    return Overlay(
        frame.tracks,
        frame.relations,
        frame.groups,
        shown,
        frame.regions,
        log.membership(frame),
        title,
    )


def _pictures(log: AnnotatedLog, options: VideoOptions) -> Callable[[int], Image]:
    """The picture of a log time; asked for in rising order."""
    if not log.has_pictures:
        size = log.size() or options.size
        if size is None:
            raise UsageError(
                f"{log.path}: holds neither pictures nor their size; give --size WxH"
            )
        ground = np.full((size[1], size[0], 3), GROUND, np.uint8)
        return lambda _: ground
    pictures = log.pictures()
    latest: list[tuple[int, Any]] = []

    def at(time_ns: int) -> Image:
        while not latest or latest[0][0] < time_ns:
            latest[:] = [next(pictures, (-1, None))]
            if latest[0][1] is None:
                break
        if latest[0][0] != time_ns:
            raise RecordingError(f"no picture for the frame at {time_ns} ns", log.path)
        picture: Image = latest[0][1]()
        return picture

    return at


class Encoder:
    """H.264 in MP4, at the frames' own times.

    Args:
        path: the file.
        first: the first picture, which says how large they are.
        start_ns: log time of the clip's beginning.
        preset: x264's, quick or small.
    """

    def __init__(
        self, path: Path, first: Image, start_ns: int, preset: str = "veryfast"
    ) -> None:
        import av

        self._av = av
        self._path = path
        self.frames = 0
        self._start_ns = start_ns
        self._last = -1
        self._image, self._last_ns = first, start_ns
        self._step_ns = NANOS
        # 4:2:0 colours need even sides: the last odd row or column is left out.
        self._height, self._width = first.shape[0] // 2 * 2, first.shape[1] // 2 * 2
        self._container: Any = av.open(
            str(path), "w", format="mp4", options={"movflags": "faststart"}
        )
        # x264's macroblock tree reads what nobody wrote where the height is no multiple of 16: the
        # same pictures would give other bytes the next time.
        stream: Any = self._container.add_stream(
            "libx264",
            rate=25,
            options={"preset": preset, "crf": CRF, "x264-params": "mbtree=0"},
        )
        stream.width, stream.height, stream.pix_fmt = self._width, self._height, "yuv420p"
        stream.codec_context.time_base = Fraction(1, CLOCK)
        stream.codec_context.thread_count = THREADS
        self._stream = stream

    def add(self, image: Image, time_ns: int) -> None:
        """The next picture."""
        if self.frames:
            length = time_ns - self._last_ns
            if length > max(TITLE_S * NANOS, GAP_STEPS * self._step_ns):
                self._bridge(length)
            self._step_ns = min(self._step_ns, length)
        self._image, self._last_ns = image, time_ns
        self._put(image, time_ns)
        self.frames += 1

    def _put(self, image: Image, time_ns: int) -> None:
        pixels = np.ascontiguousarray(image[: self._height, : self._width])
        frame: Any = self._av.VideoFrame.from_ndarray(pixels, format="bgr24")
        frame.time_base = Fraction(1, CLOCK)
        # Two frames closer than the clock's tick still need times of their own.
        self._last = max(self._last + 1, (time_ns - self._start_ns) * CLOCK // NANOS)
        frame.pts = self._last
        self._encode(frame)

    def _bridge(self, length_ns: int) -> None:
        """Before the next picture, so long after the last one: a title that nothing was recorded."""
        shown_ns = min(length_ns, round(TITLE_S * NANOS))
        after_ns = self._last_ns + (length_ns - shown_ns)
        self._start_ns += length_ns - shown_ns
        title = title_card(self._image, f"Nothing was recorded for {seconds(length_ns)}")
        # The picture before keeps its usual time.
        first_ns = after_ns + min(self._step_ns, shown_ns // 2)
        self._put(title, first_ns)

    def finish(self) -> None:
        """Write what the encoder still holds."""
        self._encode(None)

    def _encode(self, frame: Any) -> None:
        try:
            packets = self._stream.encode(frame)
        except self._av.error.ExternalError as error:
            raise RecordingError(
                f"the H.264 encoder failed on pictures of {self._width}x{self._height}: too"
                f" small, too large, or too little memory ({error})",
                self._path,
            ) from error
        self._container.mux(packets)

    def close(self) -> None:
        """Write the container's end."""
        self._container.close()
