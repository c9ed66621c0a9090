"""Pictures as bytes: sizes from headers before anything is decoded, JPEG, PNG and H.264 in and out.

Everything here that decodes checks the size that the header claims first: a picture of 600 bytes
may claim 30000 x 30000 pixels. Colours of H.264 are BT.601, limited range, written into the
stream and converted by OpenCV's 8-bit routines, which give the same bits on every machine.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from recorders.decoder_words import decoded_in_silence
from recorders.errors import LimitError, RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.vision import cv2

Image = NDArray[np.uint8]
Format = Literal["jpeg", "png"]

JPEG_QUALITY = 95
MASK_PNG_LEVEL = 1
PICTURE_PNG_LEVEL = 3
VIDEO_CRF = 18
VIDEO_KEY_FRAMES_EVERY = 50

_PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
_JPEG_START = b"\xff\xd8"
# Start-of-frame markers; C4, C8 and CC in their midst are tables and an extension.
_JPEG_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
_BT709, _FULL_RANGE = 1, 2
_JPEG_ALONE = frozenset({0x01, *range(0xD0, 0xD8)})


@dataclass(frozen=True, slots=True)
class PictureHeader:
    """What a picture says of itself before it is decoded: format, width and height in pixels,
    channels.
    """

    format: Format
    width: int
    height: int
    channels: int


def check_size(
    width: int, height: int, path: str | Path = "", limits: Limits = DEFAULT_LIMITS
) -> None:
    """Refuse a picture that claims more pixels than the limits allow.

    Raises:
        LimitError: states value, limit and the limit's name.
        RecordingError: a side is zero.
    """
    claim = f"a picture claims {width} x {height} pixels"
    if width < 1 or height < 1:
        raise RecordingError(claim, path)
    if max(width, height) > limits.max_picture_side:
        raise LimitError(
            f"{claim}, over the limit of {limits.max_picture_side} a side"
            " (max_picture_side)",
            path,
        )
    if width * height > limits.max_picture_pixels:
        raise LimitError(
            f"{claim}, over the limit of {limits.max_picture_pixels} (max_picture_pixels)",
            path,
        )


def read_header(data: bytes, path: str | Path = "") -> PictureHeader:
    """Format and size of a JPEG or PNG from its header, without decoding.

    Raises:
        RecordingError: it is neither, or its header is cut off or damaged.
    """
    if data.startswith(_PNG_SIGNATURE):
        return _png_header(data, path)
    if data.startswith(_JPEG_START):
        return _jpeg_header(data, path)
    raise RecordingError("neither a JPEG nor a PNG picture", path)


def _png_header(data: bytes, path: str | Path) -> PictureHeader:
    if len(data) < 33 or data[12:16] != b"IHDR":
        raise RecordingError("a PNG picture without a header", path)
    width, height, _, colour = struct.unpack_from(">IIBB", data, 16)
    return PictureHeader("png", width, height, {0: 1, 4: 2, 6: 4}.get(colour, 3))


def _jpeg_header(data: bytes, path: str | Path) -> PictureHeader:
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if marker == 0xFF or marker in _JPEG_ALONE:
            at += 1 if marker == 0xFF else 2
            continue
        (length,) = struct.unpack_from(">H", data, at + 2)
        if marker in _JPEG_FRAMES and at + 10 <= len(data):
            height, width, channels = struct.unpack_from(">HHB", data, at + 5)
            return PictureHeader("jpeg", width, height, channels)
        at += 2 + length
    raise RecordingError("a JPEG picture without a header that gives its size", path)


def decoded_bytes(data: bytes, flags: int, name: str, path: str | Path) -> Any:
    """A picture's array as OpenCV decodes it, as it is stored: no rotation by EXIF.

    Args:
        data: the picture's bytes, whose header has been checked.
        flags: OpenCV's, of colours and depth.
        name: the format, for the message.
        path: the file, for the message.

    Raises:
        RecordingError: it is damaged.
    """
    try:
        image, damage = decoded_in_silence(
            lambda: cv2.imdecode(
                np.frombuffer(data, np.uint8), flags | cv2.IMREAD_IGNORE_ORIENTATION
            )
        )
    except cv2.error as error:
        raise RecordingError(f"a damaged {name} picture: {error.err}", path) from error
    if damage:
        raise RecordingError(f"a damaged {name} picture: {damage}", path)
    if image is None:
        raise RecordingError(f"a damaged {name} picture", path)
    return image


def decode_picture(
    data: bytes,
    *,
    gray: bool = False,
    path: str | Path = "",
    limits: Limits = DEFAULT_LIMITS,
) -> Image:
    """Decode a JPEG or PNG.

    Args:
        data: the picture's bytes.
        gray: give one channel, (height, width); else (height, width, 3) BGR. An EXIF orientation
            is not applied: boxes are in the picture's own pixels.
        path: for the error's text.
        limits: checked against the header, before decoding.

    Raises:
        LimitError: the header claims too many pixels.
        RecordingError: it is not a JPEG or PNG, or is damaged.
    """
    header = read_header(data, path)
    check_size(header.width, header.height, path, limits)
    if not is_whole(data, header.format):
        raise RecordingError(f"a {header.format} picture that is cut off", path)
    if header.format == "png":
        # libpng would find it as well, and say so on stderr in its own words.
        _check_png(data, path)
        mask = _plain_mask(data, header) if gray else None
        if mask is not None:
            return mask
    flags = cv2.IMREAD_GRAYSCALE if gray else cv2.IMREAD_COLOR
    image = decoded_bytes(data, flags, header.format, path)
    if image.shape[:2] != (header.height, header.width):
        raise RecordingError(f"a damaged {header.format} picture", path)
    return np.asarray(image, np.uint8)


def _plain_mask(data: bytes, header: PictureHeader) -> Image | None:
    """A PNG of one bit a pixel without filters, as `encode_mask` makes it: a fifth of the time
    that libpng takes.

    None for any other, also for a damaged one.
    """
    depth, colour, *coding = data[24:29]
    if (depth, colour, coding) != (1, 0, [0, 0, 0]) or data.find(b"tRNS", 33) >= 0:
        return None
    packed, at = [], 33
    while at + 12 < len(data):
        (length,) = struct.unpack_from(">I", data, at)
        if data[at + 4 : at + 8] == b"IDAT":
            packed.append(data[at + 8 : at + 8 + length])
        at += 12 + length
    row = 1 + (header.width + 7) // 8
    size = header.height * row
    stream = zlib.decompressobj()
    try:
        unpacked = stream.decompress(b"".join(packed), size + 1)
    except zlib.error:
        return None
    if len(unpacked) != size or not stream.eof:
        return None
    rows = np.frombuffer(unpacked, np.uint8).reshape(header.height, row)
    if rows[:, 0].any():
        return None
    return np.unpackbits(rows[:, 1:], axis=1, count=header.width) * np.uint8(255)


def _check_png(data: bytes, path: str | Path) -> None:
    """Hold the chunks that a PNG cannot do without (upper case) against their CRCs."""
    at = len(_PNG_SIGNATURE)
    while at + 12 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        end = at + 8 + length
        name = kind.decode("ascii", "backslashreplace")
        if end + 4 > len(data):
            raise RecordingError(
                f"a damaged png picture: its {name} chunk at byte {at} is cut off", path
            )
        if kind[:1].isupper() and zlib.crc32(
            memoryview(data)[at + 4 : end]
        ) != int.from_bytes(data[end : end + 4]):
            raise RecordingError(
                f"a damaged png picture: the CRC of its {name} chunk at byte {at} differs",
                path,
            )
        if kind == b"IEND":
            return
        at = end + 4


def is_whole(data: bytes, picture_format: str) -> bool:
    """Whether a JPEG or PNG has its end: what a cut-off copy lacks."""
    # Decoders fill what is missing with grey and say nothing: look for the end that the format
    # demands.
    if picture_format == "png":
        return 0 < data.rfind(b"IEND") <= len(data) - 8
    return data.rfind(b"\xff\xd9") > data.find(b"\xff\xda") > 0


def encode_jpeg(image: Image, quality: int = JPEG_QUALITY) -> bytes:
    """A JPEG of a BGR or grey picture: same pixels, same bytes."""
    return _encode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])


def encode_small_jpeg(image: Image, quality: int) -> bytes:
    """A JPEG for browsers, its codes fitted to the picture: a twentieth smaller. WebP would save
    a quarter more, and take fifteen times as long.
    """
    return _encode(
        ".jpg",
        image,
        [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1],
    )


def encode_png(image: Image, level: int = PICTURE_PNG_LEVEL) -> bytes:
    """A PNG of a BGR or grey picture: without loss; same pixels, same bytes."""
    return _encode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, level])


def encode_mask(mask: Image) -> bytes:
    """A PNG of a mask of 0 and 255: one channel, one bit a pixel, which takes a third of the time
    of eight.
    """
    return _encode(
        ".png",
        mask,
        [cv2.IMWRITE_PNG_BILEVEL, 1, cv2.IMWRITE_PNG_COMPRESSION, MASK_PNG_LEVEL],
    )


def _encode(kind: str, image: Image, options: list[int]) -> bytes:
    done, data = cv2.imencode(kind, image, options)
    assert done, f"OpenCV cannot encode {kind}"
    return bytes(data)


def from_i420(planes: Image) -> Image:
    """BGR, (height, width, 3), from Y, U and V planes under one another, (height * 3 / 2, width)."""
    return np.asarray(cv2.cvtColor(planes, cv2.COLOR_YUV2BGR_I420), np.uint8)


class FrameConverter:
    """Decoded frames to (height, width, 3) BGR, turned by quarter turns."""

    def __init__(self, quarter_turns: int = 0) -> None:
        from av.video.reformatter import VideoReformatter

        self._reformatter = VideoReformatter()
        self._turns = quarter_turns

    def __call__(self, frame: Any) -> Image:
        """The frame's picture."""
        usual = int(frame.color_range) != _FULL_RANGE and int(frame.colorspace) != _BT709
        if (
            usual
            and frame.format.name == "yuv420p"
            and frame.width % 2 == 0
            and frame.height % 2 == 0
        ):
            image = from_i420(np.asarray(frame.to_ndarray(), np.uint8))
        else:
            image = np.asarray(
                self._reformatter.reformat(frame, format="bgr24").to_ndarray(), np.uint8
            )
        return np.ascontiguousarray(np.rot90(image, self._turns)) if self._turns else image


