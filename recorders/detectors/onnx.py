"""A detector in an ONNX file: read, recognised, run."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.detectors.detector import Sighting
from recorders.detectors.fitting import Preparation, as_input, placement
from recorders.detectors.layouts import ALIASES, FORMATS, Layout, Output, recognise
from recorders.detectors.model_file import (
    FLOAT16,
    INT64,
    UINT8,
    ModelFile,
    Tensor,
    read_model,
)
from recorders.detectors.network import open_network
from recorders.detectors.parameters import DetectorParameters
from recorders.detectors.suppression import suppress
from recorders.errors import SceneTraceError, UsageError
from recorders.pictures import Image

USUAL_SIDE = 640
LARGEST_SIDE = 4096
SIZES_INPUT = "orig_target_sizes"
"""RT-DETR's and D-FINE's second input: the size that their boxes are to be in."""
MOST_NAMES_TOLD = 90


@dataclass(frozen=True)
class ModelOptions:
    """Which model, and what of it is wanted.

    Attributes:
        path: the ONNX file.
        family: one of `recorders.detectors.layouts.FORMATS` or `ALIASES`; None: whichever fits.
        labels: the classes to keep, by name; empty: all.
    """

    path: Path
    family: str | None = None
    labels: tuple[str, ...] = ()


class OnnxDetector:
    """See `recorders.detectors.detector.Detector`.

    Attributes:
        layout: how its outputs are read.
        facts: what a log says of it.

    Raises:
        SceneTraceError: the model cannot be read or run, or fits no known layout; one line.
        UsageError: no such format, or a label that the model does not have.
    """

    def __init__(self, options: ModelOptions, parameters: DetectorParameters) -> None:
        family = _family(options.family)
        model = read_model(options.path)
        image = _image_input(model)
        self._parameters = parameters
        self._image = image.name
        prepared = _size_of(model, image, parameters.input_side)
        self._sizes = [t for t in model.inputs if t.name != image.name]
        for extra in self._sizes:
            if extra.name != SIZES_INPUT:
                raise SceneTraceError(
                    f"{model.path}: its input {extra} is none that detectors have; export it"
                    " with the picture as its only input"
                )
        if self._sizes and family is None:
            family = "detr"
        self._half = image.kind == FLOAT16
        self._prepared = prepared
        blank = np.full((prepared.height, prepared.width, 3), 127, np.uint8)
        self._network, first = open_network(model, self._inputs(blank))
        outputs = [Output.of(name, value) for name, value in first]
        size = prepared.width, prepared.height
        layout = recognise(outputs, size, model.names, family)
        if layout is None:
            raise SceneTraceError(_unknown(model, first, size, family))
        self.layout: Layout = layout
        fed = layout.fed
        self._prepared = replace(
            prepared, fit=fed.fit, rgb=fed.rgb, mean=fed.mean, spread=fed.spread
        )
        self._wanted = _wanted(model, layout, options.labels)
        self.facts = self._described(model, options)

    def detect(self, image: Image) -> list[Sighting]:
        """As `Detector.detect`; best score first."""
        outputs = [Output.of(*out) for out in self._network.run(self._inputs(image))]
        size = self._prepared.width, self._prepared.height
        parameters = self._parameters
        found = self.layout.decode(outputs, size, parameters.min_score)
        rows = np.arange(len(found.scores))
        if self._wanted is not None:
            rows = np.flatnonzero(np.isin(found.classes, self._wanted))
        corners, scores = found.corners[rows], found.scores[rows]
        classes = found.classes[rows]
        if self.layout.suppress:
            kept = suppress(corners, scores, classes, parameters.suppress_overlap)
        else:
            kept = np.argsort(-scores, kind="stable")
        at = placement(self._prepared, image.shape[1], image.shape[0])
        boxes = at.back(corners[kept]).tolist()
        return [
            Sighting((x, y, w, h), score, self._name(k))
            for (x, y, w, h), score, k in zip(
                boxes, scores[kept].tolist(), classes[kept].tolist(), strict=True
            )
        ]

    def _name(self, number: int) -> str:
        names = self.layout.names
        return names[number] if number < len(names) else f"class {number}"

    def _inputs(self, picture: Image) -> dict[str, NDArray[np.generic]]:
        value = as_input(picture, self._prepared)
        if self._half:
            value = value.astype(np.float16)
        size = np.array([[self._prepared.width, self._prepared.height]], np.int64)
        return {
            self._image: value,
            **{
                t.name: size if t.kind == INT64 else size.astype(np.float32)
                for t in self._sizes
            },
        }

    def _described(self, model: ModelFile, options: ModelOptions) -> dict[str, str]:
        prepared = self._prepared
        return {
            "model": model.path.name,
            "sha256": model.sha256,
            "format": self.layout.family,
            "engine": self._network.engine,
            "input": f"{prepared.width}x{prepared.height} {prepared.fit}",
            "labels": ",".join(options.labels) or "all",
            "min_score": repr(self._parameters.min_score),
            "suppress_overlap": repr(self._parameters.suppress_overlap),
        }


def _family(word: str | None) -> str | None:
    if word is None:
        return None
    family = ALIASES.get(word.lower(), word.lower())
    if family not in FORMATS:
        raise UsageError(
            f"--model-format {word}: must be one of {', '.join([*FORMATS, *ALIASES])}"
        )
    return family


def _image_input(model: ModelFile) -> Tensor:
    """The input that takes a picture."""
    for tensor in model.inputs:
        if len(tensor.shape) == 4 and 3 in (tensor.shape[1] or 3, tensor.shape[3]):
            return tensor
    told = ", ".join(map(str, model.inputs)) or "none"
    raise SceneTraceError(
        f"{model.path}: no input takes one colour picture (1x3xHxW or 1xHxWx3); its inputs"
        f" are: {told[:200]}"
    )


def _size_of(model: ModelFile, image: Tensor, side: int) -> Preparation:
    """How large its pictures are, and in which order their numbers stand."""
    last = image.shape[1] != 3 and image.shape[3] == 3
    batch = image.shape[0]
    if batch > 1:
        raise SceneTraceError(
            f"{model.path}: takes {batch} pictures at once; export it for one"
        )
    high, wide = image.shape[1:3] if last else image.shape[2:4]
    usual = model.image_size or (USUAL_SIDE, USUAL_SIDE)
    width, height = wide or side or usual[0], high or side or usual[1]
    if max(width, height) > LARGEST_SIDE:
        raise SceneTraceError(
            f"{model.path}: wants pictures of {width}x{height}, over {LARGEST_SIDE} a side"
        )
    return Preparation(width, height, channels_last=last, whole=image.kind == UINT8)


def _wanted(
    model: ModelFile, layout: Layout, labels: Sequence[str]
) -> NDArray[np.intp] | None:
    """The numbers of the classes that are wanted, None for all."""
    if not labels:
        return None
    unknown = [name for name in labels if name not in layout.names]
    if unknown:
        told = ", ".join(layout.names[:MOST_NAMES_TOLD])
        raise UsageError(
            f"--labels {unknown[0]}: {model.path.name} knows no such class; it knows: {told}"
        )
    return np.array([layout.names.index(name) for name in labels], np.intp)


def _unknown(
    model: ModelFile,
    outputs: Sequence[tuple[str, NDArray[np.generic]]],
    size: tuple[int, int],
    family: str | None,
) -> str:
    told = ", ".join(f"{name} {'x'.join(map(str, v.shape))}" for name, v in outputs)
    wanted = (
        f"do not fit the format {family}"
        if family
        else f"fit no known detector ({', '.join(FORMATS)}: --model-format)"
    )
    return (
        f"{model.path}: its outputs for a picture of {size[0]}x{size[1]} {wanted}; they"
        f" are: {told[:300]}"
    )
