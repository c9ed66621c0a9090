"""Folders of pictures as people have them."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from recorders.errors import UsageError
from recorders.pictures import encode_jpeg
from recorders.sources import Source, SourceFrame, open_source
from tests.cases.conftest import Case


def read(path: Path) -> tuple[Source, list[SourceFrame]]:
    source = open_source(path)
    frames = list(source.frames())
    return source, frames


@pytest.mark.parametrize(
    ("kind", "frames", "size", "told"),
    [
        ("gap", 57, (320, 240), ""),
        ("mixed", 60, (320, 240), "6 pictures have the name of another"),
        ("sizes", 60, (320, 240), "30 pictures of another size were scaled to 320x240"),
        ("unicode", 60, (320, 240), ""),
        ("upper", 60, (320, 240), ""),
        ("tiff", 60, (320, 240), ""),
        ("bmp", 60, (320, 240), ""),
        ("webp", 60, (320, 240), ""),
        ("png16", 60, (320, 240), ""),
        ("png1", 60, (320, 240), ""),
        ("palette", 60, (320, 240), ""),
        ("alpha", 60, (320, 240), ""),
        ("gray", 60, (320, 240), ""),
        ("cmyk", 60, (320, 240), ""),
        ("exif", 60, (240, 320), ""),
        ("broken", 59, (320, 240), "a jpeg picture that is cut off, at 000030.jpg"),
        ("empty", 59, (320, 240), "the file is empty"),
        ("lastempty", 59, (320, 240), "the file is empty"),
        ("text", 59, (320, 240), "neither a JPEG nor a PNG picture"),
        ("one", 1, (320, 240), ""),
        ("mac", 60, (320, 240), ""),
        ("seq", 60, (320, 240), ""),
        ("interlaced", 60, (320, 240), ""),
        ("progressive", 60, (320, 240), ""),
    ],
)
def test_every_kind_of_folder(
    case: Case, kind: str, frames: int, size: tuple[int, int], told: str
) -> None:
    source, found = read(case("video/f_folder", kind))
    assert len(found) == frames
    assert (source.width, source.height) == size
    for frame in (found[0], found[-1]):
        assert frame.image is not None
        assert frame.image.shape == (size[1], size[0], 3)
        assert kind == "png1" or 40 < float(frame.image.mean()) < 200
    losses = " ".join(source.losses)
    assert (told in losses) if told else not losses


def test_deep_pictures_are_scaled_by_what_they_fill_and_it_is_said(case: Case) -> None:
    source, found = read(case("video/f_folder", "png16"))
    _, gray = read(case("video/f_folder", "gray"))
    assert found[0].image is not None
    assert gray[0].image is not None
    apart = found[0].image.astype(int) - gray[0].image.astype(int)
    assert abs(apart).max() <= 2
    assert "pictures of 16 bits whose values fill 12: the upper 8 of those are kept" in (
        source.notes
    )


def test_names_that_are_times_are_the_times(case: Case) -> None:
    source, found = read(case("video/f_timenames"))
    times = [f.time_ns for f in found]
    assert times == sorted(times)
    assert len(times) == 200
    assert all(abs(t - k * 40_000_000) < 1_000_000 for k, t in enumerate(times))
    assert source.notes == ["times are those in the pictures' names"]


def test_several_series_are_asked_about_and_one_can_be_chosen(tmp_path: Path) -> None:
    picture = encode_jpeg(np.full((30, 40, 3), 90, np.uint8))
    for camera in ("left", "right"):
        for k in range(3):
            (tmp_path / f"{camera}_{k}.jpg").write_bytes(picture)
    with pytest.raises(UsageError, match="2 series of pictures with the same numbers"):
        open_source(tmp_path)
    assert len(list(open_source(tmp_path / "left_*").frames())) == 3


@pytest.mark.parametrize(
    ("names", "seconds"),
    [
        ([f"2026-01-31_12-00-{2 * k:02d}" for k in range(5)], [0.0, 2.0, 4.0, 6.0, 8.0]),
        ([f"cam1_20260131T1200{5 * k:02d}" for k in range(3)], [0.0, 5.0, 10.0]),
        ([f"IMG_20260131_120000_{40 * k:03d}" for k in range(4)], [0.0, 0.04, 0.08, 0.12]),
        ([f"20260131_120000_{k:03d}" for k in range(4)], [0.0, 0.04, 0.08, 0.12]),
        ([f"20269931_120000_{40 * k:03d}" for k in range(2)], [0.0, 0.04]),
    ],
    ids=["dashes", "compact", "milliseconds", "counter", "impossible"],
)
def test_dates_in_names_are_times(
    tmp_path: Path, names: list[str], seconds: list[float]
) -> None:
    picture = cv2.imencode(".jpg", np.full((48, 64, 3), 90, np.uint8))[1].tobytes()
    for name in names:
        (tmp_path / f"{name}.jpg").write_bytes(picture)
    source = open_source(tmp_path)
    assert [frame.time_ns / 1e9 for frame in source.frames()] == seconds


def test_a_large_tiff_of_colours_has_eight_bits(tmp_path: Path) -> None:
    noise = np.random.default_rng(1).integers(0, 255, (160, 200, 3)).astype(np.uint8)
    for k in range(2):
        (tmp_path / f"{k}.tif").write_bytes(cv2.imencode(".tif", noise)[1].tobytes())
    source = open_source(tmp_path, fps=25)
    assert not any("bits" in note for note in source.notes)
    for frame in source.frames():
        assert frame.image is not None
        assert (frame.image == noise).all()


@pytest.mark.skipif(not cv2.haveImageWriter("a.avif"), reason="OpenCV has no AVIF")
def test_pictures_in_avif(tmp_path: Path) -> None:
    shades = [60, 120, 180]
    for k, shade in enumerate(shades):
        picture = cv2.imencode(".avif", np.full((48, 64, 3), shade, np.uint8))[1]
        (tmp_path / f"{k}.avif").write_bytes(picture.tobytes())
    source = open_source(tmp_path, fps=25)
    assert (source.width, source.height) == (64, 48)
    found = [frame.image for frame in source.frames()]
    assert [round(float(i.mean())) for i in found if i is not None] == pytest.approx(
        shades, abs=2
    )
