"""Pictures as bytes: headers, JPEG and PNG, H.264."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from fractions import Fraction

import av
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders import pictures
from recorders.errors import LimitError, RecordingError, UsageError
from recorders.limits import Limits
from recorders.vision import cv2


def noise(width: int = 64, height: int = 48, seed: int = 0) -> np.ndarray:
    small = np.random.default_rng(seed).integers(
        0, 256, (height // 8, width // 8, 3), np.uint8
    )
    return np.asarray(
        cv2.resize(small, (width, height), interpolation=cv2.INTER_LINEAR), np.uint8
    )


@given(st.integers(1, 200), st.integers(1, 200), st.booleans())
def test_headers_give_the_size_without_decoding(
    width: int, height: int, grey: bool
) -> None:
    image = np.zeros((height, width) if grey else (height, width, 3), np.uint8)
    channels = 1 if grey else 3
    assert pictures.read_header(pictures.encode_png(image)) == pictures.PictureHeader(
        "png", width, height, channels
    )
    assert pictures.read_header(pictures.encode_jpeg(image)) == pictures.PictureHeader(
        "jpeg", width, height, channels
    )


def test_progressive_jpeg_and_leading_segments() -> None:
    data = bytes(cv2.imencode(".jpg", noise(), [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1])
    comment = b"\xff\xfe" + struct.pack(">H", 302) + b"\xff\xc0" * 150
    for found in (data, data[:2] + comment + data[2:], data[:2] + b"\xff\xff" + data[2:]):
        assert (pictures.read_header(found).width, pictures.read_header(found).height) == (
            64,
            48,
        )


def test_png_is_lossless_and_masks_keep_their_two_values() -> None:
    image = noise()
    np.testing.assert_array_equal(
        pictures.decode_picture(pictures.encode_png(image)), image
    )
    mask = np.where(image[..., 0] > 128, 255, 0).astype(np.uint8)
    data = pictures.encode_mask(mask)
    assert pictures.read_header(data).channels == 1
    np.testing.assert_array_equal(pictures.decode_picture(data, gray=True), mask)


def test_jpeg_is_near_and_the_same_each_time() -> None:
    data = pictures.encode_jpeg(noise())
    assert data == pictures.encode_jpeg(noise())
    assert np.abs(pictures.decode_picture(data).astype(int) - noise()).mean() < 4


def test_an_orientation_in_the_picture_does_not_turn_it() -> None:
    exif = b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    data = pictures.encode_jpeg(noise())
    turned = data[:2] + b"\xff\xe1" + struct.pack(">H", len(exif) + 2) + exif + data[2:]
    np.testing.assert_array_equal(
        pictures.decode_picture(turned), pictures.decode_picture(data)
    )


def test_claims_are_checked_before_decoding() -> None:
    png = bytearray(pictures.encode_png(noise()))
    png[16:24] = struct.pack(">II", 30_000, 30_000)
    with pytest.raises(
        LimitError,
        match=r"30000 x 30000 pixels, over the limit of 16384 a side \(max_picture_side\)",
    ):
        pictures.decode_picture(bytes(png), path="x.mcap")
    jpeg = pictures.encode_jpeg(noise())
    at = jpeg.index(b"\xff\xc0")
    jpeg = jpeg[: at + 5] + struct.pack(">HH", 10_000, 10_000) + jpeg[at + 9 :]
    with pytest.raises(
        LimitError, match=r"over the limit of 64000000 \(max_picture_pixels\)"
    ):
        pictures.decode_picture(jpeg)
    with pytest.raises(LimitError, match="limit of 1000 "):
        pictures.decode_picture(
            pictures.encode_png(noise()), limits=Limits(max_picture_pixels=1000)
        )


@pytest.mark.parametrize("encode", [pictures.encode_jpeg, pictures.encode_png])
def test_cut_and_damaged_pictures_are_errors(encode: Callable[..., bytes]) -> None:
    data = encode(noise())
    for end in (0, 1, 8, 20, len(data) // 2, len(data) - 3):
        with pytest.raises(RecordingError, match=r"neither|header|cut off|claims"):
            pictures.decode_picture(data[:end])


@given(
    st.binary(max_size=200),
    st.sampled_from(
        [b"", b"\xff\xd8", b"\x89PNG\r\n\x1a\n", b"\xff\xd8\xff\xc0\x00\x11\x08"]
    ),
)
def test_any_bytes_give_a_picture_or_our_error(tail: bytes, head: bytes) -> None:
    with pytest.raises(RecordingError):
        pictures.decode_picture(head + tail)


def moving(k: int) -> np.ndarray:
    image = noise(seed=3).copy()
    image[10:30, 2 * k : 2 * k + 10] = (20, 200, 90)
    return image


def test_h264_is_one_annex_b_frame_each_with_parameters_at_every_idr() -> None:
    encoder = pictures.VideoEncoder(64, 48, Fraction(7))
    data = [encoder.encode(moving(k % 25)) for k in range(120)]
    keys = [k for k, d in enumerate(data) if pictures.VideoDecoder.is_key(d)]
    assert keys == [0, 50, 100]
    for k, d in enumerate(data):
        kinds = [n[0] & 31 for n in d.replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")[1:]]
        assert d.startswith(b"\0\0")
        assert (7 in kinds and 8 in kinds) == (k in keys)
        assert sum(kind in (1, 5) for kind in kinds) == 1, (
            "one slice: one frame, one thread"
        )
    again = pictures.VideoEncoder(64, 48, Fraction(7))
    assert [again.encode(moving(k % 25)) for k in range(120)] == data


def test_h264_is_decoded_frame_by_frame_from_any_idr() -> None:
    encoder = pictures.VideoEncoder(64, 48)
    data = [encoder.encode(moving(k % 25)) for k in range(60)]
    decoder = pictures.VideoDecoder()
    images = [decoder.decode(d) for d in data]
    assert all(
        np.abs(i.astype(int) - moving(k % 25)).mean() < 8 for k, i in enumerate(images)
    )
    late = pictures.VideoDecoder()
    for k in range(50, 60):
        np.testing.assert_array_equal(late.decode(data[k]), images[k])
    assert decoder.decode(data[0]).shape == (48, 64, 3), "back to the start"


def test_h264_is_read_by_others() -> None:
    encoder = pictures.VideoEncoder(64, 48)
    context = av.CodecContext.create("h264", "r")
    frames = [
        f
        for k in range(10)
        for p in context.parse(encoder.encode(moving(k)))
        for f in context.decode(p)
    ]
    assert len(frames) >= 8
    assert {(f.width, f.height) for f in frames} == {(64, 48)}


def test_h264_needs_even_sides() -> None:
    with pytest.raises(
        UsageError, match="needs an even width and height, these pictures are 65 x 48"
    ):
        pictures.VideoEncoder(65, 48)


def test_damaged_h264_is_an_error() -> None:
    first = pictures.VideoEncoder(64, 48).encode(moving(0))
    for data in (b"", b"hello", first[: len(first) // 3]):
        with pytest.raises(RecordingError, match=r"H\.264"):
            pictures.VideoDecoder("x.mcap").decode(data)


def test_h264_over_the_limits_is_refused() -> None:
    first = pictures.VideoEncoder(64, 48).encode(moving(0))
    with pytest.raises(RecordingError):
        pictures.VideoDecoder(limits=Limits(max_picture_pixels=1000)).decode(first)
    with pytest.raises(LimitError, match="max_picture_side"):
        pictures.VideoDecoder(limits=Limits(max_picture_side=60)).decode(first)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (5, 7), (24, 32), (33, 65)])
@pytest.mark.parametrize(
    "filters",
    [cv2.IMWRITE_PNG_FILTER_NONE, cv2.IMWRITE_PNG_FILTER_SUB, cv2.IMWRITE_PNG_FILTER_UP],
)
@pytest.mark.parametrize("bilevel", [0, 1])
def test_masks_are_decoded_alike_however_they_were_encoded(
    height: int, width: int, filters: int, bilevel: int
) -> None:
    mask = (np.random.default_rng(height).random((height, width)) < 0.3).astype(
        np.uint8
    ) * np.uint8(255)
    options = [cv2.IMWRITE_PNG_BILEVEL, bilevel, cv2.IMWRITE_PNG_FILTER, filters]
    for data in (pictures.encode_mask(mask), bytes(cv2.imencode(".png", mask, options)[1])):
        assert np.array_equal(pictures.decode_picture(data, gray=True), mask)


def test_every_damage_of_a_mask_is_an_error_or_harmless() -> None:
    mask = np.zeros((24, 32), np.uint8)
    mask[3:9, 4:20] = 255
    data = pictures.encode_mask(mask)
    for at in range(len(data)):
        damaged = data[:at] + bytes([data[at] ^ 0x20]) + data[at + 1 :]
        with contextlib.suppress(RecordingError):
            assert np.array_equal(pictures.decode_picture(damaged, gray=True), mask)
    for end in range(len(data)):
        with pytest.raises(RecordingError):
            pictures.decode_picture(data[:end], gray=True)
