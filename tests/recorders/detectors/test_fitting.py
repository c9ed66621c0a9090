"""Pictures into a network's input, and boxes back."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.detectors.fitting import PADDING, Fit, Preparation, as_input, placement


@pytest.mark.parametrize("fit", ["letterbox", "corner", "stretch"])
@pytest.mark.parametrize("size", [(200, 100), (100, 200), (64, 64), (33, 57)])
def test_boxes_come_back_where_the_picture_is(fit: Fit, size: tuple[int, int]) -> None:
    width, height = size
    picture = np.zeros((height, width, 3), np.uint8)
    left, top, right, bottom = width // 4, height // 4, width // 2, 3 * height // 4
    picture[top:bottom, left:right] = 255
    prepared = Preparation(64, 64, fit)
    made = as_input(picture, prepared)[0, 0]
    rows, columns = np.nonzero((made > 0.6) & (made != np.float32(PADDING / 255)))
    found = np.array([[columns.min(), rows.min(), columns.max() + 1, rows.max() + 1]])
    x, y, w, h = placement(prepared, width, height).back(found)[0]
    px = 1.5 * max(width, height) / 64
    assert (x, y) == (pytest.approx(left, abs=px), pytest.approx(top, abs=px))
    assert (w, h) == (
        pytest.approx(right - left, abs=2 * px),
        pytest.approx(bottom - top, abs=2 * px),
    )


def test_letterbox_is_grey_beside_the_picture() -> None:
    made = as_input(np.zeros((32, 64, 3), np.uint8), Preparation(64, 64))
    assert made.shape == (1, 3, 64, 64)
    assert made.dtype == np.float32
    grey = np.float32(PADDING) / np.float32(255)
    assert (made[0, :, :16] == grey).all()
    assert (made[0, :, 16:48] == 0).all()
    assert (made[0, :, 48:] == grey).all()


def test_colours_mean_and_spread() -> None:
    blue = np.zeros((8, 8, 3), np.uint8)
    blue[..., 0] = 200
    made = as_input(blue, Preparation(8, 8, "stretch", mean=(0, 0, 100), spread=(1, 1, 50)))
    assert made[0, :, 0, 0].tolist() == [0, 0, 2]
    made = as_input(blue, Preparation(8, 8, "stretch", rgb=False, spread=(100, 1, 1)))
    assert made[0, :, 0, 0].tolist() == [2, 0, 0]


def test_whole_numbers_with_channels_last() -> None:
    picture = np.arange(8 * 8 * 3, dtype=np.uint8).reshape(8, 8, 3)
    made = as_input(picture, Preparation(8, 8, "stretch", channels_last=True, whole=True))
    assert made.dtype == np.uint8
    assert (made[0] == picture[..., ::-1]).all()
