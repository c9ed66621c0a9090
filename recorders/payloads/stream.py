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
_IDR, _SEI, _SPS, _PPS = 5, 6, 7, 8
_RECOVERY_POINT = 6
_HEVC_KEYS = range(16, 22)
_HEVC_CRA = 21
_H264_SETS = frozenset({6, 7, 8, 9})
_HEVC_SETS = frozenset({32, 33, 34, 35, 39, 40})
_HEVC_PARAMETERS = frozenset({32, 33, 34})
_H264_SPS, _HEVC_VPS = frozenset({0x27, 0x47, 0x67}), frozenset({0x40})
_AV1_SEQUENCE_HEADER = 1
_MOST_PENDING_BYTES = 1 << 20
_DECODERS = {"av1": ("libdav1d", "libaom-av1", "av1")}
"""FFmpeg's decoder of a codec's name may need a graphics card; these are tried first."""


def _prefixed(data: bytes) -> list[bytes] | None:
    """The units of a packet in which each comes after its length in 4 bytes; None where it is no
    such packet.
    """
    units, at = [], 0
    while at + 4 <= len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if not 0 < length <= len(data) - at - 4:
            return None
        units.append(data[at + 4 : at + 4 + length])
        at += 4 + length
    return units if units and at == len(data) else None


def annex_b(data: bytes) -> bytes:
    """H.264 or H.265 with start codes, also where each unit comes after its length in 4 bytes."""
    if data.startswith((b"\x00" + _START, _START)):
        return data
    units = _prefixed(data)
    return data if units is None else _coded(units)


def _coded(units: list[bytes]) -> bytes:
    return b"".join(b"\x00" + _START + unit for unit in units)


def _starts(data: bytes) -> Iterator[int]:
    """Where each unit begins, behind its start code."""
    at = data.find(_START)
    while at >= 0 and at + 3 < len(data):
        yield at + 3
        at = data.find(_START, at + 3)


def _units(data: bytes) -> Iterator[int]:
    """The first byte of each unit."""
    return (data[at] for at in _starts(data))


def is_key(codec: str, data: bytes) -> bool:
    """Whether decoding may start at this packet; ``codec`` as FFmpeg calls it."""
    if codec == "h264":
        return any(unit & 0x1F == _IDR for unit in _units(annex_b(data)))
    if codec == "hevc":
        return any(unit >> 1 & 0x3F in _HEVC_KEYS for unit in _units(annex_b(data)))
    if codec == "vp9":
        return bool(data) and data[0] >> 6 == 2 and not data[0] & 0x0C
    if codec == "vp8":
        return bool(data) and not data[0] & 1
    if codec == "av1":
        return any(kind == _AV1_SEQUENCE_HEADER for kind in _obus(data))
    return True


def other_codec(codec: str, data: bytes) -> str:
    """What a packet that is said to be H.264 or H.265 is instead: parameter sets of the one are no
    units that the other knows. Empty where nothing tells.

    >>> other_codec("hevc", bytes.fromhex("00000001674d401f")), other_codec("h264", b"")
    ('h264', '')
    """
    units = set(_units(annex_b(data)))
    if codec == "hevc" and units & _H264_SPS:
        return "h264"
    return "hevc" if codec == "h264" and units & _HEVC_VPS else ""


def _is_independent(codec: str, data: bytes) -> bool:
    """Whether nothing from this packet on needs what came before."""
    if codec == "hevc" and is_key(codec, data):
        return not any(unit >> 1 & 0x3F == _HEVC_CRA for unit in _units(data))
    return is_key(codec, data)


def _recovers(codec: str, data: bytes) -> bool:
    """Whether a decoder that starts at this packet has whole pictures some packets later: H.264
    without key frames says so (ITU-T H.264, D.2.8).
    """
    if codec != "h264":
        return False
    return any(
        data[at] & 0x1F == _SEI and _RECOVERY_POINT in _messages(data, at + 1)
        for at in _starts(data)
    )


def _messages(data: bytes, at: int) -> Iterator[int]:
    """The kinds of the messages in a unit of supplemental information."""
    end = data.find(_START, at)
    end = len(data) if end < 0 else end
    while at + 2 < end:
        found = []
        for _ in range(2):  # the kind, the size
            value = 0
            while at < end and data[at] == 0xFF:
                value, at = value + 255, at + 1
            found.append(value + (data[at] if at < end else 0))
            at += 1
        yield found[0]
        at += found[1]


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


