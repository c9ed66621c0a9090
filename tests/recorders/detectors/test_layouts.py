"""Which family a model is of, by the shapes of its outputs."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from recorders.detectors.layouts import ALIASES, FEEDING, FORMATS, Output, recognise

SIZE = (96, 96)
CELLS = 144 + 36 + 9
FOUR = CELLS + 4


def outputs(**shapes: Any) -> list[Output]:
    return [Output.of(name, np.zeros(shape)) for name, shape in shapes.items()]


@pytest.mark.parametrize(
    ("shapes", "family", "classes"),
    [
        ({"output": (1, 3 * CELLS, 85)}, "yolov5", 80),
        ({"output": (1, 3 * FOUR, 85)}, "yolov5", 80),
        ({"output": (1, 3 * CELLS, 85), "a": (1, 3, 12, 12, 85)}, "yolov5", 80),
        ({"output0": (1, 84, CELLS)}, "yolov8", 80),
        ({"output0": (1, 5, CELLS)}, "yolov8", 1),
        ({"output0": (1, 84, FOUR)}, "yolov8", 80),
        ({"output": (1, CELLS, 85)}, "yolox", 80),
        ({"output": (1, CELLS, 6)}, "yolox", 1),
        ({"output0": (1, 300, 6)}, "end2end", 80),
        ({"output": (12, 7)}, "end2end", 80),
        ({"output0": (1, 300, 84)}, "detr", 80),
        ({"logits": (1, 300, 80), "pred_boxes": (1, 300, 4)}, "detr", 80),
        ({"logits": (1, 100, 92), "pred_boxes": (1, 100, 4)}, "detr", 91),
        ({"dets": (1, 300, 4), "labels": (1, 300, 91)}, "rfdetr", 91),
        ({"boxes": (0, 4), "labels": (0,), "scores": (0,)}, "ssd", 91),
        ({"boxes": (1, 20, 4), "labels": (1, 20), "scores": (1, 20)}, "ssd", 91),
        ({"detection_out": (1, 1, 20, 7)}, "ssd", 91),
        ({"scores": (1, 3000, 21), "boxes": (1, 3000, 4)}, "ssd", 21),
        ({"758": (1, 85, 6, 6)}, "fastestdet", 80),
        ({"output": (1, FOUR, 112)}, "nanodet", 80),
        ({"output": (1, CELLS, 112)}, "nanodet", 80),
    ],
)
def test_recognised(shapes: dict[str, tuple[int, ...]], family: str, classes: int) -> None:
    layout = recognise(outputs(**shapes), SIZE)
    assert layout is not None
    assert (layout.family, len(layout.names)) == (family, classes)


@pytest.mark.parametrize(
    "shapes",
    [
        {"output": (1, 1000)},  # a classifier
        {"output": (1, 6)},
        {"output": (1, 7)},
        {"output": (1, 21, 96, 96)},  # a segmentation
        {"output": (1, 512)},
        {"output": ()},
    ],
)
def test_what_is_no_detector_is_told_apart(shapes: dict[str, tuple[int, ...]]) -> None:
    arrays = [Output.of(name, np.ones(shape)) for name, shape in shapes.items()]
    assert recognise(arrays, SIZE) is None


def test_names_say_how_many_rows_are_classes() -> None:
    found = outputs(output0=(1, 4 + 2 + 32, CELLS))
    layout = recognise(found, SIZE, ["cat", "dog"])
    assert layout is not None
    assert layout.names == ("cat", "dog")
    found[0].values[:, 0] = [40, 40, 10, 10, 0.0, 0.6, *[5.0] * 32]
    assert layout.decode(found, SIZE, 0.25).classes.tolist() == [1]


def test_turned_output_where_the_names_tell() -> None:
    layout = recognise(outputs(output0=(1, CELLS, 6)), SIZE, ["cat", "dog"])
    assert layout is not None
    assert layout.family == "yolov8"


def test_a_forced_family_fits_or_not() -> None:
    found = outputs(output=(1, CELLS, 85))
    forced = recognise(found, SIZE, family="yolov5")
    assert forced is not None
    assert forced.family == "yolov5"
    assert recognise(found, SIZE, family="fastestdet") is None


def test_every_family_is_fed_and_every_alias_is_a_family() -> None:
    assert sorted(FEEDING) == sorted(FORMATS)
    assert set(ALIASES.values()) <= set(FORMATS)
