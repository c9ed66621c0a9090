"""Messages that hold detections: boxes with scores and classes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, TypeGuard

from recorders.log.model import ChannelInfo
from recorders.message_checks import LARGEST
from recorders.messages import Box
from recorders.payloads.read import PayloadError, fields, member, payload_kind, stamp_ns
from recorders.upright import extent_of_box

DETECTIONS = frozenset(
    {
        "vision_msgs/Detection2DArray",
        "foxglove.ImageAnnotations",
        "scenetrace.Detections",
    }
)
"""Kinds of channels that hold detections, see `recorders.payloads.payload_kind`."""
_LINE_LOOP, _LINE_STRIP = 2, 3
_LOOPS = frozenset({_LINE_LOOP, _LINE_STRIP, "LINE_LOOP", "LINE_STRIP"})
_CORNERS = 4
_DECIMALS = 6


@dataclass(frozen=True, slots=True)
class Detected:
    """What one message says was detected.

    Attributes:
        stamp_ns: of the picture that it belongs to, 0 where it does not say.
        boxes: (x, y, w, h) in the picture's pixels, the left upper corner first.
        scores, labels: one for each box; an empty label where there is none.
        size: width and height of the picture, where the message says it.
        frame: the picture's number, where the message says it.
        left_out: boxes that are none: without width or height, or not finite.
    """

    stamp_ns: int
    boxes: list[Box]
    scores: list[float]
    labels: list[str]
    size: tuple[int, int] | None = None
    frame: int | None = None
    left_out: int = 0


def read_detections(channel: ChannelInfo, data: bytes) -> Detected:
    """The detections in a message of a channel of one of `DETECTIONS`.

    Raises:
        PayloadError: it cannot be read; says why.
    """
    kind = payload_kind(channel)
    found = fields(channel, data)
    if kind == "vision_msgs/Detection2DArray":
        return _vision(found)
    if kind == "foxglove.ImageAnnotations":
        return _annotations(found)
    return _ours(found)


class _Rows:
    """Boxes as they are gathered: what is none is counted, not kept."""

    def __init__(self) -> None:
        self.boxes: list[Box] = []
        self.scores: list[float] = []
        self.labels: list[str] = []
        self.left_out = 0

    def add(self, box: tuple[Any, ...], score: Any = 1.0, label: Any = "") -> None:
        values = [*box, score]
        if len(values) != 5 or not all(_is_number(value) for value in values):
            self.left_out += 1
            return
        x, y, w, h = (float(v) for v in box)
        if w <= 0 or h <= 0:
            self.left_out += 1
            return
        self.boxes.append((x, y, w, h))
        self.scores.append(float(score))
        self.labels.append(str(label))

    def done(
        self,
        stamp: int,
        size: tuple[int, int] | None = None,
        frame: int | None = None,
    ) -> Detected:
        return Detected(
            stamp, self.boxes, self.scores, self.labels, size, frame, self.left_out
        )


def _is_number(value: Any) -> TypeGuard[float]:
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and math.isfinite(value)
        and abs(value) < LARGEST
    )


def _list(value: Any, what: str) -> Any:
    if isinstance(value, str | bytes) or not hasattr(value, "__len__"):
        raise PayloadError(f"it has no list of {what}")
    return value


def _vision(found: Any) -> Detected:
    rows = _Rows()
    for one in _list(member(found, "detections"), "detections"):
        bbox = member(one, "bbox")
        center = member(bbox, "center")
        place = (
            member(center, "position") or center
        )  # before 2022: x and y in the center itself
        x, y = member(place, "x"), member(place, "y")
        w, h = member(bbox, "size_x"), member(bbox, "size_y")
        score, label = _best(member(one, "results") or [])
        if not all(_is_number(v) for v in (x, y, w, h)):
            rows.left_out += 1
            continue
        w, h = _upright(w, h, member(center, "theta"))
        # To a millionth of a pixel: a corner that was written as a decimal comes back as it was.
        corner = round(x - w / 2, _DECIMALS), round(y - h / 2, _DECIMALS)
        rows.add((*corner, w, h), score, label)
    return rows.done(stamp_ns(found))


def _upright(w: float, h: float, theta: Any) -> tuple[float, float]:
    """Width and height of the box around a box that is turned."""
    if not _is_number(theta) or theta == 0:
        return w, h
    return extent_of_box(w, h, theta)


def _best(results: Any) -> tuple[float, str]:
    """The surest of a detection's hypotheses; the first among equals."""
    best, label = -math.inf, ""
    for result in results:
        guess = member(result, "hypothesis") or result  # before 2021: in the result itself
        score = member(guess, "score")
        name = member(guess, "class_id")
        name = member(guess, "id") if name is None else name
        if _is_number(score) and score > best:
            best, label = float(score), "" if name is None else str(name)
    return (best if best > -math.inf else 1.0), label


def _annotations(found: Any) -> Detected:
    """Closed lines whose corners are a box; a text at a box's corner is its label."""
    rows = _Rows()
    texts = {
        _corner(member(t, "position")): str(member(t, "text") or "")
        for t in member(found, "texts") or []
    }
    stamp = stamp_ns(found)
    for points in member(found, "points") or []:
        stamp = stamp or stamp_ns(points)
        corners = [_corner(p) for p in member(points, "points") or []]
        if corners and corners[0] == corners[-1]:
            corners.pop()
        if member(points, "type") not in _LOOPS or len(corners) != _CORNERS:
            continue
        xs, ys = (
            sorted({corner[0] for corner in corners}),
            sorted({corner[1] for corner in corners}),
        )
        if len(xs) != 2 or len(ys) != 2 or not all(map(_is_number, (*xs, *ys))):
            continue
        label = next((texts[corner] for corner in corners if corner in texts), "")
        rows.add((xs[0], ys[0], xs[1] - xs[0], ys[1] - ys[0]), 1.0, label)
    return rows.done(stamp)


def _corner(point: Any) -> tuple[Any, Any]:
    return member(point, "x") or 0.0, member(point, "y") or 0.0


def _ours(found: Any) -> Detected:
    if not isinstance(found, dict):
        raise PayloadError("its JSON is no object")
    boxes = _list(found.get("boxes"), "boxes")
    scores = found.get("scores") or [1.0] * len(boxes)
    labels = found.get("labels") or [""] * len(boxes)
    if not len(boxes) == len(scores) == len(labels):
        raise PayloadError(
            f"{len(boxes)} boxes, {len(scores)} scores and {len(labels)} labels"
        )
    rows = _Rows()
    for box, score, label in zip(boxes, scores, labels, strict=True):
        rows.add(tuple(box) if isinstance(box, list) else (), score, label)
    width, height, frame = (found.get(n) for n in ("width", "height", "frame"))
    size = None
    if _is_number(width) and _is_number(height) and width >= 1 and height >= 1:
        size = int(width), int(height)
    return rows.done(stamp_ns(found), size, int(frame) if _is_number(frame) else None)
