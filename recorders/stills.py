"""Still pictures in the formats that people keep them in, sizes known before anything is decoded.

JPEG and PNG of eight bits, upright, are recorded as they are; everything else becomes pixels here:
TIFF and its stacks, WebP, AVIF, BMP, values of more than eight bits, pictures that EXIF says to turn.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from recorders.errors import RecordingError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import (
    Image,
    check_size,
    decode_picture,
    decoded_bytes,
    is_whole,
    read_header,
)
from recorders.vision import cv2

SUFFIXES = frozenset({".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp", ".avif"})
_MOST_PAGES = 1_000_000
_MOST_TAGS = 4096
_EXIF_ORIENTATION = 0x112
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS = 0x100, 0x101, 0x102


@dataclass(frozen=True, slots=True)
class StillHeader:
    """What a still picture says of itself.

    Attributes:
        format: ``jpeg``, ``png``, ``tiff``, ``bmp``, ``webp``, ``avif``.
        width, height: in pixels, upright.
        bits: of one value of one pixel.
        orientation: EXIF's, 1 for upright.
        pages: how many pictures a TIFF holds.
    """

    format: str
    width: int
    height: int
    bits: int = 8
    orientation: int = 1
    pages: int = 1

    @property
    def as_is(self) -> bool:
        """Whether its bytes can be recorded as they are."""
        return self.format in ("jpeg", "png") and self.bits <= 8 and self.orientation == 1


def still_header(data: bytes, path: str | Path = "") -> StillHeader:
    """Format and size of a still picture.

    Raises:
        RecordingError: it is of no known format, or its header is damaged.
    """
    try:
        if data[:4] in (b"II*\x00", b"MM\x00*"):
            return _tiff(data, path)
        if data[:2] == b"BM" and len(data) >= 30:
            width, height, _, bits = struct.unpack_from("<iiHH", data, 18)
            return StillHeader("bmp", width, abs(height))
        if data[:4] == b"RIFF" and data[8:12] == b"WEBP":
            return StillHeader("webp", *_webp_size(data))
        if data[4:12] in (b"ftypavif", b"ftypavis"):
            return StillHeader("avif", *_avif_size(data))
    except (struct.error, IndexError, ValueError) as error:
        raise RecordingError("a picture whose header is cut off", path) from error
    if not data.startswith((b"\xff\xd8", b"\x89PNG")):
        raise RecordingError(
            "neither a JPEG nor a PNG picture, nor TIFF, WebP, AVIF or BMP", path
        )
    header = read_header(data, path)
    width, height, orientation, bits = header.width, header.height, 1, 8
    if header.format == "png":
        bits = max(8, data[24])
    else:
        orientation = _jpeg_orientation(data)
        if orientation > 4:
            width, height = height, width
    return StillHeader(header.format, width, height, bits, orientation)


def _webp_size(data: bytes) -> tuple[int, int]:
    kind = data[12:16]
    if kind == b"VP8X":
        return (
            1 + int.from_bytes(data[24:27], "little"),
            1 + int.from_bytes(data[27:30], "little"),
        )
    if kind == b"VP8L":
        (packed,) = struct.unpack_from("<I", data, 21)
        return 1 + (packed & 0x3FFF), 1 + (packed >> 14 & 0x3FFF)
    width, height = struct.unpack_from("<HH", data, 26)
    return width & 0x3FFF, height & 0x3FFF


def _avif_size(data: bytes) -> tuple[int, int]:
    """Width and height of the first ``ispe`` box; the picture's own comes before its thumbnails'."""
    width, height = struct.unpack_from(">II", data, data.index(b"ispe", 0, 4096) + 8)
    return width, height


_SHORT = 3


def _tags(data: bytes, order: str, at: int) -> tuple[dict[int, int], int]:
    """The whole numbers of an image file directory, and where the next one is."""
    (count,) = struct.unpack_from(order + "H", data, at)
    found: dict[int, int] = {}
    for index in range(min(count, _MOST_TAGS)):
        tag, kind, many, value = struct.unpack_from(
            order + "HHII", data, at + 2 + 12 * index
        )
        if kind == _SHORT and many * 2 <= 4:
            (value,) = struct.unpack_from(order + "H", data, at + 2 + 12 * index + 8)
        found[tag] = value
    (following,) = struct.unpack_from(order + "I", data, at + 2 + 12 * count)
    return found, following


def _tiff(data: bytes, path: str | Path) -> StillHeader:
    order = "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    first: dict[int, int] = {}
    pages, seen = 0, set()
    while at and at not in seen:
        seen.add(at)
        tags, at = _tags(data, order, at)
        first = first or tags
        pages += 1
        if pages > _MOST_PAGES:
            raise RecordingError(f"a TIFF of over {_MOST_PAGES} pages", path)
    bits = first.get(_TIFF_BITS, 8)
    if bits > 64:  # three values or more: the number is where they lie
        (bits,) = struct.unpack_from(order + "H", data, bits)
    width, height = first.get(_TIFF_WIDTH, 0), first.get(_TIFF_HEIGHT, 0)
    return StillHeader("tiff", width, height, max(8, bits), pages=pages)


def _jpeg_orientation(data: bytes) -> int:
    at = 2
    while at + 4 <= len(data) and data[at] == 0xFF and data[at + 1] not in (0xDA, 0xD9):
        (length,) = struct.unpack_from(">H", data, at + 2)
        if data[at + 1] == 0xE1 and data[at + 4 : at + 10] == b"Exif\x00\x00":
            exif = data[at + 10 : at + 2 + length]
            try:
                order = "<" if exif[:2] == b"II" else ">"
                (start,) = struct.unpack_from(order + "I", exif, 4)
                value = _tags(exif, order, start)[0].get(_EXIF_ORIENTATION, 1)
            except struct.error:
                return 1
            return value if 1 <= value <= 8 else 1
        at += 2 + length
    return 1


def decode_still(
    data: bytes,
    header: StillHeader,
    *,
    bits: int = 16,
    path: str | Path = "",
    limits: Limits = DEFAULT_LIMITS,
) -> Image:
    """A still picture's pixels, upright, (height, width, 3) uint8 BGR.

    ``bits`` says how many bits the values of a picture of more than eight fill.

    Raises:
        LimitError: it claims too many pixels.
        RecordingError: it is damaged.
    """
    check_size(header.width, header.height, path, limits)
    if header.as_is:
        return decode_picture(data, path=path, limits=limits)
    return to_bgr(stored_values(data, header, path), header.orientation, bits)


def stored_page(data: bytes, header: StillHeader, page: int, path: str | Path = "") -> Any:
    """One page of a TIFF as it is stored.

    Raises:
        RecordingError: it is damaged.
    """
    try:
        done, found = cv2.imdecodemulti(
            np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED, range=(page, page + 1)
        )
    except (cv2.error, TypeError):
        done, found = False, ()
    if not done or not found:
        raise RecordingError(f"page {page + 1} of {header.pages} cannot be decoded", path)
    return found[0]


def stored_values(data: bytes, header: StillHeader, path: str | Path) -> Any:
    """A picture as it is stored: of as many bits and channels as it has.

    Raises:
        RecordingError: it is damaged.
    """
    if header.format in ("jpeg", "png") and not is_whole(data, header.format):
        raise RecordingError(f"a {header.format} picture that is cut off", path)
    flags = cv2.IMREAD_UNCHANGED if header.bits > 8 else cv2.IMREAD_COLOR
    return decoded_bytes(data, flags, header.format, path)


def bits_used(values: Any) -> int:
    """How many bits the largest value fills: 8 to 16; 16 for anything but whole numbers."""
    if values.dtype.kind != "u":
        return 16
    return even_bits(int(values.max(initial=0)))


def even_bits(largest: int) -> int:
    """The bits of the smallest camera that gives such a value: 8, 10, 12, 14 or 16.

    >>> even_bits(200), even_bits(3000), even_bits(60000)
    (8, 12, 16)
    """
    bits = largest.bit_length()
    return min(16, max(8, bits + bits % 2))


def to_bgr(values: Any, orientation: int = 1, bits: int = 16) -> Image:
    """Stored values as (height, width, 3) uint8 BGR: the upper eight of ``bits``, turned upright."""
    if values.dtype == np.uint16:
        values = np.minimum(values >> (bits - 8), 255).astype(np.uint8)
    elif values.dtype != np.uint8:
        # Numbers that say no range of their own (floats): spread over what is there.
        finite = np.nan_to_num(values.astype(np.float64), posinf=0.0, neginf=0.0)
        low, high = float(finite.min()), float(finite.max())
        values = ((finite - low) * (255.0 / max(high - low, 1e-12))).astype(np.uint8)
    if values.ndim == 2:
        values = cv2.cvtColor(values, cv2.COLOR_GRAY2BGR)
    elif values.shape[2] == 4:
        values = cv2.cvtColor(values, cv2.COLOR_BGRA2BGR)
    return np.ascontiguousarray(upright(values, orientation))


def upright(image: Any, orientation: int) -> Any:
    """A picture turned and mirrored as EXIF's orientation says."""
    if orientation > 4:
        image = image.transpose(1, 0, 2)
    if orientation in (2, 3, 6, 7):
        image = image[:, ::-1]
    if orientation in (3, 4, 7, 8):
        image = image[::-1]
    return image
