"""Named columns: which of them is a frame, a box, a score, a class, whatever a file calls them.

A box is given by its corner and size (``x, y, w, h``), by two corners (``x1, y1, x2, y2``), or by
its centre and size (``cx, cy, w, h``); each in pixels, or, with ``n`` behind the name, as a share
of the picture (``xn``, ``cxn`` ...). One column may hold all four (``bbox``).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any

from recorders.errors import UsageError
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.cells import is_number
from recorders.formats.file_names import SINCE_1970_S, FrameNames, since_1970
from recorders.messages import Box

_ROLES: dict[str, tuple[str, ...]] = {
    "frame": (
        "frame", "frame_id", "frame_number", "frame_index", "frame_idx", "frameid", "framenumber",
        "frame_num", "frameindex", "fn", "image_id", "imageid",
    ),
    "file": ("file", "file_name", "filename", "image", "image_name", "image_path", "img", "path"),
    "id": (
        "id", "identity", "track", "track_id", "trackid", "tracker_id", "target", "target_id",
        "object_id", "objectid", "obj_id", "person_id",
    ),
    "score": ("score", "conf", "confidence", "prob", "probability", "det_score"),
    "label": (
        "label", "class", "class_name", "classname", "cls", "category", "name", "type", "class_id",
        "classid", "category_id", "object_class", "species", "category_name", "label_name",
        "object_type",
    ),
    "time": ("time", "time_s", "time_sec", "timestamp", "timestamp_s"),
    "time_ms": ("time_ms", "timestamp_ms", "ms", "msec", "milliseconds", "pos_msec"),
    "x": ("x", "left", "bb_left", "bbox_left", "bbox_x", "bb_x", "x_left", "top_left_x", "box_x"),
    "y": ("y", "top", "bb_top", "bbox_top", "bbox_y", "bb_y", "y_top", "top_left_y", "box_y"),
    "w": ("w", "width", "bb_width", "bbox_width", "bbox_w", "bb_w", "box_width", "box_w"),
    "h": ("h", "height", "bb_height", "bbox_height", "bbox_h", "bb_h", "box_height", "box_h"),
    "x1": ("x1", "xmin", "x_min", "xtl", "bbox_x1", "bbox_xmin", "min_x", "minx"),
    "y1": ("y1", "ymin", "y_min", "ytl", "bbox_y1", "bbox_ymin", "min_y", "miny"),
    "x2": ("x2", "xmax", "x_max", "xbr", "bbox_x2", "bbox_xmax", "max_x", "maxx", "right"),
    "y2": ("y2", "ymax", "y_max", "ybr", "bbox_y2", "bbox_ymax", "max_y", "maxy", "bottom"),
    "cx": ("cx", "xc", "x_center", "center_x", "x_centre", "centre_x", "xcenter", "bbox_cx"),
    "cy": ("cy", "yc", "y_center", "center_y", "y_centre", "centre_y", "ycenter", "bbox_cy"),
    "bbox": ("bbox", "box", "xywh", "bbox_xywh", "tlwh", "bounding_box"),
    "corners": ("xyxy", "bbox_xyxy", "tlbr", "ltrb", "box_xyxy"),
    "skip": ("-", "_", "skip"),
}  # fmt: skip
_SURE_LABELS = frozenset(
    {"label", "class_name", "classname", "name", "category_name", "label_name"}
)
"""What names a class, where a number of it may stand beside."""
_PREFIX = re.compile(r"^(box|bbox|bb|bounding_?box|rect|xyxy|xywh)[._]")
_PLACES = ("x", "y", "w", "h", "x1", "y1", "x2", "y2", "cx", "cy")
_NAMES = {name: role for role, names in _ROLES.items() for name in names}
_NAMES |= {f"{role}n": f"{role}n" for role in _PLACES} | {
    "xywhn": "bboxn",
    "xyxyn": "cornersn",
}
_UNKNOWN = FrameNames()
_NO_WORDS = frozenset({"none", "null", "nan", "n/a", "na", "nil"})
_TIMES = {"time": 1.0, "time_ms": 1e-3}
_ASK_FROM = 8
_MOST_STEP_S = 5
_SHAPES = (("x", "y", "w", "h"), ("x1", "y1", "x2", "y2"), ("cx", "cy", "w", "h"))


@dataclass(frozen=True)
class Columns:
    """Which column holds what.

    Attributes:
        roles: role of each column by its position, empty where it holds nothing that is read.
    """

    roles: tuple[str, ...]

    @classmethod
    def of(cls, names: Sequence[str]) -> Columns:
        """The roles of columns with these names.

        Raises:
            ValueError: they give no frame, or no box.
        """
        roles = cls.roles_of(names)
        if "x1" not in roles and "left" in _plain(names) and "x2" in roles:
            roles = ["x1" if r == "x" else "y1" if r == "y" else r for r in roles]
        chosen: dict[str, int] = {}
        for index, (role, name) in enumerate(zip(roles, _plain_names(names), strict=True)):
            before = chosen.setdefault(role, index)
            if role not in ("", "skip") and before != index:
                # The first of two of one kind, but a class's name before its number.
                better = role == "label" and name in _SURE_LABELS
                if better and _plain_names(names)[before] not in _SURE_LABELS:
                    roles[before], chosen[role] = "", index
                else:
                    roles[index] = ""
        found = set(roles)
        if not {"frame", "file", *_TIMES} & found:
            raise ValueError(
                "no column of frames (frame, frame_id, file_name, or time in seconds)"
            )
        if not _shape_of(found):
            raise ValueError(
                "no columns of boxes (x,y,w,h or x1,y1,x2,y2 or cx,cy,w,h or bbox)"
            )
        return cls(tuple(roles))

    @staticmethod
    def roles_of(names: Sequence[str]) -> list[str]:
        """The role that each name alone stands for, empty where it is none."""
        return [
            _NAMES.get(name, "") or _placed(_PREFIX.sub("", name))
            for name in _plain_names(names)
        ]

    @property
    def is_relative(self) -> bool:
        """Whether boxes are shares of the picture."""
        return any(role.endswith("n") for role in self.roles if role)

    def row(
        self,
        values: Sequence[Any],
        size: tuple[int, int] | None,
        line: int,
        names: FrameNames | None = None,
    ) -> BoxRow:
        """A row's box; the frame is as the file counts it, or as its picture's name says.

        Raises:
            ValueError: a value is missing, or no number.
        """
        held = {
            role: value for role, value in zip(self.roles, values, strict=False) if role
        }
        return row_of(held, size, line, names)


def _plain_names(names: Sequence[str]) -> list[str]:
    return [name.strip().strip('"').lower().replace(" ", "_") for name in names]


def _placed(name: str) -> str:
    """The role of what stands behind ``box.``: only that of a place."""
    role = _NAMES.get(name, "")
    return role if role in _PLACES else ""


def grow_as_corners(boxes: Sequence[Sequence[float]]) -> bool:
    """Whether the third and fourth number follow the first and second, as a second corner does."""
    if len(boxes) < _ASK_FROM or not all(b[2] > b[0] and b[3] > b[1] for b in boxes):
        return False
    across = [b[0] for b in boxes]
    spread = _variance(across)
    return spread > 0 and _variance([b[2] - b[0] for b in boxes]) < spread / 4


def ask_of_corners(path: Path, columns: Columns, boxes: Sequence[Sequence[float]]) -> None:
    """Refuse to guess where boxes that should be corner and size look like two corners.

    Raises:
        UsageError: they do.
    """
    name = next((name for name in ("bbox", "bboxn") if name in columns.roles), None)
    if name is not None and grow_as_corners(boxes):
        ways = [
            ",".join(way if role == name else role or "skip" for role in columns.roles)
            for way in (name.replace("bbox", "xyxy"), name)
        ]
        raise UsageError(
            f"{path}: the third number of its boxes grows with the first, as x2 does with x1;"
            f" say which they are: --columns {ways[0]} (two corners) or --columns {ways[1]}"
            " (corner and size)"
        )


def ask_of_times(path: Path, columns: Columns, times: Sequence[float]) -> None:
    """Refuse to guess where times without a unit may as well be milliseconds.

    Raises:
        UsageError: they may.
    """
    known = {"frame", "file"} & set(columns.roles)
    if known or "time" not in columns.roles or not times:
        return
    if max(times) > SINCE_1970_S:
        if since_1970(max(times)) is None:
            raise UsageError(
                f"{path}: its times, up to {max(times):g}, are neither seconds from the first frame"
                " on nor a time of the calendar in any unit; write them in seconds"
            )
        return
    steps = [b - a for a, b in pairwise(sorted(set(times)))]
    if len(steps) >= _ASK_FROM and min(steps) >= _MOST_STEP_S:
        way = ",".join(role or "skip" for role in columns.roles)
        milli = way.replace("time", "time_ms")
        raise UsageError(
            f"{path}: its times are {min(steps):g} apart; say their unit: --columns {way}"
            f" (seconds) or --columns {milli} (milliseconds)"
        )


def _variance(values: Sequence[float]) -> float:
    mean = sum(values) / len(values)
    return sum((value - mean) ** 2 for value in values) / len(values)


def _plain(names: Sequence[str]) -> set[str]:
    return {name.strip().strip('"').lower() for name in names}


def _shape_of(roles: set[str]) -> tuple[str, ...] | None:
    for end in ("", "n"):
        for shape in _SHAPES:
            if {name + end for name in shape} <= roles:
                return tuple(name + end for name in shape)
        for one in ("bbox", "corners"):
            if one + end in roles:
                return (one + end,)
    return None


def row_of(
    held: Mapping[str, Any],
    size: tuple[int, int] | None,
    line: int,
    names: FrameNames | None = None,
) -> BoxRow:
    """The box in values by role.

    Raises:
        ValueError: a value is missing, or no number; or shares without the picture's size.
    """
    label = held.get("label")
    score = held.get("score")
    return BoxRow(
        _frame(held, names or _UNKNOWN),
        _identity(held.get("id"), names or _UNKNOWN),
        box_of(held, size),
        1.0 if _empty(score) else number(score, "score"),
        "" if _empty(label) else str(label).strip(),
        line,
    )


def _empty(value: Any) -> bool:
    if isinstance(value, float):
        return math.isnan(value)
    return value is None or (isinstance(value, str) and not value.strip())


def _frame(held: Mapping[str, Any], names: FrameNames) -> int:
    value = held.get("frame")
    if _empty(value):
        if not _empty(held.get("file")) or not _TIMES.keys() & held.keys():
            return names.frame(str(held.get("file", "")))
        if all(_empty(held.get(role)) for role in _TIMES):
            raise ValueError("neither a frame nor a time")
        return names.frame_at(_seconds(held))
    found = number(value, "frame")
    if not math.isfinite(found) or found != int(found) or found < 0:
        raise ValueError(f"frame {value}: frames are whole numbers from 0 or 1")
    return int(found)


def _seconds(held: Mapping[str, Any]) -> float:
    """A row's time; one of the day of a calendar counts from 1970."""
    role = next(role for role in _TIMES if not _empty(held.get(role)))
    value = held[role]
    if isinstance(value, str) and not is_number(value):
        try:
            value = datetime.fromisoformat(value.strip())
        except ValueError:
            raise ValueError(f"time {value[:40]!r} is no number of seconds") from None
    if isinstance(value, datetime):
        zone = value.tzinfo or UTC
        return value.replace(tzinfo=zone).timestamp()
    return number(value, "time") * _TIMES[role]


