"""Folders of pictures: order, bytes kept, sizes, damage."""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from recorders.errors import LimitError, SourceError, UsageError
from recorders.limits import Limits
from recorders.pictures import encode_jpeg, encode_png
from recorders.sources import open_source


def picture(value: int, width: int = 40, height: int = 30) -> np.ndarray:
    return np.full((height, width, 3), value, np.uint8)


def test_pictures_come_by_number_and_byte_for_byte(tmp_path: Path) -> None:
    for k in (1, 2, 10, 9):
        (tmp_path / f"f{k}.jpg").write_bytes(encode_jpeg(picture(k * 20)))
    (tmp_path / "f11.PNG").write_bytes(encode_png(picture(220)))
    (tmp_path / "notes.txt").write_text("not a picture")
    source = open_source(tmp_path, fps=10)
    frames = list(source.frames())
    names = ["f1.jpg", "f2.jpg", "f9.jpg", "f10.jpg", "f11.PNG"]
    assert [f.encoded for f in frames] == [(tmp_path / n).read_bytes() for n in names]
    assert [f.format for f in frames] == ["jpeg"] * 4 + ["png"]
    assert [f.time_ns for f in frames] == [k * 100_000_000 for k in range(5)]
    assert [int(f.image[0, 0, 0]) for f in frames if f.image is not None] == [
        20,
        40,
        180,
        200,
        220,
    ]
    assert source.digests() == [
        (n, sha256((tmp_path / n).read_bytes()).hexdigest()) for n in names
    ]
    assert len(source.notes) == 1
    assert "1 to 11 with 6 missing" in source.notes[0]


def test_without_a_rate_one_is_assumed_and_said(tmp_path: Path) -> None:
    (tmp_path / "1.jpg").write_bytes(encode_jpeg(picture(9)))
    source = open_source(tmp_path)
    assert source.frame_ns == 40_000_000
    assert source.notes == [
        "no frame rate is known: assuming 25 frames per second; say it with --fps"
    ]


def test_another_size_is_scaled_and_told(tmp_path: Path) -> None:
    (tmp_path / "1.png").write_bytes(encode_png(picture(9)))
    (tmp_path / "2.png").write_bytes(encode_png(picture(9, 80, 60)))
    source = open_source(tmp_path, fps=1)
    frames = list(source.frames())
    assert [f.image.shape for f in frames if f.image is not None] == [(30, 40, 3)] * 2
    assert [f.encoded is None for f in frames] == [False, True]
    assert source.losses == [
        "1 pictures of another size were scaled to 40x30, the first is 2.png of 80x60"
    ]


def test_a_sample_is_spread_evenly(tmp_path: Path) -> None:
    for k in range(10):
        (tmp_path / f"{k}.png").write_bytes(encode_png(picture(k)))
    assert [int(i[0, 0, 0]) for i in open_source(tmp_path, fps=1).sample(5)] == [
        0,
        2,
        4,
        6,
        8,
    ]


def test_a_picture_that_is_cut_off_is_left_out_and_said(tmp_path: Path) -> None:
    data = encode_jpeg(picture(9))
    for k in (1, 2):
        (tmp_path / f"{k}.jpg").write_bytes(data)
    (tmp_path / "3.jpg").write_bytes(data[:-40])
    source = open_source(tmp_path, fps=1)
    assert len(list(source.frames())) == 2
    assert source.losses == ["a jpeg picture that is cut off, at 3.jpg"]
    (tmp_path / "4.jpg").write_bytes(data)
    source = open_source(tmp_path, fps=1)
    assert [f.index for f in source.frames()] == [0, 1, 3]
    assert source.losses == ["a jpeg picture that is cut off, at 3.jpg"]


@pytest.mark.parametrize(
    ("name", "data", "message"),
    [
        ("1.jpg", b"", "neither a JPEG nor a PNG"),
        ("1.jpg", b"hello", "neither a JPEG nor a PNG"),
        ("1.png", b"\x89PNG\r\n\x1a\n", "without a header"),
        ("1.jpg", b"\xff\xd8\xff\xe0\x00\x10JFIF", "without a header"),
    ],
)
def test_what_is_no_picture_is_named(
    tmp_path: Path, name: str, data: bytes, message: str
) -> None:
    (tmp_path / name).write_bytes(data)
    with pytest.raises(SourceError, match=message) as e:
        open_source(tmp_path, fps=1)
    assert str(tmp_path / name) in str(e.value)


def test_no_pictures_in_the_folder(tmp_path: Path) -> None:
    (tmp_path / "img1").mkdir()
    with pytest.raises(
        SourceError,
        match=r"no JPEG or PNG pictures in this folder \(.*\); it holds the folders img1",
    ):
        open_source(tmp_path)


def test_a_size_says_something_of_detections_only(tmp_path: Path) -> None:
    (tmp_path / "1.jpg").write_bytes(encode_jpeg(picture(9)))
    with pytest.raises(UsageError, match="--size says what size detections were made for"):
        open_source(tmp_path, size=(10, 10))


def test_limits_are_checked_from_the_header(tmp_path: Path) -> None:
    (tmp_path / "1.jpg").write_bytes(encode_jpeg(picture(9)))
    with pytest.raises(LimitError, match="max_picture_side"):
        open_source(tmp_path, fps=1, limits=Limits(max_picture_side=39))


def test_the_real_pictures(real_data: Path) -> None:
    source = open_source(real_data / "pets09-s2l1/img1", fps=7)
    frames = list(source.frames())
    assert (len(frames), source.width, source.height) == (300, 768, 576)
    assert frames[299].time_ns == 299 * 1_000_000_000 // 7
    assert frames[41].encoded == (real_data / "pets09-s2l1/img1/000042.jpg").read_bytes()
