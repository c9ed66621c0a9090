"""Likeness of pictures: shades of a picture of somebody, and networks that tell people again."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reasoning.questions import Case
from reasoning.questions.finding import Wanted
from recorders.errors import RecordingError, SceneTraceError, UsageError
from recorders.looks import body_shades
from recorders.pictures import Image
from recorders.stills import decode_still, still_header
from recorders.vision import cv2
from replay.report.contact_sheet import Crop, crops

_SIZE = (128, 256)
_MEAN, _DEVIATION = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
_MOST_BYTES = 64 << 20


def read_picture_file(path: Path) -> Image:
    """A picture, (height, width, 3) BGR.

    Raises:
        UsageError: it cannot be read.
    """
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise UsageError(
                f"{path}: over {_MOST_BYTES >> 20} MiB: not a picture of somebody"
            )
        data = path.read_bytes()
        return decode_still(data, still_header(data, path), path=path)
    except OSError as error:
        raise UsageError(f"{path}: cannot be read: {error.strerror}") from error
    except RecordingError as error:
        raise UsageError(str(error)) from error


def shares_of_picture(path: Path) -> tuple[list[int], list[int]]:
    """Shares of shades in thousandths of upper and lower body of who fills a picture.

    Raises:
        UsageError: it cannot be read, or is too small.
    """
    image = read_picture_file(path)
    found = body_shades(image, None, (0, 0, image.shape[1], image.shape[0]))
    if found is None:
        raise UsageError(
            f"{path}: too small to count colours; cut out one person, head to feet"
        )
    upper, lower = ([int(v) for v in c * 1000 // int(c.sum())] for c in found)
    return upper, lower


def ranked_by_model(
    case: Case,
    columns: Sequence[str],
    rows: Sequence[tuple[Any, ...]],
    like: str,
    wanted: Wanted,
    model: Path,
) -> list[tuple[Any, ...]]:
    """The rows with the cosine of the network's features as their likeness, best first.

    Args:
        case: where the rows are from.
        columns: of what was found by colours.
        rows: what was found.
        like: who is looked for.
        wanted: the same as `finding.likeness_to` gives it.
        model: an ONNX file that takes one picture of a person and gives its features.

    Raises:
        SceneTraceError: the model cannot be run, or there is no picture.
    """
    network = _Features(model)
    if wanted.not_this is None:
        own = network(read_picture_file(Path(like)))
    else:
        recording, track = wanted.not_this
        looked = case.sql(
            "SELECT recording, track, frame, x, y, w, h FROM looks"
            " WHERE recording = ? AND track = ?",
            [recording, track],
        )
        first = next(iter(crops(case, looked.columns, list(looked.rows))))
        if isinstance(first, str):
            raise SceneTraceError(f"--like {like}: {first}")
        own = network(first.image)
    at = columns.index("likeness")
    out = []
    for row, crop in zip(rows, crops(case, columns, rows), strict=True):
        if isinstance(crop, Crop):
            near = round(float(np.einsum("i,i->", own, network(crop.image))), 4)
            out.append((*row[:at], near, *row[at + 1 :]))
    return sorted(out, key=lambda row: -row[at])


class _Features:
    """A network from a picture of a person to features of length 1."""

    def __init__(self, path: Path) -> None:
        from recorders.detectors.model_file import read_model

        self._model = read_model(path)
        self._network: Any = None
        self._size = self._model.image_size or _SIZE

    def __call__(self, image: Image) -> NDArray[np.float64]:
        from recorders.detectors.network import open_network

        small = np.asarray(cv2.resize(image, self._size, interpolation=cv2.INTER_AREA))
        scaled = (small[:, :, ::-1].astype(np.float32) / 255 - _MEAN) / _DEVIATION
        batch = np.ascontiguousarray(scaled.transpose(2, 0, 1)[None], np.float32)
        inputs: dict[str, Any] = {self._model.inputs[0].name: batch}
        if self._network is None:
            self._network, found = open_network(self._model, inputs)
        else:
            found = self._network.run(inputs)
        features = np.asarray(found[0][1], np.float64).ravel()
        length = float(np.sqrt(np.einsum("i,i->", features, features)))
        if not np.isfinite(length) or length == 0:
            raise SceneTraceError(f"{self._model.path}: gives no features of a picture")
        return np.asarray(features / length)
