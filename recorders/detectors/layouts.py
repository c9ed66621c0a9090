"""Which family a model is of: by the shapes of what it puts out and what its file says of itself.

Each family has a name for `--model-format`, a way its pictures are made ready, and a function of
`recorders.detectors.decoding` for its output.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from recorders.detectors import decoding
from recorders.detectors.decoding import (
    BINS,
    STRIDES,
    STRIDES_OF_FOUR,
    Decoded,
    Floats,
    Size,
    cells_of,
)
from recorders.detectors.fitting import Fit
from recorders.detectors.names import COCO, coco_by_id, usual_names

FORMATS = (
    "yolov5", "yolov8", "end2end", "yolox", "detr", "rfdetr", "ssd", "fastestdet", "nanodet"
)  # fmt: skip
ALIASES = {
    "yolov6": "yolov5", "yolov7": "yolov5", "yolov9": "yolov8", "yolo11": "yolov8",
    "yolov11": "yolov8", "yolov12": "yolov8", "yolo12": "yolov8", "yolov10": "end2end",
    "yolo26": "end2end", "rtdetr": "detr", "rt-detr": "detr", "dfine": "detr", "d-fine": "detr",
    "rf-detr": "rfdetr", "torchvision": "ssd",
}  # fmt: skip
FASTESTDET_STRIDE = 16
MOST_QUERIES = 1000
"""Of as many rows or fewer, each is a thing that the network looked for; of more, a place."""
FEWEST_QUERIES = 50
"""Fewer rows than this are no queries: a classifier has one."""
SSD_AXES = 4
"""SSD's rows of seven come as (1, 1, N, 7), YOLOv7's as (N, 7)."""
_IMAGENET = (123.675, 116.28, 103.53), (58.395, 57.12, 57.375)


@dataclass(frozen=True)
class Output:
    """One output tensor of a run: name, values without axes of length 1 in front, and how many
    axes there were.
    """

    name: str
    values: Floats
    axes: int = 0

    @classmethod
    def of(cls, name: str, values: NDArray[np.generic]) -> Output:
        """From the array as a run gives it, (1, ...) or without that axis."""
        array = np.asarray(values, np.float64)
        axes = array.ndim
        while array.ndim > 2 and array.shape[0] == 1:
            array = array[0]
        return cls(name, array, axes)

    @property
    def shape(self) -> tuple[int, ...]:
        """Of the values."""
        return self.values.shape


Decode = Callable[[Sequence[Output], Size, float], Decoded]


@dataclass(frozen=True)
class Feeding:
    """What a family's pictures are like: see `recorders.detectors.fitting.Preparation`."""

    fit: Fit
    rgb: bool = True
    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    spread: tuple[float, float, float] = (255.0, 255.0, 255.0)


FEEDING: dict[str, Feeding] = {
    "yolov5": Feeding("letterbox"),
    "yolov8": Feeding("letterbox"),
    "end2end": Feeding("letterbox"),
    "yolox": Feeding("corner", False, spread=(1.0, 1.0, 1.0)),
    "detr": Feeding("stretch"),
    "rfdetr": Feeding("stretch", True, *_IMAGENET),
    "ssd": Feeding("stretch"),
    "fastestdet": Feeding("stretch", rgb=False),
    "nanodet": Feeding("stretch", False, _IMAGENET[0][::-1], _IMAGENET[1][::-1]),
}


@dataclass(frozen=True)
class Layout:
    """How a model is fed and read.

    Attributes:
        family: one of `FORMATS`.
        decode: its outputs, the input's (width, height) and the smallest score -> what it found.
        names: the classes.
        suppress: overlapping boxes are still to be thinned out.
        feeding: how its pictures are made ready, where not as its family's usually are.
    """

    family: str
    decode: Decode
    names: tuple[str, ...]
    suppress: bool
    feeding: Feeding | None = None

    @property
    def fed(self) -> Feeding:
        """How its pictures are made ready."""
        return self.feeding or FEEDING[self.family]


@dataclass(frozen=True)
class LayoutCase:
    """What a layout is recognised from: a run's outputs, the input's size, the classes as the file
    says them, and whether the family was said.
    """

    outputs: Sequence[Output]
    size: Size
    names: tuple[str, ...]
    forced: bool


def recognise(
    outputs: Sequence[Output],
    size: Size,
    names: Sequence[str] = (),
    family: str | None = None,
) -> Layout | None:
    """The layout of a model, None where its outputs fit none.

    Args:
        outputs: of a run over any picture.
        size: width and height of the model's input, px.
        names: its classes as its file says them.
        family: the family that it must be; None: whichever fits.
    """
    for known, fits in _KNOWN.items():
        if family not in (None, known):
            continue
        layout = fits(LayoutCase(outputs, size, tuple(names), family is not None))
        if layout is not None:
            return layout
    return None