class VideoEncoder:
    """H.264 as foxglove.CompressedVideo wants it: Annex B, one frame in, one frame out, SPS and
    PPS with every IDR.

    No B-frames, no lookahead, one thread: the same pictures give the same bytes.

    Raises:
        UsageError: width or height is odd, which H.264 with 4:2:0 colours cannot store.
    """

    def __init__(self, width: int, height: int, fps: Fraction = Fraction(25)) -> None:
        import av

        if width % 2 or height % 2:
            raise UsageError(
                f"--codec h264 needs an even width and height, these pictures are {width} x"
                f" {height}"
            )
        self._av = av
        self._frames = 0
        context: Any = av.CodecContext.create("libx264", "w")
        context.width, context.height, context.pix_fmt = width, height, "yuv420p"
        context.time_base = 1 / fps
        context.framerate = fps
        context.gop_size = VIDEO_KEY_FRAMES_EVERY
        context.max_b_frames = 0
        context.thread_count = 1
        context.options = {
            "preset": "veryfast",
            "tune": "zerolatency",
            "crf": str(VIDEO_CRF),
            "x264-params": (
                "repeat-headers=1:annexb=1:scenecut=0:open-gop=0:bframes=0:sliced-threads=0:threads=1:"
                "colorprim=smpte170m:transfer=smpte170m:colormatrix=smpte170m:range=tv"
            ),
        }
        context.open()
        self._context = context

    def encode(self, image: Image) -> bytes:
        """The next frame's bytes, of a (height, width, 3) BGR picture."""
        planes = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2YUV_I420), np.uint8)
        frame = self._av.VideoFrame.from_ndarray(planes, format="yuv420p")
        frame.pts = self._frames
        self._frames += 1
        packets = self._context.encode(frame)
        assert len(packets) == 1, "without B-frames and lookahead every frame is a packet"
        return bytes(packets[0])


