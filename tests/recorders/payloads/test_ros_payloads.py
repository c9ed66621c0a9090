"""ROS payloads by their own definitions, built by hand; damaged ones are refused, never believed."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from recorders.log import ChannelInfo, Schema
from recorders.payloads import PayloadError, RawPicture, read_picture
from recorders.payloads.pictures import bits_used, raw_pixels
from recorders.payloads.ros import DefinitionError, decode, parse_definitions

SEPARATOR = "=" * 80
IMAGE = f"""std_msgs/Header header
uint32 height
uint32 width
string encoding  # how pixels are stored
uint8 is_bigendian
uint32 step
uint8[] data
uint8 LEFT=0
{SEPARATOR}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""


def text(value: str) -> bytes:
    data = value.encode() + b"\0"
    return struct.pack("<I", len(data)) + data


def padded(data: bytes, size: int) -> bytes:
    return data + bytes(-len(data) % size)


def image(encoding: str, width: int, height: int, step: int, data: bytes) -> bytes:
    """A sensor_msgs/Image in little-endian CDR."""
    body = struct.pack("<iI", 5, 7) + text("camera")
    body = padded(body, 4) + struct.pack("<II", height, width) + text(encoding) + b"\0"
    body = padded(body, 4) + struct.pack("<II", step, len(data)) + data
    return b"\0\1\0\0" + body


CHANNEL = ChannelInfo(
    "/image", Schema("sensor_msgs/msg/Image", "ros2msg", IMAGE.encode()), "cdr"
)


def test_a_picture_with_room_behind_its_rows() -> None:
    rows = b"".join(bytes(range(6)) + b"\xff\xff" for _ in range(2))
    found = read_picture(CHANNEL, image("bgr8", 2, 2, 8, rows))
    assert isinstance(found, RawPicture)
    assert (found.stamp_ns, found.frame_id, found.step) == (5_000_000_007, "camera", 8)
    assert raw_pixels(found).tolist() == [[[0, 1, 2], [3, 4, 5]]] * 2


@pytest.mark.parametrize(
    ("encoding", "size"),
    [
        ("rgb8", 3), ("bgr8", 3), ("bgra8", 4), ("rgba8", 4), ("mono8", 1), ("bayer_rggb8", 1),
        ("bayer_grbg8", 1), ("yuv422", 2), ("yuv422_yuy2", 2), ("mono16", 2), ("16UC1", 2),
    ],
)  # fmt: skip
def test_every_encoding_of_an_even_grey_is_that_grey(encoding: str, size: int) -> None:
    value = b"\x80" if size != 2 or encoding.startswith("yuv") else b"\x00\x80"
    data = value * (8 * 6 * size // len(value))
    found = read_picture(CHANNEL, image(encoding, 8, 6, 8 * size, data))
    assert isinstance(found, RawPicture)
    pixels = raw_pixels(found)
    assert pixels.shape == (6, 8, 3)
    assert np.abs(pixels.astype(int) - 128).max() <= 3


def test_colours_are_not_exchanged() -> None:
    red = read_picture(CHANNEL, image("rgb8", 2, 1, 6, bytes([200, 10, 20] * 2)))
    assert isinstance(red, RawPicture)
    assert raw_pixels(red)[0, 0].tolist() == [20, 10, 200]
    # A red filter at the left upper corner.
    mosaic = np.zeros((8, 8), np.uint8)
    mosaic[::2, ::2] = 200
    bayer = read_picture(CHANNEL, image("bayer_rggb8", 8, 8, 8, mosaic.tobytes()))
    assert isinstance(bayer, RawPicture)
    middle = raw_pixels(bayer)[2:6, 2:6].reshape(-1, 3).mean(axis=0)
    assert middle[2] > 150 > 50 > middle[0]


@pytest.mark.parametrize(
    ("encoding", "step", "data", "told"),
    [
        ("bgr8", 6, bytes(11), "too few for 2 x 2 pixels"),
        ("bgr8", 2, bytes(99), "too few for 2 x 2 pixels"),
        ("64FC1", 16, bytes(32), "pixels in '64FC1' cannot be shown"),
    ],
)
def test_what_is_no_picture_is_named(
    encoding: str, step: int, data: bytes, told: str
) -> None:
    found = read_picture(CHANNEL, image(encoding, 2, 2, step, data))
    assert isinstance(found, RawPicture)
    with pytest.raises(PayloadError, match=told):
        raw_pixels(found)


def test_lengths_are_held_against_the_bytes_that_are_there() -> None:
    whole = image("bgr8", 2, 2, 6, bytes(12))
    huge = whole.replace(struct.pack("<I", 12) + bytes(12), struct.pack("<I", 2**31))
    with pytest.raises(PayloadError, match="bytes are said to follow"):
        read_picture(CHANNEL, huge)


@given(st.binary(max_size=200))
def test_any_bytes_are_read_or_refused(data: bytes) -> None:
    definitions = parse_definitions("sensor_msgs/msg/Image", IMAGE)
    for payload in (data, b"\0\1\0\0" + data):
        for ros1 in (False, True):
            try:
                decode("sensor_msgs/msg/Image", definitions, payload, ros1)
            except DefinitionError:
                continue


@given(st.text(max_size=200))
def test_any_definition_is_read_or_refused(definition: str) -> None:
    try:
        found = parse_definitions("a/msg/B", definition)
        decode("a/msg/B", found, b"\0\1\0\0" + bytes(64))
    except DefinitionError:
        return


def test_a_type_within_itself_ends() -> None:
    with pytest.raises(DefinitionError, match="nested over"):
        decode("a/B", parse_definitions("a/B", "B inner"), b"\0\1\0\0" + bytes(64))


def test_distances_in_metres_are_shown_by_their_millimetres() -> None:
    metres = np.array([[0.5, np.nan], [4.0, np.inf]], np.float32)
    found = read_picture(CHANNEL, image("32FC1", 2, 2, 8, metres.tobytes()))
    assert isinstance(found, RawPicture)
    bits = bits_used(found)
    assert bits == 12
    assert raw_pixels(found, bits)[..., 0].tolist() == [[500 >> 4, 0], [4000 >> 4, 0]]
