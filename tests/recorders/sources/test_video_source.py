"""Video files: times, sizes, re-reading, sampling, damage."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest

from recorders.errors import LimitError, SourceError
from recorders.limits import Limits
from recorders.sources import open_source
from recorders.vision import cv2

MS = 1_000_000


def write_video(
    path: Path,
    pts: list[int],
    codec: str = "mpeg4",
    noise: int = 0,
    bframes: int = 0,
    tick: int = 1,
) -> Path:
    """A small video, 64 x 48: frame k has brightness 8 k + 16 and some noise, at pts[k] ms."""
    random = np.random.default_rng(0)
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.time_base = Fraction(tick, 1000)
        stream.codec_context.max_b_frames = bframes
        stream.codec_context.gop_size = 5
        for k, at in enumerate(pts):
            planes = np.full((72, 64), 128, np.uint8)
            planes[:48] = 8 * k + 16 + random.integers(0, noise + 1, (48, 64))
            frame = av.VideoFrame.from_ndarray(planes, "yuv420p")
            frame.pts, frame.time_base = at // tick, Fraction(tick, 1000)
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


def test_presentation_times_are_the_files_own_counted_from_the_first_frame(
    tmp_path: Path,
) -> None:
    path = write_video(tmp_path / "a.mkv", [120, 160, 200, 300, 340])
    source = open_source(path)
    assert [f.time_ns for f in source.frames()] == [0, 40 * MS, 80 * MS, 180 * MS, 220 * MS]
    assert (source.width, source.height, source.frame_ns) == (64, 48, 40 * MS)
    assert source.losses == []


def test_a_given_rate_overrides_the_files_times(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mkv", [0, 40, 80, 180])
    source = open_source(path, fps="30000/1001")
    assert [f.time_ns for f in source.frames()] == [
        k * 1001 * 1_000_000_000 // 30000 for k in range(4)
    ]


def test_b_frames_come_in_the_order_in_which_they_are_shown(tmp_path: Path) -> None:
    for name, tick in (("a.mkv", 1), ("a.avi", 40), ("b.avi", 1)):
        path = write_video(
            tmp_path / name, [40 * k for k in range(12)], "libx264", bframes=2, tick=tick
        )
        source = open_source(path)
        frames = list(source.frames())
        brightness = [float(f.image.mean()) for f in frames if f.image is not None]
        assert brightness == sorted(brightness)
        assert [f.time_ns for f in frames] == [40 * MS * k for k in range(12)], name
        assert source.notes == []


def test_a_file_is_read_as_often_as_wanted_with_the_same_answers(tmp_path: Path) -> None:
    source = open_source(write_video(tmp_path / "a.mp4", [40 * k for k in range(10)]))
    first, second = ([(f.time_ns, f.image) for f in source.frames()] for _ in range(2))
    assert len(first) == 10
    for (t, a), (u, b) in zip(first, second, strict=True):
        assert t == u
        np.testing.assert_array_equal(a, b)


def test_a_sample_is_spread_over_the_whole_video(tmp_path: Path) -> None:
    source = open_source(write_video(tmp_path / "a.mp4", [40 * k for k in range(20)]))
    brightness = [float(i.mean()) for i in source.sample(10)]
    assert len(brightness) == 10
    assert brightness == sorted(brightness)
    assert brightness[-1] - brightness[0] > 100
    assert len(list(source.sample(4))) == 4, "key frames alone"
    assert len(list(source.sample(1000))) == 20


def test_a_cut_video_gives_what_is_whole_and_says_what_is_missing(tmp_path: Path) -> None:
    whole = write_video(
        tmp_path / "whole.avi", [40 * k for k in range(20)], noise=60, tick=40
    )
    cut = tmp_path / "cut.avi"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size * 6 // 10])
    source = open_source(cut)
    frames = list(source.frames())
    assert 0 < len(frames) < 20
    assert any("announces 20 frames" in loss for loss in source.losses)


def test_the_real_recordings_are_read_whole(real_data: Path) -> None:
    expected = {
        "pets09-s2l1/video.avi": (795, 480, 360, 100 * MS),
        "caviar-corridor/OneLeaveShopReenter1cor.mpg": (390, 384, 288, 40 * MS),
        "caviar-corridor/EnterExitCrossingPaths1cor.mpg": (383, 384, 288, 40 * MS),
        "tud-campus/video.mp4": (71, 640, 480, 40 * MS),
        "flies/two_flies.mp4": (128, 1024, 1024, 40 * MS),
    }
    for name, (count, width, height, frame_ns) in expected.items():
        source = open_source(real_data / name)
        times = [f.time_ns for f in source.frames()]
        assert (len(times), source.width, source.height, source.frame_ns) == (
            count,
            width,
            height,
            frame_ns,
        ), name
        assert source.losses == []
        assert times[0] == 0
        assert times == sorted(set(times))


def test_pictures_equal_what_opencv_decodes(real_data: Path) -> None:
    path = real_data / "pets09-s2l1/video.avi"
    reader = cv2.VideoCapture(str(path))
    for frame, _ in zip(open_source(path).frames(), range(10), strict=False):
        assert frame.image is not None
        difference = np.abs(reader.read()[1].astype(int) - frame.image)
        assert difference.max() <= 3, "up to the rounding of the colours' conversion"


def test_pictures_over_the_limits_are_refused(tmp_path: Path) -> None:
    path = write_video(tmp_path / "a.mp4", [0, 40])
    with pytest.raises(
        LimitError, match=r"over the limit of 1000 pixels \(max_picture_pixels\)"
    ):
        open_source(path, limits=Limits(max_picture_pixels=1000))


def test_no_video_in_the_container(tmp_path: Path) -> None:
    path = tmp_path / "sound.mka"
    with av.open(str(path), "w", format="matroska") as container:
        stream = container.add_stream("pcm_s16le", rate=8000)
        frame = av.AudioFrame.from_ndarray(
            np.zeros((1, 800), np.int16), format="s16", layout="mono"
        )
        frame.rate = 8000
        container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    with pytest.raises(SourceError, match="holds no video stream"):
        open_source(path)
