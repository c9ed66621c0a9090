"""Packets of a live stream: read in a thread of their own into a bounded queue, through losses of
the connection.

What a connection gives is stamped by one clock: the stream's own stamps, laid on the computer's
monotonic clock by the first packet that had to be waited for (those before it lay in buffers).
"""

from __future__ import annotations

import errno
import re
import time
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from threading import Condition, Event, Thread
from typing import Any

from recorders.errors import SourceError
from recorders.limits import Limits
from recorders.sources.containers import CONTAINERS

NANOS = 1_000_000_000
MOST_HELD_BYTES = 64 << 20
"""Packets that wait to be decoded: some two minutes of H.264, ten seconds of large JPEGs."""
SCHEMES = ("rtsp", "rtsps", "rtmp", "udp", "rtp", "tcp", "srt", "http", "https")
_FORMATS = f"{CONTAINERS},rtsp,sdp,rtp,mpjpeg,live_flv,video4linux2,v4l2"
_PROTOCOLS = "rtsp,rtsps,rtp,udp,tcp,tls,http,https,httpproxy,srt,rtmp,rtmps,crypto,pipe"
_TIMEOUT_S = 10.0
_FIRST_WAIT_S, _LONGEST_WAIT_S = 0.5, 30.0
_WAITED_NS = 5_000_000
_MOST_UNPLACED = 256
_MOST_WITHOUT_KEY = 300
_WITHOUT_TIMES = frozenset({"h264", "hevc", "m4v", "mjpeg", "mpegvideo", "mpjpeg"})


@dataclass(frozen=True, slots=True)
class Codec:
    """What a decoder of one connection's packets needs."""

    name: str
    extradata: bytes | None
    pix_fmt: str | None
    width: int
    height: int


@dataclass(frozen=True, slots=True)
class Packet:
    """One packet.

    Attributes:
        data: its bytes.
        stamp_ns: on the monotonic clock, by the stream's stamps; None where it has none.
        arrived_ns: when it was read, on the monotonic clock.
        codec: of its connection; another object after each reconnection.
        is_key: decoding may start here.
    """

    data: bytes
    stamp_ns: int | None
    arrived_ns: int
    codec: Codec
    is_key: bool


@dataclass
class Opened:
    """A connection: FFmpeg's container, its stream of pictures, and what is known of it."""

    container: Any
    stream: Any
    codec: Codec
    timed: bool
    ends: bool = False
    seconds: float = 0.0


def safe_address(address: str) -> str:
    """The address without a name and a password.

    >>> safe_address("rtsp://admin:secret@10.0.0.7:554/stream1")
    'rtsp://10.0.0.7:554/stream1'
    """
    return re.sub(r"^([a-z][a-z0-9+.-]*://)[^/]*@", r"\1", address)


def connect(address: str, limits: Limits, stream: int | None = None) -> Opened:
    """Open a stream and find its pictures.

    Raises:
        SourceError: it cannot be reached, or holds no pictures.
    """
    import av

    from recorders.sources import containers

    pipe, device = address == "-", address.startswith("/dev/")
    options = {
        "format_whitelist": _FORMATS,
        "max_pixels": str(limits.max_picture_pixels),
        "analyzeduration": "2000000",
    }
    if not device:
        options["protocol_whitelist"] = _PROTOCOLS
    if address.startswith("rtsp"):
        options["rtsp_flags"] = "prefer_tcp"
    if address.startswith("udp"):
        options["fifo_size"] = "100000"
    shown = safe_address(address)
    try:
        container: Any = av.open(
            "pipe:0" if pipe else address,
            format="v4l2" if device else None,
            options=options,
            timeout=None if pipe else (_TIMEOUT_S, _TIMEOUT_S),
        )
    except (av.error.FFmpegError, ValueError, OSError) as error:
        if device:
            raise SourceError(_why_no_camera(error), shown) from error
        what = "no video that can be read" if pipe else "cannot be reached"
        raise SourceError(f"{what} ({reason_of(error)})", shown) from error
    try:
        found = containers.streams(container, Path(shown))
        chosen = containers.chosen(found, stream, Path(shown))
        context = chosen.codec_context
        if context is None:
            raise SourceError("its video stream has a codec that is not known", shown)
    except BaseException:
        container.close()
        raise
    codec = Codec(
        context.name, context.extradata, context.pix_fmt, context.width, context.height
    )
    timed = container.format.name not in _WITHOUT_TIMES
    seconds = (container.duration or 0) / 1e6
    return Opened(container, chosen, codec, timed, pipe, seconds)


