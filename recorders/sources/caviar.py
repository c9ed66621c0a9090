"""CAVIAR's hand-labelled sequences (CVML XML): boxes by their centre, no pixels.

Only where somebody stands is taken over. Ids, roles, situations, groups and contexts are the
answers that a tracker is to find: they never enter the recording, and boxes are ordered by place,
so that the labels' order does not tell either.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

from recorders.errors import LimitError, SourceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Box
from recorders.pictures import check_size
from recorders.sources.source import (
    MAX_FRAMES,
    Image,
    Rate,
    SourceFrame,
    detections_of,
    existing_file,
    outside,
    sha256,
)

SIZE = (384, 288)
FPS = Fraction(25)
_DEEPEST = 32
_MOST_ELEMENTS_PER_DETECTION = 100
_DIGITS = 9


class CaviarSource:
    """A CAVIAR XML file: frame numbers as in the file, counted from its first, 384x288 at 25 fps
    unless said otherwise.

    Raises:
        SourceError: not such a file, a DOCTYPE or an entity in it, a value that is not as it must
            be.
        LimitError: nested too deep, too many objects in a frame.
    """

    name = "CAVIAR XML"
    has_images = False
    stills = False
    has_detections = True

    def __init__(
        self,
        path: Path,
        fps: Fraction | None = None,
        size: tuple[int, int] | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self.path = existing_file(path)
        self.notes: list[str] = []
        self.losses: list[str] = []
        self._limits = limits
        self.width, self.height = size or SIZE
        check_size(self.width, self.height, path, limits)
        self._rate = Rate(fps or FPS)
        self.frame_ns = self._rate.frame_ns
        self._first = self._last = -1
        for number, _ in self._labelled():
            self._first = number if self._first < 0 else self._first
            self._last = number
        if self._last < 0:
            raise SourceError("no frames in this file: not CAVIAR XML", path)
        self.frame_count: int | None = self._last - self._first + 1

    def _labelled(self) -> Iterator[tuple[int, list[Box]]]:
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
            yield number, sorted(self._box(o, number) for o in objects)
            previous = number

    def _elements(self) -> Iterator[Any]:
        from xml.etree.ElementTree import ParseError

        from defusedxml import DefusedXmlException
        from defusedxml.ElementTree import iterparse

        most = self._limits.max_detections_per_frame * _MOST_ELEMENTS_PER_DETECTION
        depth = elements = 0
        root: Any = None
        try:
            for event, element in iterparse(
                self.path, events=("start", "end"), forbid_dtd=True
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
        except DefusedXmlException as e:
            kind = {"DTDForbidden": "a DOCTYPE", "EntitiesForbidden": "an entity"}.get(
                type(e).__name__, "a reference"
            )
            raise SourceError(
                f"{kind} in the XML: refused, it could reach for other files or grow",
                self.path,
            ) from e
        except (ParseError, ValueError, LookupError) as e:
            raise SourceError(f"not well-formed XML: {e}", self.path) from e

    def _box(self, labelled: Any, frame: int) -> Box:
        box = labelled.find("box")
        where = f"frame {frame}: an object"
        if box is None:
            raise SourceError(f"{where} without a box", self.path)
        w, h = (self._whole(box, name, where) for name in ("w", "h"))
        xc, yc = (self._whole(box, name, where) for name in ("xc", "yc"))
        if w <= 0 or h <= 0:
            raise SourceError(
                f"{where} of width {w} and height {h}: both must be over 0", self.path
            )
        found = (xc - w / 2, yc - h / 2, float(w), float(h))
        if outside(found, self.width, self.height):
            size = f"the picture is {self.width}x{self.height}"
            raise SourceError(
                f"detections beyond the picture: {where} at {xc}, {yc} of {w} x {h},"
                f" {size}; say with --size WxH",
                self.path,
            )
        return found

    def _whole(self, element: Any, name: str, where: str) -> int:
        text = element.get(name, "").strip()
        digits = text.removeprefix("-")
        if not (digits.isascii() and digits.isdigit() and len(digits) <= _DIGITS):
            raise SourceError(
                f'{where} with {name}="{text[:40]}": a whole number is wanted', self.path
            )
        return int(text)

    def frames(self) -> Iterator[SourceFrame]:
        """Every frame from the file's first to its last; one that the file leaves out has no
        detections.
        """
        index = 0
        for number, boxes in self._labelled():
            for k in range(index, number - self._first + 1):
                mine = boxes if k == number - self._first else []
                found = detections_of(k, self.width, self.height, mine, [1.0] * len(mine))
                yield SourceFrame(k, self._rate.time_ns(k), detections=found)
            index = number - self._first + 1

    def sample(self, count: int) -> Iterator[Image]:  # noqa: ARG002
        """Nothing: there are no pictures."""
        return iter(())

    def digests(self) -> list[tuple[str, str]]:
        """The file's SHA-256."""
        return [(self.path.name, sha256(self.path))]
