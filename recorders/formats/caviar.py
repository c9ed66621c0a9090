"""CAVIAR's hand-labelled sequences (CVML XML): boxes by their centre, frames from 0.

Rules, for detections and truths alike: numbers are whole, width and height are over 0, frame
numbers increase, and an object without a box, a DOCTYPE or an entity is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.files import open_to_read
from recorders.formats.boxes import MAX_FRAMES, NOBODY, BoxRow, check_box
from recorders.limits import DEFAULT_LIMITS, Limits

_DEEPEST = 32
_MOST_ELEMENTS_PER_DETECTION = 100
_DIGITS = 9


class CaviarReader:
    """A CAVIAR file; every reading goes through it anew."""

    def __init__(self, path: Path, limits: Limits = DEFAULT_LIMITS) -> None:
        self.path = path
        self._limits = limits

    def rows(self) -> Iterator[BoxRow]:
        """The labelled boxes in the file's order.

        Raises:
            SourceError, LimitError: as `frames`.
        """
        for _, rows in self.frames():
            yield from rows

    def frames(self) -> Iterator[tuple[int, list[BoxRow]]]:
        """Number and labelled boxes of every frame that the file has, also of one without boxes.

        Raises:
            SourceError: cannot be read, not well-formed, a DOCTYPE or an entity in it, a value that is not as it
                must be.
            LimitError: nested too deep, too many objects in a frame.
        """
        previous = -1
        for frame in self._elements():
            number = self._whole(frame, "number", "a frame")
            if number <= previous:
                raise SourceError(
                    f"frame {number} after frame {previous}: numbers must increase",
                    self.path,
                )
            if number > MAX_FRAMES:
                raise LimitError(
                    f"frame {number}, over the limit of {MAX_FRAMES} frames", self.path
                )
            objects = frame.findall("objectlist/object")
            if len(objects) > self._limits.max_detections_per_frame:
                limit = self._limits.max_detections_per_frame
                text = (
                    f"frame {number}: {len(objects)} objects, over the limit of {limit}"
                    " (max_detections_per_frame)"
                )
                raise LimitError(text, self.path)
            yield number, [self._row(labelled, number) for labelled in objects]
            previous = number

    def _elements(self) -> Iterator[Any]:
        from xml.etree.ElementTree import ParseError

        from defusedxml import DefusedXmlException
        from defusedxml.ElementTree import iterparse

        most = self._limits.max_detections_per_frame * _MOST_ELEMENTS_PER_DETECTION
        depth = elements = 0
        root: Any = None
        try:
            with open_to_read(self.path) as file:
                for event, element in iterparse(
                    file, events=("start", "end"), forbid_dtd=True
                ):
                    if event == "start":
                        depth += 1
                        elements += 1
                        root = element if root is None else root
                        if depth > _DEEPEST or elements > most:
                            what = (
                                f"nested over {_DEEPEST} deep"
                                if depth > _DEEPEST
                                else f"over {most} elements in a frame"
                            )
                            raise LimitError(f"{what}: not CAVIAR XML", self.path)
                        continue
                    depth -= 1
                    if element.tag == "frame" and depth == 1:
                        yield element
                        elements = 0
                        root.clear()
        except DefusedXmlException as error:
            kind = {"DTDForbidden": "a DOCTYPE", "EntitiesForbidden": "an entity"}.get(
                type(error).__name__, "a reference"
            )
            raise SourceError(
                f"{kind} in the XML: refused, it could reach for other files or grow",
                self.path,
            ) from error
        except (ParseError, ValueError, LookupError) as error:
            raise SourceError(
                f"not well-formed XML: {error}: not CAVIAR XML", self.path
            ) from error

    def _row(self, labelled: Any, frame: int) -> BoxRow:
        box = labelled.find("box")
        where = f"frame {frame}: an object"
        if box is None:
            raise SourceError(f"{where} without a box", self.path)
        width, height = (self._whole(box, name, where) for name in ("w", "h"))
        across, down = (self._whole(box, name, where) for name in ("xc", "yc"))
        if width <= 0 or height <= 0:
            raise SourceError(
                f"{where} of width {width} and height {height}: both must be over 0",
                self.path,
            )
        named = labelled.get("id") is not None
        identity = self._whole(labelled, "id", where) if named else NOBODY
        corner = (across - width / 2, down - height / 2)
        row = BoxRow(frame, identity, (*corner, float(width), float(height)))
        return check_box(row, self.path)

    def _whole(self, element: Any, name: str, where: str) -> int:
        text = element.get(name, "").strip()
        digits = text.removeprefix("-")
        if not (digits.isascii() and digits.isdigit() and len(digits) <= _DIGITS):
            raise SourceError(
                f'{where} with {name}="{text[:40]}": a whole number is wanted', self.path
            )
        return int(text)
