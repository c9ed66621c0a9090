"""Live streams as a source: cameras over the network, devices, pipes.

The first seconds are looked through before anything is recorded (what stands still then is
background), and recorded all the same. Frames are read once.
"""

from __future__ import annotations

import hashlib
import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from recorders.clock import Gaps, nominal_ns
from recorders.errors import LimitError, RecordingError, SourceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import FrameConverter, Image, check_size
from recorders.sources.live_feed import (
    MOST_HELD_BYTES,
    SCHEMES,
    Codec,
    Feed,
    Packet,
    reason_of,
)
from recorders.sources.source import (
    ASSUMED_FPS,
    NANOS,
    Rate,
    SourceFrame,
    fitted,
    rate_or_assumed,
    spread,
)

LOOK_NS = 15 * NANOS
"""How much of a stream is looked through before it is recorded."""
_FIRST_PACKETS = 24
_JUMP_NS = 2 * NANOS
_MOST_DELAYED = 64


def is_live(word: str | Path) -> bool:
    """Whether a source is a live one: a URL, a camera of this computer, ``-``.

    >>> [is_live(w) for w in ("rtsp://host/cam", "-", "/dev/video0", "walk.mp4")]
    [True, True, True, False]
    """
    text = str(word)
    return text == "-" or text.startswith("/dev/video") or "://" in text


def check_address(text: str) -> None:
    """Hold an address to what can be opened.

    Raises:
        UsageError: another kind of address.
    """
    scheme = re.match(r"[^:/]*", text)
    if "://" in text and (scheme is None or scheme[0] not in SCHEMES):
        raise UsageError(
            f"{text}: live sources are {'://, '.join(SCHEMES)}://, /dev/video0, or - for a pipe"
        )


