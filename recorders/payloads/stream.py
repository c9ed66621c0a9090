"""Videos that come packet by packet, one message each: where decoding may start, and pictures
that know which packet they came from.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import FrameConverter, Image, check_size

_START = b"\x00\x00\x01"
_IDR = 5
_HEVC_KEYS = range(16, 22)
_H264_SETS = frozenset({6, 7, 8, 9})
_HEVC_SETS = frozenset({32, 33, 34, 35, 39, 40})
_AV1_SEQUENCE_HEADER = 1
_MOST_PENDING_BYTES = 1 << 20


def annex_b(data: bytes) -> bytes:
    """H.264 or H.265 with start codes, also where each unit comes after its length in 4 bytes."""
    if data.startswith((b"\x00\x00\x00\x01", _START)):
        return data
    units, at = [], 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if not 0 < length <= len(data) - at - 4:
            return data
        units.append(data[at + 4 : at + 4 + length])
        at += 4 + length
    return (
        data if at != len(data) else b"".join(b"\x00\x00\x00\x01" + unit for unit in units)
    )


def _units(data: bytes) -> Iterator[int]:
    """The first byte of each unit behind a start code."""
    at = data.find(_START)
    while at >= 0 and at + 3 < len(data):
        yield data[at + 3]
        at = data.find(_START, at + 3)


def is_key(codec: str, data: bytes) -> bool:
    """Whether decoding may start at this packet; ``codec`` as FFmpeg calls it."""
    if codec == "h264":
        return any(unit & 0x1F == _IDR for unit in _units(annex_b(data)))
    if codec == "hevc":
        return any(unit >> 1 & 0x3F in _HEVC_KEYS for unit in _units(annex_b(data)))
    if codec == "vp9":
        return bool(data) and data[0] >> 6 == 2 and not data[0] & 0x0C
    if codec == "av1":
        return any(kind == _AV1_SEQUENCE_HEADER for kind in _obus(data))
    return True


def _obus(data: bytes) -> Iterator[int]:
    at = 0
    while at < len(data):
        head = data[at]
        yield head >> 3 & 0x0F
        at += 2 if head & 4 else 1
        if not head & 2:
            return  # without a size: to the end
        length = shift = 0
        while at < len(data) and shift < 56:
            length |= (data[at] & 0x7F) << shift
            at, shift = at + 1, shift + 7
            if not data[at - 1] & 0x80:
                break
        at += length


def _holds_no_picture(codec: str, data: bytes) -> bool:
    """Parameter sets alone, which some writers send apart."""
    if codec == "h264":
        return all(unit & 0x1F in _H264_SETS for unit in _units(data))
    if codec == "hevc":
        return all(unit >> 1 & 0x3F in _HEVC_SETS for unit in _units(data))
    return False


class VideoStream:
    """Decodes the packets of one video in order.

    What comes before the first key frame, and from a damaged packet to the next key frame, gives
    no pictures. A fresh decoder at every key frame where it can be told: a picture is a function of
    its group alone.

    Args:
        codec: as FFmpeg calls it.
        path: for the error's text.
        limits: what a picture may claim.
        low_delay: each packet gives its picture at once: pictures come in the packets' order.
    """

    def __init__(
        self,
        codec: str,
        path: str | Path = "",
        limits: Limits = DEFAULT_LIMITS,
        low_delay: bool = False,
    ) -> None:
        self.codec = codec
        self._low_delay = low_delay
        self._path = path
        self._limits = limits
        self._context: Any = None
        self._waits_for_key = True
        self._pending = b""
        self._converter = FrameConverter()

    def _open(self) -> Any:
        import av

        context: Any = av.CodecContext.create(self.codec, "r")
        context.thread_count = 1
        if self._low_delay:
            context.flags |= av.codec.context.Flags.low_delay
        context.options = {"max_pixels": str(self._limits.max_picture_pixels)}
        return context

    def decode(self, index: int, data: bytes) -> list[tuple[int, Image]]:
        """The pictures that this packet completes: the number of the packet that each came from,
        and (height, width, 3) BGR.

        Raises:
            RecordingError: the packet is damaged; what follows until the next key frame gives no
                pictures.
            LimitError: it claims too many pixels.
        """
        import av

        if self.codec in ("h264", "hevc"):
            data = annex_b(data)
            if _holds_no_picture(self.codec, data):
                self._pending = (self._pending + data)[-_MOST_PENDING_BYTES:]
                return []
            data, self._pending = self._pending + data, b""
        pictures = []
        if is_key(self.codec, data):
            pictures = self.rest()
            self._context, self._waits_for_key = self._open(), False
        if self._waits_for_key:
            return []
        packet = av.Packet(data)
        packet.pts = index
        try:
            frames = self._context.decode(packet)
            return pictures + [self._picture(frame) for frame in frames]
        except (av.error.FFmpegError, ValueError, RecordingError) as error:
            context, self._context, self._waits_for_key = self._context, None, True
            if isinstance(error, RecordingError):
                raise
            if min(context.width, context.height) > 0:
                check_size(context.width, context.height, self._path, self._limits)
            reason = str(getattr(error, "strerror", None) or error)
            raise RecordingError(
                f"a damaged {self.codec} packet: {reason}", self._path
            ) from error

    @property
    def waits_for_key(self) -> bool:
        """No picture can be given before the next key frame."""
        return self._waits_for_key

    def rest(self) -> list[tuple[int, Image]]:
        """What the decoder still holds back."""
        import av

        if self._context is None:
            return []
        context, self._context, self._waits_for_key = self._context, None, True
        try:
            return [self._picture(frame) for frame in context.decode(None)]
        except (av.error.FFmpegError, ValueError, RecordingError):
            return []

    def _picture(self, frame: Any) -> tuple[int, Image]:
        if frame.is_corrupt:
            raise RecordingError(f"a damaged {self.codec} picture", self._path)
        check_size(frame.width, frame.height, self._path, self._limits)
        return int(frame.pts), self._converter(frame)
