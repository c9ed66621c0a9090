"""Videos as messages: every form in which packets come gives the pictures with their own times."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo

from recorders import channels
from recorders.log import LogWriter
from recorders.pictures import Image
from recorders.sources import open_source

FRAMES, STEP = 12, 40_000_000
T0 = 1_750_000_000_000_000_000


def shade(k: int) -> int:
    return 20 + 15 * k


def encoded(codec: str, **options: str) -> list[tuple[int, bytes]]:
    """Packets in the order of decoding, each with the number of its picture."""
    context: Any = av.CodecContext.create(codec, "w")
    context.width, context.height, context.pix_fmt = 64, 48, "yuv420p"
    context.time_base, context.gop_size = Fraction(1, 25), 6
    context.options = options
    packets = []
    for k in range(FRAMES):
        image = np.full((48, 64, 3), shade(k), np.uint8)
        frame = av.VideoFrame.from_ndarray(image, format="bgr24").reformat(format="yuv420p")
        frame.pts = k
        packets += context.encode(frame)
    return [(int(p.pts), bytes(p)) for p in packets + context.encode(None)]


def prefixed(data: bytes) -> bytes:
    """Units after their lengths, as MP4 has them."""
    units = re.split(b"\x00\x00\x00\x01|\x00\x00\x01", data)[1:]
    return b"".join(struct.pack(">I", len(unit)) + unit for unit in units)


def without_sets(data: bytes) -> bytes:
    units = re.split(b"\x00\x00\x00\x01|\x00\x00\x01", data)[1:]
    return b"".join(b"\x00\x00\x00\x01" + u for u in units if u[0] & 31 not in (6, 7, 8))


def sets_of(data: bytes) -> bytes:
    units = re.split(b"\x00\x00\x00\x01|\x00\x00\x01", data)[1:]
    return b"".join(b"\x00\x00\x00\x01" + u for u in units if u[0] & 31 in (7, 8))


def recorded(path: Path, packets: list[tuple[int, bytes]], name: str) -> list[Image | None]:
    """The pictures that a log of these packets gives, and their times are held to be 40 ms apart."""
    with LogWriter(path) as log:
        schema = channels.schema("video")
        channel = log.channel("/front/video", schema, "protobuf")
        for k, (number, data) in enumerate(packets):
            message = CompressedVideo(data=data, format=name)
            message.timestamp.FromNanoseconds(T0 + number * STEP)
            log.write(channel, message.SerializeToString(), T0 + k * STEP)
    source = open_source(path)
    frames = list(source.frames())
    assert [f.time_ns for f in frames] == [k * STEP for k in range(len(frames))]
    return [frame.image for frame in frames]


def shades(pictures: list[Image | None]) -> list[int | None]:
    """Which picture each is."""
    return [
        None if p is None else round((float(np.asarray(p).mean()) - 20) / 15)
        for p in pictures
    ]


ZERO = {"tune": "zerolatency"}
X265 = {"x265-params": "log-level=0"}
FORMS: dict[str, tuple[str, dict[str, str], str, Callable[[bytes], bytes]]] = {
    "as it is": ("libx264", ZERO, "H.264", bytes),
    "lengths": ("libx264", ZERO, "h264_nvenc", prefixed),
    "B pictures": ("libx264", {"bf": "2"}, "h264", bytes),
    "open groups": ("libx265", X265, "h265", bytes),
    "hevc lengths": ("libx265", X265, "hevc_qsv", prefixed),
    "vp8": ("libvpx", {"lag-in-frames": "0"}, "vp8", bytes),
    "vp9": ("libvpx-vp9", {"lag-in-frames": "0"}, "libvpx-vp9", bytes),
    "av1": ("libsvtav1", {"preset": "12", "svtav1-params": "pred-struct=1"}, "av1", bytes),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_picture_has_its_time(tmp_path: Path, form: str) -> None:
    codec, options, name, changed = FORMS[form]
    if codec not in av.codecs_available:
        pytest.skip(f"FFmpeg is built without {codec}")
    packets = [(k, changed(data)) for k, data in encoded(codec, **options)]
    assert shades(recorded(tmp_path / "a.mcap", packets, name)) == list(range(FRAMES))


def test_parameter_sets_that_come_once(tmp_path: Path) -> None:
    packets = encoded("libx264", **ZERO)
    once = [(0, sets_of(packets[0][1]) + without_sets(packets[0][1]))]
    once += [(k, without_sets(data)) for k, data in packets[1:]]
    assert shades(recorded(tmp_path / "a.mcap", once, "h264")) == list(range(FRAMES))


def test_parameter_sets_that_never_come_are_named(tmp_path: Path) -> None:
    from recorders.errors import SourceError

    packets = [(k, without_sets(data)) for k, data in encoded("libx264", **ZERO)]
    with pytest.raises(SourceError, match="whose parameter sets are not in the log"):
        recorded(tmp_path / "a.mcap", packets, "h264")


def test_a_video_without_key_frames_is_entered_where_it_recovers(tmp_path: Path) -> None:
    parameters = "intra-refresh=1:keyint=4:bframes=0"
    packets = encoded("libx264", **ZERO, **{"x264-params": parameters})[1:]
    found = shades(recorded(tmp_path / "a.mcap", packets, "h264"))
    assert found[0] is not None
    assert 4 < found[0] < FRAMES - 1
    assert found == list(range(found[0], FRAMES))