class VideoDecoder:
    """Decodes H.264 frames one by one; a start in the middle needs every frame from the last IDR
    on (`is_key`).
    """

    def __init__(self, path: str | Path = "", limits: Limits = DEFAULT_LIMITS) -> None:
        self._path = path
        self._limits = limits
        self._context: Any = None
        self._converter = FrameConverter()

    @staticmethod
    def is_key(data: bytes) -> bool:
        """Whether an Annex B frame holds an IDR slice (NAL type 5), where decoding may start."""
        at = data.find(b"\x00\x00\x01")
        while at >= 0 and at + 3 < len(data):
            if data[at + 3] & 0x1F == 5:
                return True
            at = data.find(b"\x00\x00\x01", at + 3)
        return False

    def _open(self) -> Any:
        import av

        context: Any = av.CodecContext.create("h264", "r")
        context.thread_count = 1
        context.flags |= av.codec.context.Flags.low_delay
        # Damage is an error, not something to be painted over.
        context.options = {
            "max_pixels": str(self._limits.max_picture_pixels),
            "err_detect": "explode",
            "ec": "0",
        }
        return context

    def decode(self, data: bytes) -> Image:
        """The next frame, (height, width, 3) BGR.

        Raises:
            RecordingError: damaged, or not one whole frame.
            LimitError: it claims too many pixels.
        """
        import av

        if self.is_key(data) or self._context is None:
            # A fresh context at every IDR: a frame's pixels are a function of its IDR group alone.
            self._context = self._open()
        try:
            frames = self._context.decode(av.Packet(data))
        except (av.error.FFmpegError, ValueError) as error:
            if max(self._context.width, self._context.height) > 0:
                check_size(
                    self._context.width, self._context.height, self._path, self._limits
                )
            raise RecordingError(f"a damaged H.264 frame: {error}", self._path) from error
        if len(frames) != 1:
            raise RecordingError(
                f"H.264 data that hold {len(frames)} frames, one per message is wanted",
                self._path,
            )
        frame = frames[0]
        if frame.is_corrupt:
            raise RecordingError("a damaged H.264 frame", self._path)
        check_size(frame.width, frame.height, self._path, self._limits)
        return self._converter(frame)
