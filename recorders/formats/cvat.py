"""CVAT's XML, for videos (tracks of boxes) and for images."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.files import open_to_read
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.readers import Bad, checked

_DEEPEST = 32
_ONLY_LATER = ("image", "track")


class Cvat:
    """A CVAT XML file, frames from 0; boxes that CVAT says to be outside are none.

    Raises:
        SourceError: a DOCTYPE or an entity in it, or it is not well-formed.
    """

    name = "CVAT XML"
    first_frame: int | None = 0
    is_certain = True

    def __init__(self, path: Path) -> None:
        self.path = path
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
        if width and height and width.isdigit() and height.isdigit():
            self.size = int(width), int(height)

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        for element in self._elements():
            for box in element.iter("box"):
                if box.get("outside") == "1":
                    continue
                row = self._row(element, box)
                where = f"{self.path.name}, frame {row.frame}"
                kept = checked(row, self.path, where, bad)
                if kept is not None:
                    yield kept

    def _row(self, element: Any, box: Any) -> BoxRow:
        owner = box if element.tag == "track" else element
        try:
            frame = int(owner.get("frame") or owner.get("id"))
            left, top, right, bottom = (
                float(box.get(name)) for name in ("xtl", "ytl", "xbr", "ybr")
            )
            identity = int(element.get("id")) if element.tag == "track" else NOBODY
        except (TypeError, ValueError) as error:
            raise SourceError(
                f"a box of {element.tag} {element.get('id')} without frame or corners",
                self.path,
            ) from error
        label = element.get("label") or box.get("label") or ""
        return BoxRow(frame, identity, (left, top, right - left, bottom - top), 1.0, label)

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return [self.path]