def _identity(value: Any, names: FrameNames) -> int:
    """An identity as a whole number; a word gets one of its own."""
    if _empty(value) or isinstance(value, bool):
        return NOBODY
    try:
        found = float(value)
    except (TypeError, ValueError, OverflowError):
        is_word = isinstance(value, str) and value.strip().lower() not in _NO_WORDS
        return names.identity(value.strip()) if is_word else NOBODY
    return int(found) if abs(found) < 2**53 and found == int(found) else NOBODY


def number(value: Any, what: str) -> float:
    """A number, also where it is written as text.

    Raises:
        ValueError: it is none.
    """
    if isinstance(value, bool):
        raise ValueError(f"{what} is {value}")  # noqa: TRY004 (a value, not a type, is wrong)
    if isinstance(value, str):
        text = value.strip()
        if "_" in text:
            raise ValueError(f"{what} {text[:40]!r} is not a number")
        value = text
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ValueError(f"{what} {str(value)[:40]!r} is not a number") from None


def box_of(held: Mapping[str, Any], size: tuple[int, int] | None) -> Box:
    """x, y, w, h in pixels.

    Raises:
        ValueError: a value is missing, or no number; or shares without the picture's size.
    """
    shape = _shape_of({r for r in held if r})
    if shape is None:
        raise ValueError("a box lacks a value")
    if len(shape) == 1:
        four = held[shape[0]]
        if isinstance(four, str):
            four = re.split(r"[\s,;]+", four.strip().strip("[]()"))
        if not hasattr(four, "__len__") or len(four) != 4:
            raise ValueError(f"a box of {str(four)[:40]!r}: four numbers are wanted")
        values = [number(value, "box") for value in four]
        corners, centred = shape[0].startswith("corners"), False
    else:
        values = [number(held[name], name) for name in shape]
        corners, centred = shape[0].startswith("x1"), shape[0].startswith("c")
    a, b, c, d = values
    if corners:
        c, d = c - a, d - b
    if centred:
        a, b = a - c / 2, b - d / 2
    if shape[0].endswith("n"):
        if size is None:
            raise ValueError("boxes are shares of the picture, whose size is not known")
        a, b, c, d = a * size[0], b * size[1], c * size[0], d * size[1]
    return a, b, c, d


def parse_columns(text: str) -> Columns:
    """Columns from ``frame,id,x1,y1,x2,y2,score``.

    Raises:
        UsageError: a name is not known, or there is no frame or no box among them.
    """
    names = [name.strip() for name in text.split(",")]
    unknown = [name for name in names if name.lower() not in _NAMES]
    if unknown:
        raise UsageError(
            f"--columns {text}: {unknown[0]!r} is not known; known are frame, file, id, x, y,"
            " w, h, x1, y1, x2, y2, cx, cy (each also with n behind it, as a share of the"
            " picture), bbox, xyxy, score, label, time (seconds), time_ms, skip"
        )
    try:
        return Columns.of(names)
    except ValueError as error:
        raise UsageError(f"--columns {text}: {error}") from error