def _parameters(codec: str, data: bytes) -> bytes:
    """A packet's parameter sets, which a decoder needs once."""
    places = list(_starts(data))
    found = []
    for k, at in enumerate(places):
        end = places[k + 1] - 3 if k + 1 < len(places) else len(data)
        first = data[at]
        if (codec == "h264" and first & 0x1F in (_SPS, _PPS)) or (
            codec == "hevc" and first >> 1 & 0x3F in _HEVC_PARAMETERS
        ):
            found.append(data[at:end].rstrip(b"\x00"))
    return _coded(found)


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
        self._sets = b""
        self._has_prefixes = False
        self._saved: list[tuple[int, Image]] = []
        self._converter = FrameConverter()

    def _open(self) -> Any:
        import av

        known = [name for name in _DECODERS.get(self.codec, ()) if _is_there(name)]
        context: Any = av.CodecContext.create(known[0] if known else self.codec, "r")
        context.thread_count = 1
        if self._low_delay:
            context.flags |= av.codec.context.Flags.low_delay
        context.options = {"max_pixels": str(self._limits.max_picture_pixels)}
        if self.codec == "mjpeg":  # whose damage is painted over else
            context.options |= {"err_detect": "explode"}
        return context

    def plain(self, data: bytes) -> bytes:
        """A packet with start codes. A length of 256 to 511 bytes reads as one: what earlier
        packets had decides.
        """
        if self.codec not in ("h264", "hevc"):
            return data
        units = _prefixed(data)
        if data.startswith(b"\x00" + _START) or units is None:
            self._has_prefixes = False
        elif not data.startswith(_START):
            self._has_prefixes = True
        return _coded(units) if units is not None and self._has_prefixes else data

    def holds_no_picture(self, data: bytes) -> bool:
        """Whether a packet holds parameter sets alone: they are kept for the pictures."""
        return _holds_no_picture(self.codec, self.plain(data))

    def decode(self, index: int, data: bytes) -> list[tuple[int, Image]]:
        """The pictures that this packet completes: the number of the packet that each came from,
        and (height, width, 3) BGR.

        Raises:
            RecordingError: the packet is damaged; what follows until the next key frame gives no
                pictures.
            LimitError: it claims too many pixels.
        """
        pictures, self._saved = self._saved, []
        data = self.plain(data)
        if self.codec in ("h264", "hevc"):
            if _holds_no_picture(self.codec, data):
                self._pending = (self._pending + data)[-_MOST_PENDING_BYTES:]
                self._sets = _parameters(self.codec, self._pending) or self._sets
                return pictures
            data, self._pending = self._pending + data, b""
        begins = _is_independent(self.codec, data) or (
            self._waits_for_key
            and (is_key(self.codec, data) or _recovers(self.codec, data))
        )
        if begins:
            pictures += self.rest()
            self._context, self._waits_for_key = self._open(), False
            data = self._with_parameters(data)
        if self._waits_for_key:
            return pictures
        return pictures + self._decoded(index, data)

    def _decoded(self, index: int, data: bytes) -> list[tuple[int, Image]]:
        import av

        packet = av.Packet(data)
        packet.pts = index
        try:
            return [self._picture(frame) for frame in self._context.decode(packet)]
        except (av.error.FFmpegError, ValueError, RecordingError) as error:
            context = self._context
            self._saved = self.rest()
            if isinstance(error, RecordingError):
                raise
            if min(context.width, context.height) > 0:
                check_size(context.width, context.height, self._path, self._limits)
            reason = str(getattr(error, "strerror", None) or error)
            raise RecordingError(
                f"a damaged {self.codec} packet: {reason}", self._path
            ) from error

    def _with_parameters(self, data: bytes) -> bytes:
        """A key frame with its parameter sets: those that were sent once, where it has none."""
        if self.codec not in ("h264", "hevc"):
            return data
        own = _parameters(self.codec, data)
        if own:
            self._sets = own
            return data
        if not self._sets:
            self._context, self._waits_for_key = None, True
            raise RecordingError(
                f"a key frame of {self.codec} whose parameter sets are not in the log",
                self._path,
            )
        return self._sets + data

    @property
    def waits_for_key(self) -> bool:
        """No picture can be given before the next key frame."""
        return self._waits_for_key

    @property
    def reorders(self) -> bool:
        """Whether pictures may come in another order than their packets."""
        return self._context is not None and bool(self._context.has_b_frames)

    def rest(self) -> list[tuple[int, Image]]:
        """What the decoder still holds back."""
        import av

        pictures, self._saved = self._saved, []
        if self._context is None:
            return pictures
        context, self._context, self._waits_for_key = self._context, None, True
        try:
            for frame in context.decode(None):
                pictures.append(self._picture(frame))
        except (av.error.FFmpegError, ValueError, RecordingError):
            pass
        return pictures

    def _picture(self, frame: Any) -> tuple[int, Image]:
        if frame.is_corrupt:
            raise RecordingError(f"a damaged {self.codec} picture", self._path)
        check_size(frame.width, frame.height, self._path, self._limits)
        return int(frame.pts), self._converter(frame)


def _is_there(decoder: str) -> bool:
    import av

    return decoder in av.codecs_available
