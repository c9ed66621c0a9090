"""A heatmap drawn over a picture of the scene: where feet were for how long."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from reasoning.questions import Case
from reasoning.questions.desk_questions import HEATMAP_CELL
from recorders.errors import SceneTraceError, UsageError
from recorders.pictures import Image, encode_png
from recorders.scene import SceneLog
from recorders.vision import cv2
from replay.export.output import whole_file

_GROUND = 96
_FAINT = 12
_SPREAD = 5


def draw_heatmap(
    case: Case,
    columns: Sequence[str],
    rows: Iterable[Sequence[Any]],
    out: Path,
    *,
    force: bool = False,
) -> float:
    """Draw an answer to `heatmap` as a PNG; returns the seconds of the warmest square.

    Raises:
        OutputExistsError: the file exists, and ``force`` is not set.
        UsageError: the rows are of several recordings, or of a picture of unknown size.
    """
    at = [columns.index(name) for name in ("recording", "x", "y", "seconds")]
    cells = [tuple(row[k] for k in at) for row in rows]
    names = sorted({cell[0] for cell in cells}) or [
        case.rows("SELECT min(recording) FROM recordings")[0][0]
    ]
    if len(names) > 1:
        raise UsageError(
            f"heatmap -o: of {len(names)} recordings; choose one with --recording"
        )
    ((path, camera, width, height),) = case.rows(
        "SELECT path, camera, width, height FROM recordings WHERE recording = ?", [names[0]]
    )
    if width <= 0 or height <= 0:
        raise UsageError(f"heatmap -o: {names[0]} does not say how large its picture is")
    image = _picture(Path(path), camera, width, height)
    most = max((cell[3] for cell in cells), default=0.0)
    shape = -(-height // HEATMAP_CELL), -(-width // HEATMAP_CELL)
    warm = np.zeros(shape, np.uint8)
    for _, x, y, seconds in cells:
        row, column = y // HEATMAP_CELL, x // HEATMAP_CELL
        if 0 <= row < shape[0] and 0 <= column < shape[1]:
            # Roots: one who stands for an hour does not make all others cold.
            warm[row, column] = round(255 * (seconds / most) ** 0.5)
    size = (shape[1] * HEATMAP_CELL, shape[0] * HEATMAP_CELL)
    spread = cv2.GaussianBlur(warm, (_SPREAD, _SPREAD), 0)
    large = np.asarray(cv2.resize(spread, size, interpolation=cv2.INTER_LINEAR), np.uint8)
    large = large[:height, :width]
    mixed = cv2.addWeighted(
        image, 0.4, cv2.applyColorMap(large, cv2.COLORMAP_TURBO), 0.6, 0
    )
    shown = np.where((large > _FAINT)[:, :, None], mixed, image)
    with whole_file(out, force=force) as file:
        file.write(encode_png(np.asarray(shown, np.uint8)))
    return float(most)


def _picture(path: Path, camera: str, width: int, height: int) -> Image:
    """The recording's first picture in grey, or a plain ground."""
    ground = np.full((height, width, 3), _GROUND, np.uint8)
    try:
        with SceneLog(path, camera) as scene:
            image = next(scene.frames()).image if scene.info.has_images else None
    except (SceneTraceError, OSError, StopIteration):
        return ground
    if image is None:
        return ground
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
    return np.asarray(cv2.cvtColor(grey, cv2.COLOR_GRAY2BGR), np.uint8)