def _yolov5(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    places = [3 * cells_of(case.size, STRIDES), 3 * cells_of(case.size, STRIDES_OF_FOUR)]
    if case.forced:
        places += [place // 3 for place in places]
    return _rows(outputs, "yolov5", decoding.yolov5, places, 5, names)


def _yolov8(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    places = cells_of(case.size, STRIDES), cells_of(case.size, STRIDES_OF_FOUR)
    for index, out in enumerate(outputs):
        if len(out.shape) != 2:
            continue
        turned = out.shape[0] in places and (case.forced or out.shape[1] == 4 + len(names))
        if (out.shape[1] not in places and not turned) or min(out.shape) < 5:
            continue
        channels = out.shape[1 if turned else 0]
        classes = min(len(names) or channels - 4, channels - 4)

        def decode(
            found: Sequence[Output],
            size: Size,
            least: float,
            k: int = index,
            turned: bool = turned,
            classes: int = classes,
        ) -> Decoded:
            values = found[k].values
            return decoding.yolov8(values.T if turned else values, size, least, classes)

        return Layout("yolov8", decode, names or usual_names(classes), suppress=True)
    return None


def _yolox(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    return _rows(outputs, "yolox", decoding.yolox, [cells_of(case.size, STRIDES)], 5, names)


def _nanodet(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    four, three = cells_of(case.size, STRIDES_OF_FOUR), cells_of(case.size, STRIDES)
    coco = 80 + 4 * BINS
    places = [
        len(output.values)
        for output in outputs
        if len(output.shape) == 2
        and (
            len(output.values) == four
            or (len(output.values) == three and (case.forced or output.shape[1] == coco))
        )
    ]
    return _rows(outputs, "nanodet", decoding.nanodet, places, 4 * BINS, names)


def _end_to_end(case: LayoutCase) -> Layout | None:
    for index, out in enumerate(case.outputs):
        if len(out.shape) != 2 or len(out.values) > MOST_QUERIES:
            continue
        six = out.shape[1] == 6 and (out.axes == 3 or case.forced)
        seven = out.shape[1] == 7 and out.axes == 2 and not out.values[:, 0].any()
        if six or seven:
            decode = partial(_one, decoding.end_to_end, index)
            return Layout("end2end", decode, case.names or usual_names(80), suppress=False)
    return None


def _detr(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    return _queries(outputs, names, "detr") or (
        _labelled(outputs, "detr", names or COCO) if case.forced else None
    )


def _rfdetr(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    told = case.forced or any(output.name == "dets" for output in outputs)
    return _queries(outputs, names, "rfdetr") if told else None


def _queries(
    outputs: Sequence[Output], names: tuple[str, ...], family: str
) -> Layout | None:
    """One vector for each thing that was looked for."""
    boxes = _first(outputs, lambda o: len(o.shape) == 2 and o.shape[1] == 4)
    if boxes is None:
        k = _first(
            outputs,
            lambda o: (
                len(o.shape) == 2
                and o.axes == 3
                and o.shape[1] > 4
                and FEWEST_QUERIES <= len(o.values) <= MOST_QUERIES
            ),
        )
        if k is None:
            return None
        classes = outputs[k].shape[1] - 4
        decode: Decode = partial(_one, decoding.detr_rows, k)
        return Layout(family, decode, names or usual_names(classes), suppress=False)
    count = len(outputs[boxes].values)
    scores = _first(outputs, lambda o: o.shape[:1] == (count,) and o is not outputs[boxes])
    if count > MOST_QUERIES or scores is None or len(outputs[scores].shape) != 2:
        return None
    classes = outputs[scores].shape[1]
    classes -= classes in (22, 92)
    decode = partial(_two, decoding.detr, boxes, scores)
    return Layout(family, decode, names or usual_names(classes), suppress=False)


def _ssd(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    seven = _first(
        outputs, lambda o: o.shape[1:] == (7,) and (o.axes == SSD_AXES or case.forced)
    )
    if seven is not None:
        by_row = partial(_one, decoding.ssd_rows, seven)
        return Layout("ssd", by_row, names or coco_by_id(), suppress=False)
    boxes = _first(outputs, lambda o: len(o.shape) == 2 and o.shape[1] == 4)
    count = 0 if boxes is None else len(outputs[boxes].values)
    classes = _first(
        outputs, lambda o: len(o.shape) == 2 and len(o.values) == count and o.shape[1] > 4
    )
    if boxes is None or classes is None or count <= MOST_QUERIES:
        return _labelled(outputs, "ssd", names or coco_by_id())
    sums = outputs[classes].values.sum(axis=1)
    ground = bool(np.median(np.abs(sums - 1)) < decoding.SUMS_TO_ONE)
    usual = usual_names(outputs[classes].shape[1] - ground)
    by_place = partial(_two, decoding.ssd_anchors, boxes, classes)
    feeding = Feeding("stretch", True, (127.0,) * 3, (128.0,) * 3) if ground else None
    return Layout("ssd", by_place, names or usual, suppress=True, feeding=feeding)


def _labelled(
    outputs: Sequence[Output], family: str, names: tuple[str, ...]
) -> Layout | None:
    """Boxes, scores and class numbers, one tensor each."""
    boxes = _first(outputs, lambda o: len(o.shape) == 2 and o.shape[1] == 4)
    if boxes is None:
        return None
    count = len(outputs[boxes].values)
    flat = [
        index
        for index, output in enumerate(outputs)
        if index != boxes and output.values.size == count
    ]
    scores = [k for k in flat if _named(outputs[k], "score", "conf")]
    labels = [k for k in flat if _named(outputs[k], "label", "class")]
    if not (scores and labels):
        return None
    upright = "detection_boxes" in outputs[boxes].name
    decode = partial(_three, boxes, scores[0], labels[0], upright)
    return Layout(family, decode, names, suppress=False)


def _named(output: Output, *words: str) -> bool:
    return any(word in output.name.lower() for word in words)


def _fastestdet(case: LayoutCase) -> Layout | None:
    outputs, names = case.outputs, case.names
    k = _first(outputs, lambda o: len(o.shape) == 3 and o.shape[0] > 5)
    if k is None or (len(outputs) > 1 and not case.forced):
        return None
    high, wide = outputs[k].shape[1:]
    if (wide * FASTESTDET_STRIDE, high * FASTESTDET_STRIDE) != case.size:
        return None
    decode = partial(_one, decoding.fastestdet, k)
    return Layout(
        "fastestdet", decode, names or usual_names(outputs[k].shape[0] - 5), suppress=True
    )


def _rows(
    outputs: Sequence[Output],
    family: str,
    decode: Callable[[Floats, Size, float], Decoded],
    places: Sequence[int],
    besides: int,
    names: tuple[str, ...],
) -> Layout | None:
    """A layout of one row for each place; ``besides`` the classes each row has so many numbers."""
    for index, out in enumerate(outputs):
        if len(out.shape) == 2 and len(out.values) in places and out.shape[1] > besides:
            # Masks may follow the classes, where the file says how many these are.
            classes = min(len(names) or out.shape[1], out.shape[1] - besides)
            end = None if family == "nanodet" else besides + classes
            decoded = partial(_one, decode, index, end=end)
            usual = names or usual_names(classes)
            return Layout(family, decoded, usual, suppress=True)
    return None


def _first(outputs: Sequence[Output], wanted: Callable[[Output], bool]) -> int | None:
    return next((index for index, out in enumerate(outputs) if wanted(out)), None)


def _one(
    decode: Callable[[Floats, Size, float], Decoded],
    k: int,
    outputs: Sequence[Output],
    size: Size,
    least: float,
    end: int | None = None,
) -> Decoded:
    return decode(outputs[k].values[:, :end], size, least)


def _two(
    decode: Callable[[Floats, Floats, Size, float], Decoded],
    a: int,
    b: int,
    outputs: Sequence[Output],
    size: Size,
    least: float,
) -> Decoded:
    return decode(outputs[a].values, outputs[b].values, size, least)


def _three(
    boxes: int,
    scores: int,
    labels: int,
    upright: bool,
    outputs: Sequence[Output],
    size: Size,
    least: float,
) -> Decoded:
    places = outputs[boxes].values.reshape(-1, 4)
    return decoding.labelled(
        decoding.upright_first(places) if upright else places,
        outputs[scores].values.ravel(),
        outputs[labels].values.ravel(),
        size,
        least,
    )


_KNOWN: dict[str, Callable[[LayoutCase], Layout | None]] = {
    "yolov5": _yolov5,
    "yolov8": _yolov8,
    "nanodet": _nanodet,
    "yolox": _yolox,
    "end2end": _end_to_end,
    "rfdetr": _rfdetr,
    "detr": _detr,
    "ssd": _ssd,
    "fastestdet": _fastestdet,
}
