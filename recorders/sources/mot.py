"""MOTChallenge text: ``frame,id,x,y,w,h[,confidence[,...]]``, frames from 1, boxes by their top
left corner.

Strict on values (each message names the line), lenient on order: detectors that work in batches
write unsorted files. The ids are never recorded; where a file has any, a frame's boxes are put in
an order of their own, so that not even the order of the rows tells who is who.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from itertools import groupby
from operator import itemgetter
from pathlib import Path

import numpy as np

from recorders.errors import LimitError, SourceError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.message_checks import LARGEST
from recorders.messages import Box
from recorders.pictures import check_size
from recorders.sources.source import (
    MAX_FRAMES,
    Image,
    SourceFrame,
    detections_of,
    existing_file,
    outside,
    rate_or_assumed,
    sha256,
)

_COLUMNS = range(6, 11)
_LONGEST_LINE = 4096
_FIELDS = ("frame", "id", "x", "y", "width", "height", "confidence")

Row = tuple[int, float, float, float, float, float, float]
"""Frame (from 1), id, x, y, w, h, confidence."""


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
        self._limits = limits
        self.last_frame = 0
        self.right = self.bottom = 0.0
        self.sorted = True
        self.repeated = 0
        self.first_repeated = 0
        self._named = False
        self._rows = 0
        previous = 0
        for _, row in self._read():
            frame, identity, x, y, w, h, _ = row
            self.sorted = self.sorted and frame >= previous
            previous = frame
            self.last_frame = max(self.last_frame, frame)
            self.right, self.bottom = max(self.right, x + w), max(self.bottom, y + h)
            self._named = self._named or identity > 0
            self._rows += 1
        if not self._rows:
            raise SourceError("no detections in this file", path)

    def _read(self) -> Iterator[tuple[int, Row]]:
        columns = 0
        with self.path.open("rb") as f:
            number = 0
            while line := f.readline(_LONGEST_LINE + 1):
                number += 1
                text = self._text(line, number)
                if not text:
                    continue
                cells = text.split(",")
                columns = columns or len(cells)
                if len(cells) != columns or columns not in _COLUMNS:
                    wanted = (
                        f"{columns} as in the first row"
                        if columns in _COLUMNS
                        else "6 to 10, separated by commas"
                    )
                    raise SourceError(
                        f"{len(cells)} columns, wanted {wanted}: {text[:60]!r}",
                        self.path,
                        number,
                    )
                yield number, self._row(cells, number)

    def _text(self, line: bytes, number: int) -> str:
        if len(line) > _LONGEST_LINE:
            raise SourceError(
                f"a line of over {_LONGEST_LINE} bytes: not MOTChallenge text",
                self.path,
                number,
            )
        try:
            return line.decode("utf-8-sig" if number == 1 else "utf-8").strip()
        except UnicodeDecodeError:
            raise SourceError("not text", self.path, number) from None

    def _row(self, cells: list[str], line: int) -> Row:
        values = []
        for name, cell in zip(_FIELDS, cells, strict=False):
            try:
                value = float(cell) if "_" not in cell else math.nan
            except ValueError:
                raise SourceError(
                    f"{name} {cell.strip()[:40]!r} is not a number", self.path, line
                ) from None
            if not math.isfinite(value):
                raise SourceError(
                    f"{name} is {cell.strip()[:40]}, a finite number is wanted",
                    self.path,
                    line,
                )
            values.append(value)
        frame, identity, x, y, w, h = values[:6]
        if frame != int(frame) or frame < 1:
            raise SourceError(
                f"frame {cells[0].strip()[:40]}: frames are whole numbers from 1",
                self.path,
                line,
            )
        if frame > MAX_FRAMES:
            raise LimitError(
                f"frame {int(frame)}, over the limit of {MAX_FRAMES} frames",
                f"{self.path}:{line}",
            )
        if w <= 0 or h <= 0:
            raise SourceError(
                f"a box of width {w:g} and height {h:g}: both must be over 0",
                self.path,
                line,
            )
        if max(abs(x), abs(y), w, h) > LARGEST:
            raise SourceError(
                f"a box at {x:g}, {y:g} of {w:g} x {h:g}: beyond any picture",
                self.path,
                line,
            )
        score = values[6] if len(values) > 6 else 1.0
        if abs(score) > LARGEST:
            raise SourceError(
                f"confidence {score:g}: at most {LARGEST:g} is wanted", self.path, line
            )
        return int(frame), identity, x, y, w, h, score

    def check_inside(self, width: float, height: float, picture: str) -> None:
        """Refuse a file with a box that shares no pixel with a picture of this size (in the
        file's pixels).

        Raises:
            SourceError: names the first such line, the picture's size and how far the boxes reach.
        """
        for line, (_, _, *box, _) in self._read():
            x, y, w, h = box
            if outside((x, y, w, h), width, height):
                reach = f"{math.ceil(self.right)}x{math.ceil(self.bottom)}"
                raise SourceError(
                    f"detections beyond the picture: a box at {x:g}, {y:g} of {w:g} x"
                    f" {h:g}, the {picture}; the file's boxes reach to {reach}: say with"
                    " --size WxH which size they were made for",
                    self.path,
                    line,
                )

    def by_frame(self) -> Iterator[FrameRows]:
        """The frames that have rows, in order, without rows that repeat another to the letter."""
        self.repeated = 0
        rows = self._read() if self.sorted else self._in_order()
        for number, group in groupby(rows, key=lambda item: item[1][0]):
            kept: dict[Row, None] = {}
            for line, row in group:
                if row in kept:
                    self.first_repeated = self.first_repeated if self.repeated else line
                    self.repeated += 1
                    continue
                kept[row] = None
                if len(kept) > self._limits.max_detections_per_frame:
                    limit = self._limits.max_detections_per_frame
                    where = f"{self.path}:{line}"
                    raise LimitError(
                        f"over {limit} detections in frame {number}"
                        " (max_detections_per_frame)",
                        where,
                    )
            ordered = (
                sorted(kept, key=itemgetter(2, 3, 4, 5, 6)) if self._named else list(kept)
            )
            yield FrameRows(number, [r[2:6] for r in ordered], [r[6] for r in ordered])

    def _in_order(self) -> Iterator[tuple[int, Row]]:
        values = array("d")
        for line, row in self._read():
            values.extend((line, *row))
        table = np.frombuffer(values, np.float64).reshape(-1, 8)
        for k in np.argsort(table[:, 1], kind="stable"):
            line, frame, identity, x, y, w, h, score = table[k].tolist()
            yield int(line), (int(frame), identity, x, y, w, h, score)

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
