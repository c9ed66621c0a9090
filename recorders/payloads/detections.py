"""Messages that hold detections: boxes with scores and classes."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from itertools import chain
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
_EDGES = frozenset({4, "LINE_LIST"})
_CORNERS = 4
_SLACK = 0.02
_ASIDE, _OVER = 3.0, 40.0
_SCORED = re.compile(r"(.*?[^\s:(.])[\s:(]+(\d*\.\d+|\d+(?=%))(%?)\)?")
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
        others: what is drawn beside the boxes: lines, points, outlines, circles.
    """

    stamp_ns: int
    boxes: list[Box]
    scores: list[float]
    labels: list[str]
    size: tuple[int, int] | None = None
    frame: int | None = None
    left_out: int = 0
    others: int = 0


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
        others: int = 0,
    ) -> Detected:
        return Detected(
            stamp,
            self.boxes,
            self.scores,
            self.labels,
            size,
            frame,
            self.left_out,
            others,
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
    """Lines around a box, also around one that is turned; a text at its corner or just over it is
    its label.
    """
    rows = _Rows()
    texts = [
        (_corner(member(t, "position")), str(member(t, "text") or ""))
        for t in member(found, "texts") or []
    ]
    stamp = stamp_ns(found)
    others = len(member(found, "circles") or [])
    for points in member(found, "points") or []:
        stamp = stamp or stamp_ns(points)
        box = _box_around(member(points, "type"), member(points, "points") or [])
        if box is None:
            others += 1
            continue
        label, score = _told(_text_at(texts, box))
        rows.add(box, score, label)
    return rows.done(stamp, others=others)


def _box_around(kind: Any, points: Any) -> Box | None:
    """The upright box around four corners of a box, in the order of its outline or as its edges."""
    corners = [_corner(p) for p in points]
    if kind in _EDGES and len(corners) == 2 * _CORNERS:
        corners = list(dict.fromkeys(corners))  # each corner ends two edges
    elif kind not in _LOOPS:
        return None
    elif corners and corners[0] == corners[-1]:
        corners.pop()
    if len(corners) != _CORNERS or not all(map(_is_number, chain(*corners))):
        return None
    xs, ys = [c[0] for c in corners], [c[1] for c in corners]
    across, down = max(xs) - min(xs), max(ys) - min(ys)
    upright = len(set(xs)) == len(set(ys)) == 2
    # The diagonals of a box halve one another and are of one length.
    a, b, c, d = sorted(corners, key=lambda p: _around(p, xs, ys))
    slack = _SLACK * max(across, down)
    middles = max(abs(a[k] + c[k] - b[k] - d[k]) for k in (0, 1))
    lengths = abs(math.dist(a, c) - math.dist(b, d))
    if not upright and max(middles, lengths) > slack:
        return None
    return min(xs), min(ys), across, down


def _around(point: tuple[float, float], xs: list[float], ys: list[float]) -> float:
    return math.atan2(point[1] - sum(ys) / len(ys), point[0] - sum(xs) / len(xs))


def _text_at(texts: list[tuple[Any, str]], box: Box) -> str:
    """The text that stands at a box's left upper corner, or over it, the nearest."""
    x, y, w, h = box
    near = [
        (abs(place[0] - x) + abs(place[1] - y), text)
        for place, text in texts
        if place in ((x, y), (x + w, y), (x, y + h), (x + w, y + h))
        or (abs(place[0] - x) <= _ASIDE and -_OVER <= place[1] - y <= _ASIDE)
    ]
    return min(near, default=(0.0, ""))[1]


def _told(text: str) -> tuple[str, float]:
    """Class and confidence of a label: ``person 0.87``, ``person: 87%``, ``person (0.87)``."""
    match = _SCORED.fullmatch(text.strip())
    if match is None:
        return text, 1.0
    score = float(match[2]) / (100 if match[3] else 1)
    return (match[1], score) if score <= 1 else (text, 1.0)


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
