"""Detections that a program holds: supervision's ``Detections``, norfair's detections and tracked
objects, in the order of their frames.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from recorders.errors import UsageError
from recorders.left_out import LeftOut
from recorders.messages import Box
from recorders.pictures import Image
from recorders.sources.source import Rate, SourceFrame, detections_of, outside, parse_fps

Found = tuple[Box, float, str]


def found_in(held: Any) -> Iterator[Found]:
    """Box, score and class of each detection in one frame's objects.

    They are told by what they have, so that neither library is needed: ``xyxy`` with
    ``confidence`` and ``class_id`` (supervision), or a list of objects with ``points`` or
    ``estimate`` of two corners (norfair).

    Raises:
        UsageError: they are neither.
    """
    if hasattr(held, "xyxy"):
        yield from _supervision(held)
        return
    if not isinstance(held, Iterable):
        raise UsageError(
            f"{type(held).__name__}: neither supervision's Detections nor a list of norfair's"
            " objects"
        )
    for one in held:
        corners = getattr(one, "points", None)
        corners = getattr(one, "estimate", None) if corners is None else corners
        if corners is None or len(corners) != 2:
            raise UsageError(
                f"{type(one).__name__}: without `points` or `estimate` of two corners"
            )
        (left, top), (right, bottom) = ([float(v) for v in corner] for corner in corners)
        scores = getattr(one, "scores", None)
        score = 1.0 if scores is None else sum(map(float, scores)) / len(scores)
        label = getattr(one, "label", None)
        box = (left, top, right - left, bottom - top)
        yield box, score, "" if label is None else str(label)


def _supervision(held: Any) -> Iterator[Found]:
    scores, classes = getattr(held, "confidence", None), getattr(held, "class_id", None)
    names = (getattr(held, "data", None) or {}).get("class_name")
    for index, corners in enumerate(held.xyxy):
        left, top, right, bottom = (float(corner) for corner in corners)
        label = ""
        if names is not None:
            label = str(names[index])
        elif classes is not None:
            label = str(classes[index])
        score = 1.0 if scores is None else float(scores[index])
        yield (left, top, right - left, bottom - top), score, label


class ObjectSource:
    """Objects of a program as a source: one entry for each frame, identities left out.

    Args:
        frames: each frame's objects, see `found_in`.
        size: width and height of the pictures that they were made for.
        fps: the frame rate.

    >>> class Detections:
    ...     xyxy = [(10.0, 20.0, 30.0, 60.0)]
    ...     confidence, class_id, data = [0.5], [0], {}
    >>> source = ObjectSource([Detections(), []], (320, 240), 25)
    >>> [frame.detections.boxes for frame in source.frames()]
    [[(10.0, 20.0, 20.0, 40.0)], []]
    """

    name = "objects"
    has_images = False
    stills = False
    has_detections = True

    def __init__(
        self, frames: Sequence[Any], size: tuple[int, int], fps: float | Fraction | str
    ) -> None:
        self.path = Path("objects")
        self._frames = frames
        self.width, self.height = size
        self._rate = Rate(parse_fps(fps))
        self.frame_ns = self._rate.frame_ns
        self.frame_count: int | None = len(frames)
        self.notes: list[str] = []
        self.losses: list[str] = []

    def frames(self) -> Iterator[SourceFrame]:
        """All frames in order."""
        self.losses.clear()
        left_out = LeftOut()
        for index, held in enumerate(self._frames):
            kept: list[Found] = []
            for box, score, label in found_in(held):
                if not math.isfinite(sum(box) + score) or box[2] <= 0 or box[3] <= 0:
                    left_out.note("a box that is none", f"frame {index}")
                elif outside(box, self.width, self.height):
                    left_out.note("a box beyond the picture", f"frame {index}")
                else:
                    kept.append((box, score, label))
            found = detections_of(
                index,
                self.width,
                self.height,
                [box for box, _, _ in kept],
                [score for _, score, _ in kept],
                [label for _, _, label in kept],
            )
            yield SourceFrame(index, self._rate.time_ns(index), detections=found)
        self.losses += left_out.lines()

    def sample(self, count: int) -> Iterator[Image]:  # noqa: ARG002
        """Nothing: there are no pictures."""
        return iter(())

    def digests(self) -> list[tuple[str, str]]:
        """None: there is no file."""
        return []
