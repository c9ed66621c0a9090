"""Videos after public reports: read as a player shows them, or said what is missing."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from recorders.errors import SourceError, UsageError
from recorders.sources import Source, SourceFrame, open_source
from tests.cases.conftest import Case


def read(path: Path | list[Path], **more: object) -> tuple[Source, list[SourceFrame]]:
    source = open_source(path, **more)  # type: ignore[arg-type]
    return source, list(source.frames())


def test_segments_with_a_clock_of_their_own_are_joined(case: Case) -> None:
    source, frames = read(case("video/t_ts_restart", suffix=".ts"))
    assert [f.time_ns for f in frames] == [k * 40_000_000 for k in range(200)]
    assert any("the clock was set back 1 time" in note for note in source.notes)


@pytest.mark.parametrize(("kind", "rate"), [("mjpeg", 25), ("hevc", 25), ("h264", 5)])
def test_a_bare_streams_rate_is_said(case: Case, kind: str, rate: int) -> None:
    source, frames = read(case("video/t_rawrate", kind, suffix=f".{kind}"))
    assert len(frames) == 60
    assert source.notes == [
        f"a bare stream without times: assuming {rate} frames per second; say it with --fps"
    ]
    assert read(case("video/t_rawrate", kind, suffix=f".{kind}"), fps=5)[0].notes == []


def test_a_gap_of_a_night_is_told(case: Case) -> None:
    source, frames = read(case("video/t_nightgap", "8", suffix=".mkv"))
    assert frames[50].time_ns - frames[49].time_ns == 8 * 3600 * 10**9 + 40_000_000
    assert source.notes == [
        "a gap of 28800 s (8 h 0 min) before frame 50: nothing was recorded then"
    ]
    assert source.losses == []


def test_a_cut_with_an_edit_list_loses_nothing(case: Case) -> None:
    source, frames = read(case("video/t_edit", suffix=".mp4"))
    assert len(frames) == 67
    assert source.losses == []


@pytest.mark.parametrize(
    ("kind", "suffix", "frames", "told"),
    [
        ("cutmp4", ".mp4", 18, "the file announces 100 frames, 18 could be read"),
        ("cutavi", ".avi", 60, "the file announces 100 frames, 60 could be read"),
        ("cutmkv", ".mkv", 21, "the file announces 4.00 s, its pictures end after 0.80 s"),
        ("midgop", ".ts", 50, "49 packets of the video before its first key frame"),
        ("rawmid", ".h264", 50, "49 packets of the video before its first key frame"),
        ("sizechange", ".ts", 200, "100 pictures of another size were scaled to 320x240"),
        ("one", ".mp4", 1, ""),
        ("two", ".mp4", 2, ""),
    ],
)
def test_broken_files_give_what_is_there_and_say_what_is_not(
    case: Case, kind: str, suffix: str, frames: int, told: str
) -> None:
    source, found = read(case("video/c_broken", kind, suffix=suffix))
    assert len(found) == frames
    assert all(f.image is not None for f in (found[0], found[-1]))
    losses = " ".join(source.losses)
    assert (told in losses) if told else not losses


def test_a_missing_index_is_named_with_what_to_do(case: Case) -> None:
    with pytest.raises(SourceError, match=r"index \(moov\) is missing: .*untrunc"):
        read(case("video/c_broken", "nomoov", suffix=".mp4"))


@pytest.mark.parametrize("kind", ["first", "coverfirst", "coverlast", "subs"])
def test_other_streams_and_covers_are_passed_by(case: Case, kind: str) -> None:
    source, frames = read(case("video/c_audio", kind, suffix=".mp4"))
    assert len(frames) == 100
    assert (source.width, source.losses) == (320, [])


def test_one_of_several_streams_can_be_chosen(case: Case) -> None:
    path = case("video/c_audio", "two", suffix=".mp4")
    source, _ = read(path)
    assert source.losses == [
        "1 of 2 video streams (0: 320x240 h264, 1: 640x480 h264): --stream N chooses one"
    ]
    source, frames = read(path, stream=1)
    assert (source.width, source.losses, len(frames)) == (640, [], 100)
    with pytest.raises(UsageError, match="has 2 video streams, numbered from 0"):
        read(path, stream=2)


@pytest.mark.parametrize("kind", ["only", "cover"])
def test_sound_alone_is_no_video(case: Case, kind: str) -> None:
    with pytest.raises(
        SourceError, match=r"holds (no|a cover picture, but no) video stream"
    ):
        read(case("video/c_audio", kind, suffix=".mp4"))


TURNS = {
    "90": lambda p: np.rot90(p, -1),
    "180": lambda p: np.rot90(p, 2),
    "270": lambda p: np.rot90(p, 1),
    "hflip": lambda p: p[:, ::-1],
    "vflip": lambda p: p[::-1],
}


@pytest.mark.parametrize("kind", TURNS)
def test_pictures_are_shown_as_the_display_matrix_says(case: Case, kind: str) -> None:
    _, plain = read(case("video/c_rotate", "0", suffix=".mp4"))
    _, turned = read(case("video/c_rotate", kind, suffix=".mp4"))
    assert plain[50].image is not None
    assert turned[50].image is not None
    assert np.array_equal(turned[50].image, TURNS[kind](plain[50].image))


def test_dahua_and_y4m(case: Case, tmp_path: Path) -> None:
    _, frames = read(case("video/c_dav", suffix=".dav"))
    assert [f.time_ns for f in frames] == [k * 40_000_000 for k in range(100)]
    raw = tmp_path / "a.y4m"
    head = b"YUV4MPEG2 W64 H48 F10:1 Ip A1:1 C420jpeg\n"
    raw.write_bytes(
        head + b"".join(b"FRAME\n" + bytes([90 + k]) * (64 * 48 * 3 // 2) for k in range(5))
    )
    source, frames = read(raw)
    assert (len(frames), source.frame_ns) == (5, 100_000_000)


@pytest.mark.parametrize(
    ("kind", "seconds", "notes"),
    [("dup", 3.96, 1), ("gap", 64.0, 1), ("late", 3.96, 0), ("ms", 3.3, 0)],
)
def test_odd_stamps(case: Case, kind: str, seconds: float, notes: int) -> None:
    source, frames = read(case("video/t_pts", kind, suffix=".mkv"))
    times = [f.time_ns for f in frames]
    assert len(times) == 100
    assert all(a < b for a, b in itertools.pairwise(times))
    assert times[-1] / 1e9 == pytest.approx(seconds, abs=0.1)
    assert (len(source.notes), source.losses) == (notes, [])


def test_a_variable_rate_keeps_its_times(case: Case) -> None:
    path = case("video/t_vfr", suffix=".mp4")
    wanted = [float(x) for x in Path(f"{path}.times").read_text().split()]
    _, frames = read(path)
    assert [f.time_ns / 1e9 for f in frames] == pytest.approx(wanted, abs=1e-4)


def test_several_videos_are_one_recording(case: Case) -> None:
    path = case("video/c_rotate", "0", suffix=".mp4")
    source, frames = read([path, path])
    assert [f.time_ns for f in frames] == [k * 40_000_000 for k in range(200)]
    assert [f.index for f in frames] == list(range(200))
    assert "2 videos are one recording" in source.notes[0]
    assert len(list(source.sample(20))) in range(15, 25)


_CODECS = {
    "h264": ".mp4", "hevc": ".mp4", "hevc10": ".mp4", "h26410": ".mp4", "h264_444": ".mp4", "vp9": ".webm",
    "vp8": ".webm", "mjpeg": ".avi", "prores": ".mov", "ffv1": ".mkv", "huffyuv": ".avi", "rawgray": ".avi",
    "gray": ".mkv", "gray16": ".mkv", "mpeg4": ".avi", "mpeg4b": ".mp4", "wmv2": ".wmv", "mpeg2": ".mpg",
    "png": ".mov", "flv": ".flv",
}  # fmt: skip


@pytest.mark.parametrize(("kind", "suffix"), _CODECS.items())
def test_codecs_and_pixel_formats(case: Case, kind: str, suffix: str) -> None:
    source, frames = read(case("video/v_codec", kind, suffix=suffix))
    assert (len(frames), source.width, source.height) == (100, 320, 240)
    plain = read(case("video/v_codec", "ffv1", suffix=".mkv"))[1]
    for k in (0, 50, 99):
        shown, wanted = frames[k].image, plain[k].image
        assert shown is not None
        assert wanted is not None
        if "gray" in kind:
            wanted = np.repeat(wanted.mean(axis=2, keepdims=True), 3, axis=2).astype(
                np.uint8
            )
        off = np.abs(shown.astype(int) - wanted.astype(int)).mean()
        assert off < 12, f"frame {k} is {off:.1f} levels off"


@pytest.mark.parametrize("kind", ["avi", "mjpeg"])
def test_a_garbled_picture_of_mjpeg_is_left_out_and_keeps_its_place(
    tmp_path: Path, kind: str
) -> None:
    from fixtures.streams import write_stream
    from recorders.sources import open_source

    video = write_stream(tmp_path / f"a.{kind}", kind, 12, codec="mjpeg")
    data = bytearray(video.read_bytes())
    starts = [k for k in range(len(data)) if data[k : k + 3] == b"\xff\xd8\xff"]
    middle = (starts[5] + starts[6]) // 2
    data[middle : middle + 60] = bytes(range(200, 230)) * 2
    video.write_bytes(data)
    source = open_source(video, fps=25)
    times = [round(frame.time_ns / 4e7) for frame in source.frames()]
    assert times == [k for k in range(12) if k != 5]
    assert "1 packets of the video cannot be decoded" in source.losses[0]
