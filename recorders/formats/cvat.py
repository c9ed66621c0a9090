"""CVAT's XML, for videos (tracks of boxes) and for images."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.files import open_to_read
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.file_names import FrameNames
from recorders.formats.readers import Bad, checked
from recorders.names import whole
from recorders.upright import extent_of_box, extent_of_ellipse

_DEEPEST = 32
_MOST_BETWEEN = 100_000
_ONLY_LATER = ("image", "track")
_SHAPES = frozenset({"box", "polygon", "ellipse", "mask"})
_WITHOUT_BOX = frozenset({"points", "polyline", "skeleton", "cuboid"})


class Cvat:
    """A CVAT XML file, frames from 0; boxes that CVAT says to be outside are none.

    Raises:
        SourceError: a DOCTYPE or an entity in it, or it is not well-formed.
    """

    name = "CVAT XML"
    first_frame: int | None = 0
    is_certain = True

    def __init__(self, path: Path, names: FrameNames | None = None) -> None:
        self.path = path
        self.ignored: list[BoxRow] = []
        self._names = names or FrameNames()
        if self._names.are_known:
            self._names.learn(
                name
                for e in self._elements()
                if (name := e.get("name")) and e.tag == "image"
            )
            self.first_frame = 1 if self._names.matched else 0
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []

    def _elements(self) -> Iterator[Any]:
        """The images and tracks, one at a time."""
        from xml.etree.ElementTree import ParseError

        from defusedxml import DefusedXmlException
        from defusedxml.ElementTree import iterparse

        depth = 0
        root: Any = None
        with open_to_read(self.path) as file:
            try:
                for event, element in iterparse(
                    file, events=("start", "end"), forbid_dtd=True
                ):
                    if event == "start":
                        root = element if root is None else root
                        depth += 1
                        if depth > _DEEPEST:
                            raise LimitError(f"nested over {_DEEPEST} deep", self.path)
                        continue
                    depth -= 1
                    if element.tag == "original_size":
                        self._take_size(element)
                    if depth == 1 and element.tag in _ONLY_LATER:
                        yield element
                        root.clear()
            except DefusedXmlException as error:
                raise SourceError(
                    "a DOCTYPE or an entity in the XML: refused, it could reach for other"
                    " files or grow",
                    self.path,
                ) from error
            except (ParseError, LookupError) as error:
                raise SourceError(f"not well-formed XML: {error}", self.path) from error

    def _take_size(self, element: Any) -> None:
        width, height = element.findtext("width"), element.findtext("height")
        size = whole(width or ""), whole(height or "")
        if size[0] and size[1]:
            self.size = size[0], size[1]

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        for element in self._elements():
            for shape in self._between(element, bad):
                if shape.tag in _WITHOUT_BOX:
                    bad(f"a shape without a box ({shape.tag})", self.path.name)
                if shape.tag not in _SHAPES or shape.get("outside") == "1":
                    continue
                try:
                    row = self._row(element, shape)
                except SourceError as error:
                    bad(error.reason, self.path.name)
                    continue
                where = f"{self.path.name}, frame {row.frame}"
                kept = checked(row, self.path, where, bad)
                if kept is not None:
                    yield kept

    def _between(self, element: Any, bad: Bad) -> Iterator[Any]:
        """A track's shapes; where it has nothing but key frames, with the boxes between these, which
        move evenly, as CVAT itself has it.
        """
        yield from element
        shapes = [shape for shape in element if shape.get("keyframe")]
        if element.tag != "track" or not all(
            shape.tag == "box" and shape.get("keyframe") == "1" for shape in shapes
        ):
            return
        for one, after in pairwise(shapes):
            if one.get("outside") == "1":
                continue
            with suppress(TypeError, ValueError):
                apart = int(after.get("frame")) - int(one.get("frame"))
                if apart > _MOST_BETWEEN:
                    bad(
                        f"over {_MOST_BETWEEN:,} frames between two key frames of a track"
                        " (the boxes between them)",
                        f"{self.path.name}, frame {one.get('frame')}",
                    )
                    continue
                yield from _moving(one, after)

    def _row(self, element: Any, box: Any) -> BoxRow:
        owner = box if element.tag == "track" else element
        try:
            frame = self._frame(owner)
            left, top, right, bottom = _corners(box)
            identity = int(element.get("id")) if element.tag == "track" else NOBODY
        except (TypeError, ValueError) as error:
            raise SourceError(
                f"a shape of {element.tag} {element.get('id')} without frame or corners",
                self.path,
            ) from error
        label = element.get("label") or box.get("label") or ""
        return BoxRow(frame, identity, (left, top, right - left, bottom - top), 1.0, label)

    def _frame(self, owner: Any) -> int:
        """The frame's number; that of the picture of an image's name, where these are known."""
        if self._names.matched and owner.tag == "image":
            return self._names.frame(owner.get("name") or "")
        return int(owner.get("frame") or owner.get("id"))

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return [self.path]


def _moving(one: Any, after: Any) -> Iterator[Any]:
    """The boxes of the frames between two key frames.

    Raises:
        TypeError, ValueError: one lacks a value.
    """
    first, last = int(one.get("frame")), int(after.get("frame"))
    if after.get("outside") == "1":
        after = one  # it stands still until it is gone
    for frame in range(first + 1, last):
        share = (frame - first) / (last - first)
        between = {
            name: f"{(1 - share) * float(one.get(name)) + share * float(after.get(name)):.6f}"
            for name in ("xtl", "ytl", "xbr", "ybr")
        }
        yield type(one)(one.tag, {**one.attrib, **between, "frame": str(frame)})


def _corners(shape: Any) -> tuple[float, float, float, float]:
    """The box around a shape: left, top, right, bottom.

    Raises:
        TypeError, ValueError: it lacks a value.
    """
    if shape.tag == "box":
        left, top, right, bottom = (
            float(shape.get(name)) for name in ("xtl", "ytl", "xbr", "ybr")
        )
        half = (right - left) / 2, (bottom - top) / 2
        x, y = left + half[0], top + half[1]
    elif shape.tag == "ellipse":
        x, y, *half_ = (float(shape.get(name)) for name in ("cx", "cy", "rx", "ry"))
        half = half_[0], half_[1]
    elif shape.tag == "mask":
        left, top, width, height = (
            float(shape.get(name)) for name in ("left", "top", "width", "height")
        )
        return left, top, left + width, top + height
    else:
        points = [p.split(",") for p in shape.get("points").split(";")]
        xs, ys = [float(p[0]) for p in points], [float(p[1]) for p in points]
        return min(xs), min(ys), max(xs), max(ys)
    turn = math.radians(float(shape.get("rotation") or 0))
    extent = extent_of_ellipse if shape.tag == "ellipse" else extent_of_box
    across, down = extent(*half, turn) if turn else half
    return x - across, y - down, x + across, y + down
