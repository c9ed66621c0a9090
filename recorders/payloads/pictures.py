"""Messages that hold a picture: still pictures, raw pixels, packets of a video."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log.model import ChannelInfo
from recorders.payloads.read import (
    PayloadError,
    binary,
    fields,
    frame_id,
    member,
    payload_kind,
    stamp_ns,
    whole,
)
from recorders.pictures import Image, check_size
from recorders.stills import even_bits
from recorders.vision import cv2

PICTURES = frozenset(
    {
        "foxglove.CompressedImage",
        "foxglove.CompressedVideo",
        "foxglove.RawImage",
        "sensor_msgs/CompressedImage",
        "sensor_msgs/Image",
        "ffmpeg_image_transport_msgs/FFMPEGPacket",
    }
)
"""Kinds of channels that hold pictures, see `recorders.payloads.payload_kind`."""
_DEPTH_HEAD_BYTES = 12
_PNG = b"\x89PNG"
_STILL = (b"\xff\xd8", _PNG)
_CODECS = {
    "h264": r"(lib)?(x|h\.?|open)264|avc",
    "hevc": r"(lib)?(x|h\.?)265|hevc",
    "vp9": r"(lib)?(vpx-)?vp9",
    "vp8": r"(lib)?(vpx-)?vp8|libvpx",
    "av1": r"(lib)?((svt|aom|dav1d|rav1e)-?)*av1|librav1e",
    "mjpeg": r"mjpe?g",
}
_CODEC = re.compile(
    "|".join(f"(?P<{codec}>{names})" for codec, names in _CODECS.items()), re.IGNORECASE
)


def codec_of(name: str) -> str | None:
    """FFmpeg's decoder of what a log calls a video's format or its encoder; None of no video.

    >>> [codec_of(n) for n in ("H.265", "h264_nvenc", "libx264rgb", "libsvtav1", "jpeg")]
    ['hevc', 'h264', 'h264', 'av1', None]
    """
    match = _CODEC.match(name.strip())
    return None if match is None else match.lastgroup


@dataclass(frozen=True, slots=True)
class Still:
    """A picture that stands alone, as its file's bytes.

    Attributes:
        stamp_ns: when it was taken, 0 where the message does not say.
        frame_id: the camera's coordinate frame.
        data: JPEG, PNG, WebP ...
        depth: it holds distances, not colours.
    """

    stamp_ns: int
    frame_id: str
    data: bytes
    depth: bool = False


@dataclass(frozen=True, slots=True)
class RawPicture:
    """A picture as pixels.

    Attributes:
        encoding: how pixels are stored, in ROS' and Foxglove's words.
        step: bytes from one row to the next.
        big: numbers of two bytes begin with the larger one.
    """

    stamp_ns: int
    frame_id: str
    width: int
    height: int
    encoding: str
    step: int
    big: bool
    data: bytes


@dataclass(frozen=True, slots=True)
class VideoPacket:
    """A packet of a video; ``codec`` as FFmpeg calls its decoder."""

    stamp_ns: int
    frame_id: str
    codec: str
    data: bytes


def read_picture(channel: ChannelInfo, data: bytes) -> Still | RawPicture | VideoPacket:
    """The picture in a message of a channel of one of `PICTURES`.

    Raises:
        PayloadError: it cannot be read; says why.
    """
    kind = payload_kind(channel)
    if kind not in PICTURES:
        raise PayloadError(f"messages of {kind or 'no schema'} hold no picture")
    found = fields(channel, data)
    if not isinstance(found, dict) and channel.message_encoding == "json":
        raise PayloadError("its JSON is no object")
    stamp, frame = stamp_ns(found), frame_id(found)
    payload = binary(member(found, "data"))
    if not payload:
        raise PayloadError("a picture of 0 bytes")
    if kind in ("foxglove.RawImage", "sensor_msgs/Image"):
        encoding = str(member(found, "encoding"))
        return RawPicture(
            stamp_ns=stamp,
            frame_id=frame,
            width=whole(member(found, "width"), "its width"),
            height=whole(member(found, "height"), "its height"),
            encoding=_ENCODINGS.get(encoding.lower(), encoding),
            step=whole(member(found, "step"), "its step"),
            big=bool(member(found, "is_bigendian")),
            data=payload,
        )
    written = member(found, "encoding" if kind.startswith("ffmpeg") else "format")
    return _compressed(kind, stamp, frame, str(written or ""), payload)


def _compressed(
    kind: str, stamp: int, frame: str, written: str, data: bytes
) -> Still | VideoPacket:
    codec = codec_of(written)
    if kind.endswith(("CompressedVideo", "FFMPEGPacket")):
        if codec is None:
            raise PayloadError(
                f"a video in the format {written[:40]!r}; known are h264, h265, vp8, vp9, av1,"
                " mjpeg"
            )
        return VideoPacket(stamp, frame, codec, data)
    if codec is not None and codec != "mjpeg" and not data.startswith(_STILL):
        return VideoPacket(
            stamp, frame, codec, data
        )  # a hardware encoder's, in pictures' type
    if "compresseddepth" in written.lower():
        if data[_DEPTH_HEAD_BYTES : _DEPTH_HEAD_BYTES + 4] != _PNG:
            raise PayloadError(f"distances in {written[:60]!r}; those in PNG can be read")
        return Still(stamp, frame, data[_DEPTH_HEAD_BYTES:], depth=True)
    return Still(stamp, frame, data)


def _bgr(code: int) -> Callable[[Image], Image]:
    return lambda pixels: np.asarray(cv2.cvtColor(pixels, code), np.uint8)


def _as_is(pixels: Image) -> Image:
    return pixels


# Encoding: bytes of a pixel, its shape behind rows and columns, how it becomes BGR. ROS names a
# Bayer pattern by its first row, OpenCV's older names by its second.
_EIGHT_BITS: dict[str, tuple[int, Callable[[Image], Image]]] = {
    "bgr8": (3, _as_is),
    "8UC3": (3, _as_is),
    "rgb8": (3, _bgr(cv2.COLOR_RGB2BGR)),
    "bgra8": (4, _bgr(cv2.COLOR_BGRA2BGR)),
    "8UC4": (4, _bgr(cv2.COLOR_BGRA2BGR)),
    "rgba8": (4, _bgr(cv2.COLOR_RGBA2BGR)),
    "mono8": (1, _bgr(cv2.COLOR_GRAY2BGR)),
    "8UC1": (1, _bgr(cv2.COLOR_GRAY2BGR)),
    "bayer_rggb8": (1, _bgr(cv2.COLOR_BayerBG2BGR)),
    "bayer_bggr8": (1, _bgr(cv2.COLOR_BayerRG2BGR)),
    "bayer_gbrg8": (1, _bgr(cv2.COLOR_BayerGR2BGR)),
    "bayer_grbg8": (1, _bgr(cv2.COLOR_BayerGB2BGR)),
    "yuv422": (2, _bgr(cv2.COLOR_YUV2BGR_UYVY)),
    "uyvy": (2, _bgr(cv2.COLOR_YUV2BGR_UYVY)),
    "yuv422_yuy2": (2, _bgr(cv2.COLOR_YUV2BGR_YUY2)),
    "yuyv": (2, _bgr(cv2.COLOR_YUV2BGR_YUY2)),
}
_SIXTEEN_BITS: dict[str, tuple[int, str]] = {
    "mono16": (1, "8UC1"),
    "16UC1": (1, "8UC1"),
    "16UC3": (3, "8UC3"),
    "bgr16": (3, "bgr8"),
    "rgb16": (3, "rgb8"),
    "bayer_rggb16": (1, "bayer_rggb8"),
    "bayer_bggr16": (1, "bayer_bggr8"),
    "bayer_gbrg16": (1, "bayer_gbrg8"),
    "bayer_grbg16": (1, "bayer_grbg8"),
}
_PLANES = {
    "nv12": _bgr(cv2.COLOR_YUV2BGR_NV12),
    "nv21": _bgr(cv2.COLOR_YUV2BGR_NV21),
    "i420": _bgr(cv2.COLOR_YUV2BGR_I420),
    "yv12": _bgr(cv2.COLOR_YUV2BGR_YV12),
}


_DISTANCES = "32FC1"
_ENCODINGS = {
    name.lower(): name for name in (*_EIGHT_BITS, *_SIXTEEN_BITS, *_PLANES, _DISTANCES)
}
_ENCODINGS |= {"yuv420": "i420", "yuv420p": "i420", "yuyv422": "yuyv", "uyvy422": "uyvy"}
_ENCODINGS |= {"rgb": "rgb8", "bgr": "bgr8", "gray8": "mono8", "grey8": "mono8"}


def is_deep(picture: RawPicture) -> bool:
    """Whether its pixels are of more than eight bits."""
    return picture.encoding in _SIXTEEN_BITS or picture.encoding == _DISTANCES


def raw_pixels(
    picture: RawPicture, bits: int = 16, limits: Limits = DEFAULT_LIMITS
) -> Image:
    """A raw picture's pixels, (height, width, 3) uint8 BGR.

    Args:
        picture: the picture.
        bits: how many bits the values of 16-bit pixels fill; the upper eight of them are kept.
        limits: checked before anything is made.

    Raises:
        PayloadError: the encoding is unknown, or the data are too short for the size.
        LimitError: too many pixels.
    """
    try:
        check_size(picture.width, picture.height, "", limits)
    except RecordingError as error:
        raise PayloadError(error.reason) from error
    if picture.encoding in _PLANES:
        even = picture.width % 2 == 0 and picture.height % 2 == 0
        rows = _rows(picture, 1, "u1", picture.height * 3 // 2)
        if not even:
            raise PayloadError(f"{picture.encoding} pictures of an odd size")
        return _PLANES[picture.encoding](rows)
    if is_deep(picture):
        _, name = _SIXTEEN_BITS.get(picture.encoding, (1, "8UC1"))
        eight = np.minimum(_deep(picture) >> max(0, bits - 8), 255).astype(np.uint8)
        return _EIGHT_BITS[name][1](eight)
    if picture.encoding not in _EIGHT_BITS:
        raise PayloadError(
            f"pixels in {picture.encoding[:40]!r} cannot be shown; known are"
            f" {', '.join([*_EIGHT_BITS, *_SIXTEEN_BITS, *_PLANES, _DISTANCES])}"
        )
    channels, convert = _EIGHT_BITS[picture.encoding]
    if channels == 2 and picture.width % 2:
        raise PayloadError(f"{picture.encoding} pictures of an odd width")
    return convert(_rows(picture, channels, "u1", picture.height))


def bits_used(picture: RawPicture) -> int:
    """How many bits the largest value of a picture of 16-bit pixels fills: 8 to 16, even."""
    return even_bits(int(_deep(picture).max(initial=0)))


def _deep(picture: RawPicture) -> Any:
    """Values of 16 bits; distances, which are metres (REP 118), in millimetres."""
    order = ">" if picture.big else "<"
    if picture.encoding != _DISTANCES:
        channels, _ = _SIXTEEN_BITS[picture.encoding]
        return _rows(picture, channels, f"{order}u2", picture.height)
    metres = np.nan_to_num(_rows(picture, 1, f"{order}f4", picture.height), posinf=0.0)
    return np.clip(metres * 1000.0, 0, 65535).astype(np.uint16)


def _rows(picture: RawPicture, channels: int, form: str, height: int) -> Any:
    """The rows without what lies behind each: (height, width) or (height, width, channels)."""
    item = np.dtype(form).itemsize
    needed = picture.width * channels * item
    step = picture.step or needed
    if step < needed or len(picture.data) < step * (height - 1) + needed:
        raise PayloadError(
            f"{len(picture.data)} bytes in rows of {step} are too few for"
            f" {picture.width} x {picture.height} pixels of {picture.encoding}"
        )
    flat = np.frombuffer(picture.data, np.uint8)
    short = step * height - flat.size
    if short > 0:
        flat = np.concatenate([flat, np.zeros(short, np.uint8)])
    rows = flat[: step * height].reshape(height, step)[:, :needed]
    pixels = np.ascontiguousarray(rows).view(form).astype(np.dtype(form).newbyteorder("="))
    shape = (height, picture.width, channels) if channels > 1 else (height, picture.width)
    return pixels.reshape(shape)
