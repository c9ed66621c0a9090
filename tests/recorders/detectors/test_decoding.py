"""Boxes from tensors built by hand, one family after the other."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.detectors import decoding as d
from recorders.detectors.decoding import Decoded

SIZE = (96, 64)  # width, height: grids of 12x8, 6x4, 3x2 cells; 2x1 for stride 64
CELLS = 96 + 24 + 6
INSIDE = [[20.0, 8.0, 60.0, 40.0]]  # corners of what every test puts in


def only(found: Decoded, label: int, score: float) -> None:
    np.testing.assert_allclose(found.corners, INSIDE, atol=1e-6)
    assert found.classes.tolist() == [label]
    np.testing.assert_allclose(found.scores, [score], atol=1e-6)


def test_yolov5_multiplies_objectness_and_class() -> None:
    rows = np.zeros((3 * CELLS, 8))
    rows[7] = [40, 24, 40, 32, 0.8, 0.1, 0.5, 0.2]
    only(d.yolov5(rows, SIZE, 0.25), 1, 0.4)
    assert len(d.yolov5(rows, SIZE, 0.41).scores) == 0


def test_yolov5_as_shares_of_the_picture() -> None:
    rows = np.zeros((3 * CELLS, 7))
    rows[0] = [40 / 96, 24 / 64, 40 / 96, 32 / 64, 1.0, 0.0, 0.9]
    only(d.yolov5(rows, SIZE, 0.25), 1, 0.9)


def test_yolov8_has_no_objectness_and_passes_masks_over() -> None:
    columns = np.zeros((4 + 3 + 32, CELLS))
    columns[:, 5] = [40, 24, 40, 32, 0.1, 0.7, 0.3, *[9.0] * 32]
    only(d.yolov8(columns, SIZE, 0.25, classes=3), 1, 0.7)


def test_yolox_offsets_from_cells() -> None:
    rows = np.zeros((CELLS, 7))
    place = 96 + 24 + 1  # column 1, row 0 of the grid of stride 32
    rows[place] = [40 / 32 - 1, 24 / 32, np.log(40 / 32), 0.0, 0.9, 0.2, 1.0]
    only(d.yolox(rows, SIZE, 0.25), 1, 0.9)


def test_yolox_decoded_by_itself() -> None:
    cells, strides = d.grid(SIZE, d.STRIDES)
    rows = np.zeros((CELLS, 7))
    rows[:, :2] = (cells + 0.5) * strides[:, None]
    rows[:, 2:4] = 8
    rows[3] = [40, 24, 40, 32, 0.5, 1.0, 0.0]
    only(d.yolox(rows, SIZE, 0.25), 0, 0.5)


def test_end_to_end_rows_are_corners() -> None:
    rows = np.zeros((300, 6))
    rows[2] = [20, 8, 60, 40, 0.6, 3]
    only(d.end_to_end(rows, SIZE, 0.25), 3, 0.6)


def test_yolov7_end_to_end_has_the_class_before_the_score() -> None:
    only(d.end_to_end(np.array([[0, 20, 8, 60, 40, 5, 0.7]]), SIZE, 0.25), 5, 0.7)


def test_detr_in_one_tensor() -> None:
    rows = np.zeros((300, 7))
    rows[4] = [40 / 96, 24 / 64, 40 / 96, 32 / 64, 0.0, 0.3, 0.6]
    only(d.detr_rows(rows, SIZE, 0.25), 2, 0.6)


def test_detr_logits_of_each_class_for_itself() -> None:
    boxes = np.full((300, 4), 0.5)
    boxes[9] = [40 / 96, 24 / 64, 40 / 96, 32 / 64]
    logits = np.full((300, 80), -8.0)
    logits[9, 17] = np.log(0.75 / 0.25)
    only(d.detr(boxes, logits, SIZE, 0.25), 17, 0.75)


def test_detr_logits_with_a_class_for_nothing() -> None:
    boxes = np.full((100, 4), 0.5)
    boxes[1] = [40 / 96, 24 / 64, 40 / 96, 32 / 64]
    logits = np.zeros((100, 92))
    logits[:, 91] = 20.0
    logits[1, 1] = 40.0
    only(d.detr(boxes, logits, SIZE, 0.25), 1, 1.0)


def test_labelled_boxes_in_px_and_as_shares() -> None:
    for scale in (np.ones(4), np.array([96, 64, 96, 64])):
        boxes = np.array([[20.0, 8, 60, 40], [1, 1, 5, 5]]) / scale
        found = d.labelled(boxes, np.array([0.9, 0.1]), np.array([1, 2]), SIZE, 0.25)
        only(found, 1, 0.9)


def test_tensorflow_has_y_first() -> None:
    boxes = d.upright_first(np.array([[8.0, 20, 40, 60]]))
    only(d.labelled(boxes, np.array([0.9]), np.array([1.0]), SIZE, 0.25), 1, 0.9)


def test_ssd_rows_of_seven() -> None:
    rows = np.array([[0, 15, 0.8, 20 / 96, 8 / 64, 60 / 96, 40 / 64]])
    only(d.ssd_rows(rows, SIZE, 0.25), 15, 0.8)


def test_ssd_places_with_the_ground_as_first_class() -> None:
    boxes = np.zeros((2000, 4))
    boxes[:, 2:] = 0.1
    boxes[5] = [20 / 96, 8 / 64, 60 / 96, 40 / 64]
    classes = np.zeros((2000, 3))
    classes[:, 0] = 1.0
    classes[5] = [0.2, 0.1, 0.7]
    only(d.ssd_anchors(boxes, classes, SIZE, 0.25), 1, 0.7)


def test_fastestdet_cell_and_powers() -> None:
    size = (96, 64)
    planes = np.zeros((7, 4, 6))
    across, down = 40 / 16, 24 / 16  # the centre in cells
    planes[0, 1, 2] = 0.5
    planes[1:3, 1, 2] = np.arctanh([across - 2, down - 1])
    planes[3:5, 1, 2] = [np.log((s := 40 / 96) / (1 - s)), 0.0]
    planes[5:, 1, 2] = [0.1, 0.8]
    only(d.fastestdet(planes, size, 0.25), 1, 0.5**0.6 * 0.8**0.4)


@pytest.mark.parametrize(
    ("strides", "middle"), [(d.STRIDES_OF_FOUR, 0.0), (d.STRIDES, 0.5)]
)
def test_nanodet_sides_are_means_of_bins(strides: tuple[int, ...], middle: float) -> None:
    count = d.cells_of(SIZE, strides)
    rows = np.zeros((count, 2 + 32))
    rows[:, 2:] = np.tile([30.0] + [0.0] * 7, 4)
    cell = 4 * 12 + 5  # column 5, row 4 of the grid of stride 8
    x, y = (5 + middle) * 8, (4 + middle) * 8
    wanted = [(x - 20) / 8, (y - 8) / 8, (60 - x) / 8, (40 - y) / 8]
    for side, distance in enumerate(wanted):
        low = int(np.floor(distance))
        share = distance - low
        bins = np.full(8, -40.0)
        bins[low] = np.log(max(1e-12, 1 - share))
        bins[low + 1 : low + 2] = np.log(max(1e-12, share))
        rows[cell, 2 + 8 * side : 10 + 8 * side] = bins
    rows[cell, :2] = [0.3, 0.6]
    only(d.nanodet(rows, SIZE, 0.25), 1, 0.6)


def test_what_is_no_box_is_left_out() -> None:
    rows = np.zeros((300, 6))
    rows[0] = [np.nan, 8, 60, 40, 0.9, 0]
    rows[1] = [60, 8, 20, 40, 0.9, 0]
    rows[2] = [20, 8, 60, 40, np.inf, 0]
    rows[3] = [20, 8, 1e30, 40, 0.9, 0]
    rows[4] = [20, 8, 60, 40, 0.9, -1]
    assert len(d.end_to_end(rows, SIZE, 0.25).scores) == 0