class LiveSource:
    """A live stream of pictures; its frames can be read once.

    Times are the stream's own stamps on this computer's clock: a lost connection is a gap as long
    as it was. A pipe has its stamps alone; where it has none (a bare H.264 or MJPEG stream), the
    rate is assumed and said.

    Args:
        address: a URL, ``/dev/videoN``, or ``-`` for standard input.
        fps: the rate of a bare stream in a pipe.
        limits: what a picture may claim.
        stream: which of several streams of pictures, from 0.
        look_ns: how much is looked through before recording.

    Attributes:
        start_ns: when the first frame came, in ns since 1970; 0 of a pipe.

    Raises:
        SourceError: it cannot be reached, or no picture can be decoded.
        UsageError: no such kind of address, or ``fps`` for what has times of its own.
    """

    name = "live stream"
    has_images = True
    stills = False
    has_detections = False
    frame_count: int | None = None

    def __init__(
        self,
        address: str,
        fps: Any = None,
        limits: Limits = DEFAULT_LIMITS,
        stream: int | None = None,
        look_ns: int = LOOK_NS,
    ) -> None:
        check_address(address)
        self._feed = Feed(address, limits, stream)
        self._limits = limits
        self._look_ns = look_ns
        self._pipe = address == "-"
        self.path = Path("pipe" if self._pipe else self._feed.shown)
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._rate = self._rate_of(fps)
        self._held: list[Packet] = []
        self._held_bytes = 0
        self._began = False
        self._hash = hashlib.sha256()
        self._times = _Times(0)
        self._gaps = Gaps(0)
        self._damage = _Damage()
        self._scaled = 0
        self._said: list[str] = []
        self._tell: Callable[[str], None] | None = None
        self._untold: list[str] = []
        self._feed.tell = self._told
        self._feed.start()
        self._look_at_first()

    def _rate_of(self, fps: Any) -> Rate | None:
        """The constant rate of a pipe without times."""
        opened = self._feed.opened
        if not self._pipe and fps is not None:
            self._feed.stop()
            raise UsageError(
                f"--fps: {self._feed.shown} is live, its pictures have the times at which they"
                " come; --fps goes with files and pipes"
            )
        if fps is not None:
            return Rate(fps)
        if self._pipe and not opened.timed:
            return rate_or_assumed(None, self.notes)
        return None

    def _look_at_first(self) -> None:
        """Size, rate and start from the first packets."""
        taken = self._hold(lambda: len(self._held) >= _FIRST_PACKETS)
        stamps = sorted(self._stamp(packet) for packet in taken)
        nominal = None if self._rate else nominal_ns(stamps)
        self.frame_ns = (
            self._rate.frame_ns if self._rate else nominal or NANOS // ASSUMED_FPS
        )
        for image, _ in self._pictures(iter(taken), _Damage()):
            self.height, self.width = image().shape[:2]
            break
        else:
            self._feed.stop()
            raise SourceError("no picture of it can be decoded", self._feed.shown)
        self._times = _Times(self.frame_ns)
        self._gaps = Gaps(self.frame_ns)
        since = time.monotonic_ns() - stamps[0]
        self.start_ns = 0 if self._pipe else max(0, time.time_ns() - since)

    def listen(self, tell: Callable[[str], None]) -> None:
        """Have what happens to the stream told, line by line, from whatever thread."""
        self._tell = tell
        while self._untold:
            tell(self._untold.pop(0))

    def _told(self, line: str) -> None:
        if self._tell is None:
            self._untold.append(line)
        else:
            self._tell(line)

    def stop(self) -> None:
        """End the stream: what has come is still given out as frames."""
        waiting = self._feed.waiting
        if waiting > NANOS // self.frame_ns:
            self._told(
                f"{self._feed.shown}: ending; {waiting} pictures that came before are still"
                " recorded"
            )
        self._feed.stop()

    # -- the first reading

    def _hold(self, enough: Callable[[], bool]) -> list[Packet]:
        """Packets from the start on, kept to be recorded, until there are enough."""
        while not enough() and self._held_bytes < MOST_HELD_BYTES:
            packet = next(self._feed.packets(), None)
            if packet is None:
                break
            self._held.append(packet)
            self._held_bytes += len(packet.data)
        return self._held

    def _looked(self) -> list[Packet]:
        if self._began:
            raise RuntimeError("a live stream is looked through before its frames are read")

        def enough() -> bool:
            length = self._stamp(self._held[-1]) - self._stamp(self._held[0])
            frames = len(self._held) * self.frame_ns
            return (frames if self._rate else length) >= self._look_ns

        if not enough():
            self._told(
                f"{self._feed.shown}: looking at the first {self._look_ns / NANOS:g} s, which"
                " are recorded as well"
            )
        return self._hold(enough)

    def sample(self, count: int) -> Iterator[Image]:
        """About ``count`` pictures spread over the first seconds."""
        held = self._looked()
        for index, (image, _) in enumerate(self._pictures(iter(held), _Damage())):
            if spread(index, count, len(held)):
                yield fitted(image(), self.width, self.height)

    def pairs(self, count: int, apart: int) -> Iterator[tuple[Image, Image]]:
        """About ``count`` pictures spread over the first seconds, each with the one ``apart``
        frames later.
        """
        held = self._looked()
        among = max(1, len(held) - apart)
        window: deque[Callable[[], Image]] = deque(maxlen=apart + 1)
        for index, (image, _) in enumerate(self._pictures(iter(held), _Damage())):
            window.append(image)
            first = index - apart
            if first >= 0 and spread(first, count, among):
                yield (
                    fitted(window[0](), self.width, self.height),
                    fitted(image(), self.width, self.height),
                )

    # -- the frames

    def frames(self) -> Iterator[SourceFrame]:
        """All frames, once.

        Raises:
            SourceError: they have been read before.
        """
        if self._began:
            raise SourceError("a live stream can be read once", self._feed.shown)
        self._began = True
        pictures = self._pictures(self._all(), self._damage)
        try:
            for index, (image, packet) in enumerate(pictures):
                if self._rate is not None:
                    now = self._rate.time_ns(index)
                else:
                    now = self._times.next(
                        self._stamp(packet), packet.arrived_ns, self._pipe
                    )
                self._gaps.step(index, now)
                size = packet.codec.width, packet.codec.height
                self._scaled += min(size) > 0 and size != (self.width, self.height)
                yield SourceFrame(index, now, partial(self._fitted, image))
        finally:
            self._feed.stop()

    def _fitted(self, image: Callable[[], Image]) -> Image:
        return fitted(image(), self.width, self.height)

    def _all(self) -> Iterator[Packet]:
        held, self._held = deque(self._held), []
        while held:
            packet = held.popleft()
            self._hash.update(packet.data)
            yield packet
        for packet in self._feed.packets():
            self._hash.update(packet.data)
            yield packet

    def _sum_up(self) -> None:
        """What is to be said of the stream so far, in place of what was said of it before."""
        feed, notes, losses = self._feed, [], []
        if feed.lost:
            times = "once" if feed.lost == 1 else f"{feed.lost} times"
            notes.append(f"the connection was lost {times}")
        if self._times.moved:
            notes.append(
                f"the stream's clock was set {self._times.moved} times; times go on by this"
                " computer's"
            )
        notes += self._gaps.lines()
        if feed.dropped:
            losses.append(
                f"{feed.dropped} pictures were dropped: recording could not keep up"
            )
        losses += self._damage.lines()
        if self._scaled:
            losses.append(
                f"{self._scaled} pictures of another size were scaled to"
                f" {self.width}x{self.height}"
            )
        said = set(self._said)
        self.notes[:] = [line for line in self.notes if line not in said] + notes
        self.losses[:] = [line for line in self.losses if line not in said] + losses
        self._said = [*notes, *losses]

    @staticmethod
    def _stamp(packet: Packet) -> int:
        return packet.arrived_ns if packet.stamp_ns is None else packet.stamp_ns

    def _pictures(
        self, packets: Iterator[Packet], damage: _Damage
    ) -> Iterator[tuple[Callable[[], Image], Packet]]:
        """The pictures in the order in which they are shown, each with its packet."""
        decoder: _Decoder | None = None
        for packet in packets:
            if decoder is None or decoder.codec is not packet.codec:
                if decoder is not None:
                    yield from decoder.rest(damage)
                decoder = _Decoder(packet.codec, self._feed.shown, self._limits)
            yield from decoder.decode(packet, damage)
        if decoder is not None:
            yield from decoder.rest(damage)

    def digests(self) -> list[tuple[str, str]]:
        """SHA-256 of the packets that were recorded so far; what befell them is in the notes then."""
        self._sum_up()
        return [(str(self.path), self._hash.hexdigest())]


