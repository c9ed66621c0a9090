"""What a detector is: a picture in, what it shows out.

A detector of one's own is a class that is made without arguments and has this one method; `record
--detect module:Class` runs it, or an entry point of the group ``scenetrace.detectors``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple, Protocol, runtime_checkable

from recorders.errors import SceneTraceError
from recorders.messages import NO_BLOB, Box, Detections
from recorders.pictures import Image


class Sighting(NamedTuple):
    """One thing in one picture; a plain tuple of the same three does as well.

    Attributes:
        box: (x, y, w, h) in the picture's pixels; it may reach out of the picture.
        score: how sure the detector is, in [0, 1].
        label: what it is, in the detector's words.
    """

    box: Box
    score: float
    label: str = ""


@runtime_checkable
class Detector(Protocol):
    """Finds things in single pictures. It runs while recording, and never in a replay."""

    def detect(self, image: Image) -> Iterable[Sighting]:
        """What a picture shows.

        Args:
            image: (H, W, 3) uint8 BGR. Never write into it.
        """
        ...


def as_detections(
    name: str, frame: int, width: int, height: int, found: Iterable[Sighting]
) -> Detections:
    """A detector's answer for one frame as a message: boxes cut to the picture, those outside of
    it left out, best score first (of equals the first).

    Raises:
        SceneTraceError: the answer is not what `Detector` promises; names the detector, the frame
            and the value.
    """
    kept: list[Sighting] = []
    for one in found:
        sighting = _checked(name, frame, one)
        box = cut(sighting.box, width, height)
        if box is not None:
            kept.append(sighting._replace(box=box))
    kept.sort(key=lambda s: -s.score)
    return Detections(
        frame,
        width,
        height,
        boxes=[s.box for s in kept],
        scores=[s.score for s in kept],
        labels=[s.label for s in kept],
        ellipses=[None] * len(kept),
        blobs=[NO_BLOB] * len(kept),
    )


def _checked(name: str, frame: int, one: Sequence[object]) -> Sighting:
    try:
        box, score, *label = one
        x, y, w, h = (float(v) for v in box)  # type: ignore[attr-defined]
        number = float(score)  # type: ignore[arg-type]
    except (TypeError, ValueError):
        raise SceneTraceError(
            f"the detector {name} in frame {frame}: {str(one)[:80]}; wanted"
            " ((x, y, w, h), score, label)"
        ) from None
    if not all(map(math.isfinite, (x, y, w, h))) or w <= 0 or h <= 0:
        raise SceneTraceError(
            f"the detector {name} in frame {frame}: a box of {(x, y, w, h)}; wanted finite"
            " x, y and w, h over 0"
        )
    if not 0 <= number <= 1:
        raise SceneTraceError(
            f"the detector {name} in frame {frame}: a score of {number}; wanted in [0, 1]"
        )
    return Sighting((x, y, w, h), number, str(label[0]) if label else "")


def cut(box: Box, width: int, height: int) -> Box | None:
    """The part of a box that lies in the picture; None where nothing does."""
    x, y, w, h = box
    left, top = max(0.0, x), max(0.0, y)
    right, bottom = min(float(width), x + w), min(float(height), y + h)
    return (
        (left, top, right - left, bottom - top) if right > left and bottom > top else None
    )
