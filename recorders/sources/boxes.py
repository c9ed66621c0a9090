"""Detections from a file of boxes, of whatever format (`recorders.formats`).

Lenient on order: detectors that work in batches write unsorted files. Rows that are no boxes are
left out and told. The ids are never recorded; where a file has any, a frame's boxes are put in an
order of their own, so that not even the order of the rows tells who is who.
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

from recorders.errors import LimitError, SourceError, UsageError
from recorders.files import sha256
from recorders.formats import BoxRow
from recorders.formats.opening import BoxOptions, open_rows
from recorders.left_out import LeftOut
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import Box
from recorders.pictures import Image, check_size
from recorders.sources.source import SourceFrame, detections_of, outside, rate_or_assumed

_MOST_OUTSIDE = 0.25
_SURE = 1.5
_FEW = 8
_LATE = 2
"""A first frame after this does not tell whether frames count from 0 or from 1."""
_TABLES = ("MOTChallenge text",)


@dataclass(frozen=True, slots=True)
class FrameRows:
    """One frame's rows: its number from 1, boxes (x, y, w, h) in the file's pixels, confidences,
    classes.
    """

    number: int
    boxes: list[Box]
    scores: list[float]
    labels: list[str]


class BoxFile:
    """A file of boxes, looked through when it is opened, then read frame by frame.

    Sorted files are streamed. Unsorted ones are sorted in memory, rows of one frame keeping their
    order.

    Attributes:
        name: its format.
        size: the pictures' size, where the file says it.
        base: what the file calls the first frame.
        last_frame: the largest frame number, counted from 1.
        right, bottom: how far the boxes reach, in the file's pixels.
        sorted: frame numbers never decrease.

    Raises:
        SourceError: it cannot be read, or holds no box.
        UsageError: it may be read in two ways.
        LimitError: too many detections in a frame, or a frame number beyond all reason.
    """

    def __init__(
        self,
        path: Path,
        size: tuple[int, int] | None = None,
        options: BoxOptions | None = None,
        limits: Limits = DEFAULT_LIMITS,
        pictures: int | None = None,
    ) -> None:
        options = options or BoxOptions()
        self.path = path
        self._reader = open_rows(path, size, options, limits)
        self._limits = limits
        self._bad = LeftOut()
        self._inside: tuple[float, float] | None = None
        self.name = self._reader.name
        self.right = self.bottom = 0.0
        self.sorted = True
        self._repeated = LeftOut()
        self._named = False
        self._count = 0
        self._highest_score = 0.0
        first, last, previous = math.inf, -1, -1
        for row in self._reader.rows(self._bad.note):
            x, y, w, h = row.box
            self.sorted = self.sorted and row.frame >= previous
            previous = row.frame
            first, last = min(first, row.frame), max(last, row.frame)
            self.right, self.bottom = max(self.right, x + w), max(self.bottom, y + h)
            self._named = self._named or row.identity > 0
            self._highest_score = max(self._highest_score, row.score)
            self._count += 1
        if not self._count:
            left = "; ".join(self._bad.lines())
            raise SourceError(
                "no detections in this file" + (f": {left}" if left else ""), path
            )
        if options.columns is None:
            self._check_shares()
        self.size = self._reader.size
        self._lowest = int(first)
        self.base = self._first_frame(options.first_frame, int(first), last, pictures)
        self.last_frame = max(1, last - self.base + 1)

    def _check_shares(self) -> None:
        """Boxes that are all smaller than a pixel are shares of the picture.

        Raises:
            UsageError: they are.
        """
        if self._count >= _FEW and max(self.right, self.bottom) <= _SURE:
            shares = "all boxes lie between 0 and 1, as shares of the picture do"
            if not hasattr(self._reader, "columns"):
                raise SourceError(f"{shares}; {self.name} has pixels", self.path)
            raise UsageError(
                f"{self.path}: {shares}; say what they are with --columns, as frame,x1n,y1n,x2n,y2n or"
                " frame,cxn,cyn,wn,hn (n: a share), or frame,x,y,w,h"
            )

    def _first_frame(
        self, given: int | None, lowest: int, last: int, pictures: int | None
    ) -> int:
        if given is not None:
            return given
        if lowest == 0:
            return 0
        stated = self._reader.first_frame
        if stated is None:
            return 1
        # As many frames as pictures, if they count from 1: then they do.
        fits = pictures is not None and last == pictures and not self._reader.is_certain
        return 1 if fits else stated

    def check_inside(self, width: float, height: float, picture: str) -> None:
        """Leave out the boxes that share no pixel with a picture of this size (in the file's
        pixels); refuse a file with many of them, which was made for another picture.

        Raises:
            SourceError: names the first such line, the picture's size and how far the boxes reach.
        """
        first: BoxRow | None = None
        count = 0
        for row in self._reader.rows(_nobody):
            if outside(row.box, width, height):
                first = first or row
                count += 1
        self._inside = width, height
        if first is not None and count > _MOST_OUTSIDE * self._count:
            x, y, w, h = first.box
            reach = f"{math.ceil(self.right)}x{math.ceil(self.bottom)}"
            raise SourceError(
                f"detections beyond the picture: a box at {x:g}, {y:g} of {w:g} x {h:g}, the"
                f" {picture}; the file's boxes reach to {reach}: say with --size WxH which"
                " size they were made for",
                self.path,
                first.line or None,
            )

    def by_frame(self) -> Iterator[FrameRows]:
        """The frames that have rows, in order, without rows that repeat another to the letter."""
        self._bad.clear()
        self._repeated.clear()
        rows = self._reader.rows(self._bad.note) if self.sorted else self._in_order()
        for frame, group in groupby(rows, key=attrgetter("frame")):
            kept: dict[BoxRow, None] = {}
            for row in group:
                if self._left_out(row, kept):
                    continue
                kept[row._replace(line=0)] = None
                if len(kept) > self._limits.max_detections_per_frame:
                    limit = self._limits.max_detections_per_frame
                    raise LimitError(
                        f"over {limit} detections in frame {frame - self.base + 1}"
                        " (max_detections_per_frame)",
                        f"{self.path}:{row.line}",
                    )
            ordered = (
                sorted(kept, key=attrgetter("box", "score", "label"))
                if self._named
                else list(kept)
            )
            if ordered and frame >= self.base:
                yield FrameRows(
                    frame - self.base + 1,
                    [r.box for r in ordered],
                    [r.score for r in ordered],
                    [r.label for r in ordered],
                )

    def _left_out(self, row: BoxRow, kept: dict[BoxRow, None]) -> bool:
        where = f"{self.path.name}:{row.line}" if row.line else f"frame {row.frame}"
        if row.frame < self.base:
            self._bad.note(f"a row of frame {row.frame}, before the first frame", where)
            return True
        if self._inside is not None and outside(row.box, *self._inside):
            self._bad.note("a box beyond the picture", where)
            return True
        if row._replace(line=0) in kept:
            self._repeated.note("a row that repeats another row of its frame", where)
            return True
        return False

    def _in_order(self) -> Iterator[BoxRow]:
        values = array("d")
        labels: dict[str, int] = {}
        for row in self._reader.rows(self._bad.note):
            label = labels.setdefault(row.label, len(labels))
            values.extend((row.frame, row.identity, *row.box, row.score, label, row.line))
        names = list(labels)
        table = np.frombuffer(values, np.float64).reshape(-1, 9)
        for k in np.argsort(table[:, 0], kind="stable"):
            frame, identity, x, y, w, h, score, label, line = table[k].tolist()
            yield BoxRow(
                int(frame), int(identity), (x, y, w, h), score, names[int(label)], int(line)
            )

    def notes(self) -> list[str]:
        """What a reader of the recording should know."""
        found = list(self._reader.notes)
        if self.name not in _TABLES or self.base == 0 or self._lowest > _LATE:
            unseen = self._lowest > self.base and self.name in _TABLES
            certain = self._reader.is_certain and not unseen
            hint = "" if certain else " (--first-frame says otherwise)"
            found.append(
                f"{self.path.name}: {self.name}, frames counted from {self.base}{hint}"
            )
        if self._highest_score > _SURE:
            found.append(
                f"{self.path.name}: scores reach {self._highest_score:g}; they are taken as"
                " they are"
            )
        if not self.sorted:
            found.append(f"{self.path.name}: the frames are not in order; they were sorted")
        return found

    def losses(self) -> list[str]:
        """What the last reading left out."""
        return self._bad.lines() + self._repeated.lines()

    def digests(self) -> list[tuple[str, str]]:
        """Name and SHA-256 of each file."""
        return [(path.name, sha256(path)) for path in self._reader.files()]


def _nobody(what: str, where: str) -> None:
    """It was told before."""


class BoxSource:
    """Detections alone, without pictures; a frame without rows has no detections.

    Raises:
        SourceError, UsageError, LimitError: as `BoxFile`; or most boxes lie beyond the size.
    """

    has_images = False
    stills = False
    has_detections = True

    def __init__(
        self,
        path: Path,
        fps: Fraction | None = None,
        size: tuple[int, int] | None = None,
        options: BoxOptions | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self.path = path
        self.losses: list[str] = []
        self._file = BoxFile(path, size, options, limits)
        self.name = self._file.name
        self.notes = self._file.notes()
        self._rate = rate_or_assumed(fps, self.notes)
        self.frame_ns = self._rate.frame_ns
        self.frame_count: int | None = self._file.last_frame
        size = size or self._file.size
        if size is None:
            size = max(1, math.ceil(self._file.right)), max(1, math.ceil(self._file.bottom))
            self.notes.append(
                f"no picture size is known: assuming {size[0]}x{size[1]}, as far as boxes"
                " reach; say it with --size"
            )
        self.width, self.height = size
        check_size(self.width, self.height, path, limits)
        self._file.check_inside(
            self.width, self.height, f"picture is {self.width}x{self.height}"
        )

    def frames(self) -> Iterator[SourceFrame]:
        """Frames 0 to the last that has detections, none left out."""
        self.losses.clear()
        index = 0
        for rows in self._file.by_frame():
            for k in range(index, rows.number):
                found = (
                    detections_of(
                        k, self.width, self.height, rows.boxes, rows.scores, rows.labels
                    )
                    if k == rows.number - 1
                    else detections_of(k, self.width, self.height, [], [])
                )
                yield SourceFrame(k, self._rate.time_ns(k), detections=found)
            index = rows.number
        self.losses += self._file.losses()

    def sample(self, count: int) -> Iterator[Image]:  # noqa: ARG002
        """Nothing: there are no pictures."""
        return iter(())

    def digests(self) -> list[tuple[str, str]]:
        """SHA-256 of each file."""
        return self._file.digests()