class _Damage:
    """Packets and pictures that were damaged on their way."""

    def __init__(self) -> None:
        self.count = 0
        self.reason = ""

    def note(self, reason: str) -> None:
        """One more."""
        self.count += 1
        self.reason = self.reason or reason

    def lines(self) -> list[str]:
        """One line, if any."""
        if not self.count:
            return []
        return [f"{self.count} packets were damaged on their way ({self.reason})"]


class _Decoder:
    """Decodes the packets of one connection."""

    def __init__(self, codec: Codec, shown: str, limits: Limits) -> None:
        import av

        self.codec = codec
        self._shown = shown
        self._limits = limits
        self._to_bgr = FrameConverter()
        self._packets: dict[int, Packet] = {}
        self._latest: Packet | None = None
        self._count = 0
        context: Any = av.CodecContext.create(codec.name, "r")
        context.thread_count = 1
        context.options = {"max_pixels": str(limits.max_picture_pixels)}
        if codec.extradata:
            context.extradata = codec.extradata
        if codec.name == "rawvideo":
            context.width, context.height = codec.width, codec.height
            context.pix_fmt = codec.pix_fmt
        self._context = context

    def decode(
        self, packet: Packet, damage: _Damage
    ) -> Iterator[tuple[Callable[[], Image], Packet]]:
        """The pictures that this packet completes."""
        import av

        made = av.Packet(packet.data)
        made.pts = made.dts = self._count
        self._packets[self._count] = self._latest = packet
        # Of damaged packets no picture comes.
        self._packets.pop(self._count - _MOST_DELAYED, None)
        self._count += 1
        yield from self._given(made, damage)

    def rest(self, damage: _Damage) -> Iterator[tuple[Callable[[], Image], Packet]]:
        """What the decoder still holds back."""
        yield from self._given(None, damage)

    def _given(
        self, packet: Any, damage: _Damage
    ) -> Iterator[tuple[Callable[[], Image], Packet]]:
        import av

        try:
            frames = self._context.decode(packet)
        except (av.error.FFmpegError, ValueError) as error:
            if min(self._context.width, self._context.height) > 0:
                size = self._context.width, self._context.height
                check_size(*size, self._shown, self._limits)
            damage.note(reason_of(error))
            return
        for frame in frames:
            found = self._packets.pop(frame.pts, self._latest)
            if frame.is_corrupt:
                damage.note("a damaged picture")
                continue
            assert found is not None, "a picture comes of a packet"
            yield partial(self._picture, frame), found

    def _picture(self, frame: Any) -> Image:
        try:
            check_size(frame.width, frame.height, self._shown, self._limits)
        except LimitError:
            raise
        except RecordingError as error:
            raise SourceError(error.reason, self._shown) from error
        return np.ascontiguousarray(self._to_bgr(frame))


class _Times:
    """Stamps into times since the first frame that increase.

    A stream's clock that is set (back, or forward without that this computer's confirms it) goes
    on by this computer's. Outages are as long as they were.
    """

    def __init__(self, frame_ns: int) -> None:
        self._frame_ns = frame_ns
        self._offset: int | None = None
        self._last = 0
        self._arrived = 0
        self.moved = 0

    def next(self, stamp: int, arrived: int, pipe: bool) -> int:
        """The time of the next frame in ns."""
        if self._offset is None:
            self._offset = -stamp
        else:
            step = stamp + self._offset - self._last
            passed = 0 if pipe else max(0, arrived - self._arrived)
            sudden = not pipe and step > _JUMP_NS + 2 * passed
            if step < -_JUMP_NS or sudden:
                self.moved += 1
                self._offset += max(self._frame_ns, passed) - step
            elif step <= 0:
                self._arrived = arrived
                self._last += max(1, self._frame_ns // 4)
                return self._last
        self._last, self._arrived = stamp + self._offset, arrived
        return self._last
