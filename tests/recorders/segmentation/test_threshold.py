"""The threshold segmenter: animals on a smooth ground, touching ones told apart."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from recorders.pictures import Image
from recorders.segmentation import SEGMENTERS, SegmentationParameters, Segmenter
from recorders.segmentation.threshold import otsu
from recorders.segmentation.touching import split
from recorders.sources import open_source
from recorders.vision import cv2


def tank(
    *animals: tuple[int, int, float], bright: int = 200, ground: int = 20, size: int = 256
) -> Image:
    """Ellipses (x, y, angle in degrees) of 40 x 16 px on a smooth slope of light with noise."""
    y, _ = np.mgrid[0:size, 0:size]
    grey = (ground + 20 * y / size).astype(np.uint8)
    for x, yy, angle in animals:
        cv2.ellipse(grey, (x, yy), (20, 8), angle, 0, 360, bright, -1)
    noise = np.random.default_rng(len(animals)).integers(0, 6, grey.shape, dtype=np.uint8)
    return np.asarray(cv2.cvtColor(cv2.add(grey, noise), cv2.COLOR_GRAY2BGR), np.uint8)


def segmenter(size: int = 256) -> Segmenter:
    return SEGMENTERS["threshold"](SegmentationParameters(), size, size, 25.0)


def test_still_animals_are_found_brighter_and_darker() -> None:
    for bright, ground in ((200, 20), (20, 180)):
        got = segmenter().segment(
            0, tank((60, 60, 0), (180, 150, 70), bright=bright, ground=ground)
        )
        assert len(got.detections.boxes) == 2
        assert got.detections.boxes[0] == pytest.approx((40, 52, 41, 17), abs=3)
        assert got.detections.ellipses[1].theta == pytest.approx(np.deg2rad(70), abs=0.05)
        assert got.detections.scores == [1.0, 1.0]


def test_touching_animals_share_a_blob_and_have_a_box_each() -> None:
    apart = [tank((60, 60, 0), (180, 150 + k, 70)) for k in range(8)]
    touching = tank((100, 100, 0), (127, 113, 80))
    s = segmenter()
    s.prepare(iter([*apart, touching]))
    d = s.segment(0, touching).detections
    assert len(d.components) == 1
    assert d.blobs == [1, 1]
    centres = sorted((e.x, e.y) for e in d.ellipses)
    assert centres[0] == pytest.approx((100, 100), abs=6)
    assert centres[1] == pytest.approx((127, 113), abs=6)
    assert max(d.scores) < 1


def test_pixels_are_shared_out_completely_and_once() -> None:
    grey = tank((100, 100, 0), (127, 113, 80))[..., 0]
    own = (grey > 100).astype(np.uint8) * np.uint8(255)
    parts = split(own, own, 500.0)
    assert len(parts) == 2
    assert np.array_equal(sum((p > 0).astype(int) for p in parts), (own > 0).astype(int))


def test_a_body_is_not_split_where_no_size_is_known() -> None:
    own = np.full((30, 90), 255, np.uint8)
    assert len(split(own, own, 0.0)) == 1


def test_otsu_is_that_of_opencv() -> None:
    image = np.concatenate(
        [np.random.default_rng(1).normal(m, 12, 4000) for m in (60, 170)]
    )
    image = np.clip(image, 0, 255).astype(np.uint8).reshape(80, 100)
    level, _ = cv2.threshold(image, 0, 255, cv2.THRESH_OTSU)
    assert otsu(np.bincount(image.ravel(), minlength=256)) == level
    assert otsu(np.zeros(256, np.int64)) == 0


@pytest.mark.real
@pytest.mark.parametrize(("name", "animals"), [("two_flies", 2), ("three_flies", 3)])
def test_flies_in_touch_are_counted_right(real_data: Path, name: str, animals: int) -> None:
    images = [
        np.asarray(f.image)
        for f in itertools.islice(
            open_source(real_data / "flies" / f"{name}.mp4").frames(), 0, 120, 6
        )
    ]
    s = segmenter(1024)
    s.prepare(iter(images))
    results = [s.segment(k, image).detections for k, image in enumerate(images)]
    assert [len(d.boxes) for d in results] == [animals] * len(images)
    assert any(len(d.components) < animals for d in results)