def _why_no_camera(error: BaseException) -> str:
    """Why a camera of this computer cannot be opened, and what to do."""
    number = getattr(error, "errno", None)
    if number in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        there = sorted(str(path) for path in Path("/dev").glob("video*"))
        named = f"there are {', '.join(there)}" if there else "this computer shows none"
        return f"no such camera: {named} (`v4l2-ctl --list-devices` names them)"
    if number in (errno.EACCES, errno.EPERM):
        return (
            "not allowed to open it: the group `video` is (`sudo usermod -aG video $USER`)"
        )
    if number == errno.EBUSY:
        return "another program uses the camera: end that one first"
    if number in (errno.ENOTTY, errno.EINVAL):
        return (
            "no camera that gives pictures: one camera has several numbers, of which only some"
            " do (`v4l2-ctl --list-devices` names them)"
        )
    return f"the camera cannot be opened ({reason_of(error)})"


def reason_of(error: BaseException) -> str:
    """FFmpeg's reason, without the address, which may hold a password."""
    return str(getattr(error, "strerror", None) or type(error).__name__)


class Feed:
    """Reads a live stream in a thread of its own.

    Where packets come faster than they are taken, a pipe is made to wait; of anything else the
    packets up to the next key frame are dropped, and counted.

    Args:
        address: a URL, a device, ``-`` for standard input.
        limits: what a picture may claim.
        stream: which of several streams of pictures.
        tell: gets a line on what happens to the connection, from the thread.

    Attributes:
        dropped: pictures that nobody had time for.
        lost: how often the connection was lost.
        opened: the latest connection.

    Raises:
        SourceError: the first connection fails; later ones are tried again until `stop`.
    """

    def __init__(
        self,
        address: str,
        limits: Limits,
        stream: int | None = None,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        self.address = address
        self.shown = "standard input" if address == "-" else safe_address(address)
        self._limits = limits
        self._stream = stream
        self.tell = tell or (lambda _: None)
        self.dropped = 0
        self.lost = 0
        self._dropping = False
        self._waiting: deque[Packet] = deque()
        self._held = 0
        self._changed = Condition()
        self._stop = Event()
        self._ended = False
        self.opened = connect(address, limits, stream)
        self._thread = Thread(target=self._work, name="scenetrace-live", daemon=True)

    def start(self) -> None:
        """Begin to read."""
        self._thread.start()

    def stop(self) -> None:
        """Read no more: what has been read is still given out."""
        self._stop.set()
        with self._changed:
            self._changed.notify_all()

    @property
    def waiting(self) -> int:
        """How many packets wait to be taken."""
        return len(self._waiting)

    def packets(self) -> Iterator[Packet]:
        """The packets in order, until the stream ends or `stop` was called."""
        while (packet := self._next()) is not None:
            yield packet

    def _next(self) -> Packet | None:
        with self._changed:
            while not self._waiting:
                if self._ended or self._stop.is_set():
                    return None
                self._changed.wait(0.2)
            packet = self._waiting.popleft()
            self._held -= len(packet.data)
            self._changed.notify_all()
            return packet

    # -- the thread

    def _work(self) -> None:
        opened: Opened | None = self.opened
        try:
            while opened is not None and not self._stop.is_set():
                reason = self._read(opened)
                opened.container.close()
                if opened.ends or self._stop.is_set() or reason is None:
                    return
                self.lost += 1
                opened = self._reconnected(reason)
        finally:
            with self._changed:
                self._ended = True
                self._changed.notify_all()

    def _reconnected(self, reason: str) -> Opened | None:
        """A new connection, tried for ever, at growing distances; None after `stop`."""
        since = time.monotonic()
        self.tell(
            f"{self.shown}: connection lost ({reason}); trying again until it is back"
        )
        wait = _FIRST_WAIT_S
        while not self._stop.wait(wait):
            try:
                self.opened = connect(self.address, self._limits, self._stream)
            except SourceError:
                wait = min(2 * wait, _LONGEST_WAIT_S)
                continue
            self.tell(
                f"{self.shown}: connected again after {time.monotonic() - since:.1f} s"
            )
            return self.opened
        return None

    def _read(self, opened: Opened) -> str | None:
        """Read a connection to its end; why it ended, None where it was meant to."""
        import av

        unplaced: list[tuple[Any, int, int | None]] = []
        frame_ns = _frame_ns(opened.stream)
        offset: int | None = None
        keyed, passed = False, 0
        latest = 0.0
        packets = opened.container.demux(opened.stream)
        try:
            while not self._stop.is_set():
                asked = time.monotonic_ns()
                packet = next(packets, None)
                if packet is None or not packet.size:
                    break
                now = time.monotonic_ns()
                passed += 1
                keyed = keyed or packet.is_keyframe or passed > _MOST_WITHOUT_KEY
                if not keyed:
                    continue
                stamp = _stamp_ns(packet) if opened.timed else None
                latest = max(latest, (stamp or 0) / 1e9)
                unplaced.append((packet, now, stamp))
                if opened.timed and stamp is None and len(unplaced) < _MOST_UNPLACED:
                    continue  # the next stamp tells this one's, as of a connection's first packet
                if offset is None:
                    waited = now - asked > _WAITED_NS or len(unplaced) > _MOST_UNPLACED
                    if not waited and not opened.ends:
                        continue
                    offset = now - (stamp or 0)
                self._put_all(opened, unplaced, offset, frame_ns)
        except (av.error.EOFError, StopIteration):
            pass
        except (av.error.FFmpegError, ValueError, OSError) as error:
            return reason_of(error)
        finally:
            if unplaced:
                self._put_all(opened, unplaced, offset or unplaced[0][1], frame_ns)
        whole = opened.ends or (opened.seconds > 0 and latest >= opened.seconds - 1)
        return None if whole else "it ended"

    def _put_all(
        self,
        opened: Opened,
        found: list[tuple[Any, int, int | None]],
        offset: int,
        frame_ns: int,
    ) -> None:
        """Hand packets over; those without a stamp precede the next one's by a frame time each."""
        stamps = [stamp for _, _, stamp in found]
        for k in reversed(range(len(stamps) - 1)):
            following = stamps[k + 1]
            if stamps[k] is None and following is not None:
                stamps[k] = following - frame_ns
        for (packet, arrived, _), stamp in zip(found, stamps, strict=True):
            placed = None if stamp is None else stamp + offset
            key = bool(packet.is_keyframe)
            self._put(Packet(bytes(packet), placed, arrived, opened.codec, key))
        found.clear()

    def _put(self, packet: Packet) -> None:
        size = len(packet.data)
        with self._changed:
            if self.opened.ends:
                while self._waiting and self._held + size > MOST_HELD_BYTES:
                    if self._stop.is_set():
                        return
                    self._changed.wait(0.2)
            elif self._dropping:
                if not packet.is_key or self._held > MOST_HELD_BYTES // 2:
                    self.dropped += 1
                    return
                self._dropping = False
            elif self._waiting and self._held + size > MOST_HELD_BYTES:
                if not self.dropped:
                    self.tell(
                        f"{self.shown}: recording cannot keep up, pictures are dropped; a"
                        " smaller picture, fewer of them, or --detect none takes less time"
                    )
                self._dropping = True
                self.dropped += 1
                return
            self._waiting.append(packet)
            self._held += size
            self._changed.notify_all()


def _frame_ns(stream: Any) -> int:
    rate = stream.guessed_rate or stream.average_rate
    return round(NANOS / rate) if rate else NANOS // 25


def _stamp_ns(packet: Any) -> int | None:
    stamp = packet.dts if packet.pts is None else packet.pts
    if stamp is None or packet.time_base is None:
        return None
    return int(stamp * packet.time_base.numerator * NANOS // packet.time_base.denominator)
