"""Detections from CAVIAR's hand-labelled sequences: boxes, no pixels.

Only where somebody stands is taken over. Ids, roles, situations, groups and contexts are the
answers that a tracker is to find: they never enter the recording, and boxes are ordered by place,
so that the labels' order does not tell either.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import NoReturn

from recorders.errors import SourceError
from recorders.files import existing_file, sha256
from recorders.formats import CaviarReader
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Box
from recorders.pictures import Image, check_size
from recorders.sources.source import Rate, SourceFrame, detections_of, outside

SIZE = (384, 288)
FPS = Fraction(25)


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
        self._reader = CaviarReader(path, limits)
        self.notes: list[str] = []
        self.losses: list[str] = []
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
        for number, rows in self._reader.frames():
            for row in rows:
                if outside(row.box, self.width, self.height):
                    self._refuse(number, row.box)
            yield number, sorted(row.box for row in rows)

    def _refuse(self, frame: int, box: Box) -> NoReturn:
        x, y, w, h = (int(v) for v in (box[0] + box[2] / 2, box[1] + box[3] / 2, *box[2:]))
        raise SourceError(
            f"detections beyond the picture: frame {frame}: an object at {x}, {y} of {w} x"
            f" {h}, the picture is {self.width}x{self.height}; say with --size WxH",
            self.path,
        )

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
