"""Detections from MOTChallenge text (`recorders.formats.motchallenge` says what its rows are).

Lenient on order: detectors that work in batches write unsorted files. The ids are never recorded;
where a file has any, a frame's boxes are put in an order of their own, so that not even the order
of the rows tells who is who.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby
from operator import attrgetter
from pathlib import Path

import numpy as np

from recorders.errors import LimitError, SourceError
from recorders.files import existing_file, sha256
from recorders.formats import BoxRow, MotReader
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Box
from recorders.pictures import check_size
from recorders.sources.source import (
    Image,
    SourceFrame,
    detections_of,
    outside,
    rate_or_assumed,
)


@dataclass(frozen=True, slots=True)
class FrameRows:
    """One frame's rows: its number from 1, boxes (x, y, w, h) in the file's pixels, confidences."""

    number: int
    boxes: list[Box]
    scores: list[float]


class MotText:
    """A MOTChallenge file, checked as a whole when it is opened, then read frame by frame.

    Sorted files are streamed. Unsorted ones are sorted in memory, rows of one frame keeping their
    order.

    Attributes:
        last_frame: the largest frame number.
        right, bottom: how far the boxes reach, in the file's pixels.
        sorted: frame numbers never decrease.
        repeated: rows left out because they repeat another of the same frame; known after
            `by_frame`.

    Raises:
        SourceError: a row that is not as it must be; names the line.
        LimitError: too many detections in a frame, or a frame number beyond all reason.
    """

    def __init__(self, path: Path, limits: Limits = DEFAULT_LIMITS) -> None:
        self.path = existing_file(path)
        self._reader = MotReader(path)
        self._limits = limits
        self.last_frame = 0
        self.right = self.bottom = 0.0
        self.sorted = True
        self.repeated = 0
        self.first_repeated = 0
        self._named = False
        self._rows = 0
        previous = 0
        for row in self._reader.rows():
            x, y, w, h = row.box
            self.sorted = self.sorted and row.frame >= previous
            previous = row.frame
            self.last_frame = max(self.last_frame, row.frame + 1)
            self.right, self.bottom = max(self.right, x + w), max(self.bottom, y + h)
            self._named = self._named or row.identity > 0
            self._rows += 1
        if not self._rows:
            raise SourceError("no detections in this file", path)

    def check_inside(self, width: float, height: float, picture: str) -> None:
        """Refuse a file with a box that shares no pixel with a picture of this size (in the
        file's pixels).

        Raises:
            SourceError: names the first such line, the picture's size and how far the boxes reach.
        """
        for row in self._reader.rows():
            x, y, w, h = row.box
            if outside(row.box, width, height):
                reach = f"{math.ceil(self.right)}x{math.ceil(self.bottom)}"
                raise SourceError(
                    f"detections beyond the picture: a box at {x:g}, {y:g} of {w:g} x"
                    f" {h:g}, the {picture}; the file's boxes reach to {reach}: say with"
                    " --size WxH which size they were made for",
                    self.path,
                    row.line,
                )

    def by_frame(self) -> Iterator[FrameRows]:
        """The frames that have rows, in order, without rows that repeat another to the letter."""
        self.repeated = 0
        rows = self._reader.rows() if self.sorted else self._in_order()
        for frame, group in groupby(rows, key=attrgetter("frame")):
            kept: dict[BoxRow, None] = {}
            for row in group:
                unplaced = row._replace(line=0)
                if unplaced in kept:
                    self.first_repeated = self.first_repeated if self.repeated else row.line
                    self.repeated += 1
                    continue
                kept[unplaced] = None
                if len(kept) > self._limits.max_detections_per_frame:
                    limit = self._limits.max_detections_per_frame
                    where = f"{self.path}:{row.line}"
                    raise LimitError(
                        f"over {limit} detections in frame {frame + 1}"
                        " (max_detections_per_frame)",
                        where,
                    )
            ordered = (
                sorted(kept, key=attrgetter("box", "score")) if self._named else list(kept)
            )
            boxes, scores = [r.box for r in ordered], [r.score for r in ordered]
            yield FrameRows(frame + 1, boxes, scores)

    def _in_order(self) -> Iterator[BoxRow]:
        values = array("d")
        for row in self._reader.rows():
            values.extend((row.frame, row.identity, *row.box, row.score, row.line))
        table = np.frombuffer(values, np.float64).reshape(-1, 8)
        for k in np.argsort(table[:, 0], kind="stable"):
            frame, identity, x, y, w, h, score, line = table[k].tolist()
            yield BoxRow(int(frame), int(identity), (x, y, w, h), score, line=int(line))

    def notes(self) -> list[str]:
        """What a reader of the recording should know."""
        if self.sorted:
            return []
        return [f"{self.path.name}: the frames are not in order; they were sorted"]

    def losses(self) -> list[str]:
        """What the last reading left out."""
        if not self.repeated:
            return []
        where = f"{self.path.name}:{self.first_repeated}"
        return [
            f"{self.repeated} rows repeat another row of their frame and were left out, the"
            f" first at {where}"
        ]


class MotSource:
    """Detections from a MOTChallenge file alone, without pictures; a frame without rows has no
    detections.

    Raises:
        SourceError, LimitError: as `MotText`; or boxes lie beyond the given size.
    """

    name = "MOTChallenge text"
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
        self.path = path
        self.losses: list[str] = []
        self._text = MotText(path, limits)
        self.notes = self._text.notes()
        self._rate = rate_or_assumed(fps, self.notes)
        self.frame_ns = self._rate.frame_ns
        self.frame_count: int | None = self._text.last_frame
        if size is None:
            size = max(1, math.ceil(self._text.right)), max(1, math.ceil(self._text.bottom))
            self.notes.append(
                f"no picture size is known: assuming {size[0]}x{size[1]}, as far as boxes"
                " reach; say it with --size"
            )
        self.width, self.height = size
        check_size(self.width, self.height, path, limits)
        self._text.check_inside(
            self.width, self.height, f"picture is {self.width}x{self.height}"
        )

    def frames(self) -> Iterator[SourceFrame]:
        """Frames 0 to the last that has detections, none left out."""
        self.losses.clear()
        index = 0
        for rows in self._text.by_frame():
            for k in range(index, rows.number):
                present = k == rows.number - 1
                boxes, scores = (rows.boxes, rows.scores) if present else ([], [])
                found = detections_of(k, self.width, self.height, boxes, scores)
                yield SourceFrame(k, self._rate.time_ns(k), detections=found)
            index = rows.number
        self.losses += self._text.losses()

    def sample(self, count: int) -> Iterator[Image]:  # noqa: ARG002
        """Nothing: there are no pictures."""
        return iter(())

    def digests(self) -> list[tuple[str, str]]:
        """The file's SHA-256."""
        return [(self.path.name, sha256(self.path))]
