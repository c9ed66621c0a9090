"""Tables of labelled boxes, from MOTChallenge text or CAVIAR XML: the truth, or what a tracker
said.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.errors import AmbiguousError, SceneTraceError, SourceError
from recorders.files import open_to_read
from recorders.formats import CaviarReader, MotReader
from recorders.formats.annotations import CROWD
from recorders.formats.boxes import NOBODY
from recorders.formats.motchallenge import counts_from
from recorders.formats.opening import open_rows
from recorders.left_out import LeftOut

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Row = tuple[int, int, float, float, float, float, float]

OUTSIDE_SHARE = 0.01
"""More of the true centres than this outside the recording's picture: truth and recording differ
in size.
"""


@dataclass(frozen=True, eq=False)
class MotTable:
    """Boxes with identities over time, sorted by frame; the rows of a frame keep their order.

    Attributes:
        frames: (N,) int64, from 0.
        ids: (N,) int64, each at most once in a frame.
        boxes: (N, 4) float64: x, y, w, h in pixels.
        confidences: (N,) float64.
        classes: (N,) int64, MOTChallenge's, where the file has them.
        regions: (M, 5) float64: frame, x, y, w, h of what nobody labelled, crowds and such.
        left_out: what in the file is no box, a line for each reason.
    """

    frames: IntArray
    ids: IntArray
    boxes: FloatArray
    confidences: FloatArray
    classes: IntArray | None = None
    regions: FloatArray | None = None
    left_out: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.frames)

    @classmethod
    def from_rows(cls, rows: list[Row]) -> MotTable:
        """A table of (frame from 0, id, x, y, w, h, confidence) rows in any order of frames.

        Raises:
            SceneTraceError: an identity occurs twice in a frame.
        """
        frames = np.array([row[0] for row in rows], np.int64)
        ids = np.array([row[1] for row in rows], np.int64)
        boxes = np.array([row[2:6] for row in rows], np.float64).reshape(-1, 4)
        confidences = np.array([row[6] for row in rows], np.float64)
        order = np.argsort(frames, kind="stable")
        table = cls(frames[order], ids[order], boxes[order], confidences[order])
        twice = table.first_duplicate()
        if twice is not None:
            raise SceneTraceError(f"identity {twice[1]} occurs twice in frame {twice[0]}")
        return table

    def first_duplicate(self) -> tuple[int, int] | None:
        """The first (frame, id) that occurs more than once, or None."""
        order = np.lexsort((self.ids, self.frames))
        f, i = self.frames[order], self.ids[order]
        same = np.flatnonzero((f[1:] == f[:-1]) & (i[1:] == i[:-1]))
        return (int(f[same[0]]), int(i[same[0]])) if len(same) else None

    def select(self, keep: BoolArray) -> MotTable:
        """The rows where ``keep``, (N,) bool, is true."""
        return MotTable(
            self.frames[keep],
            self.ids[keep],
            self.boxes[keep],
            self.confidences[keep],
            None if self.classes is None else self.classes[keep],
            self.regions,
            self.left_out,
        )

    def scaled(self, sx: float, sy: float) -> MotTable:
        """The same boxes in a picture that is ``sx`` times as wide and ``sy`` times as high."""
        factors = np.array([sx, sy, sx, sy])
        regions = self.regions
        if regions is not None:
            regions = np.concatenate([regions[:, :1], regions[:, 1:] * factors], axis=1)
        return replace(self, boxes=self.boxes * factors, regions=regions)

    def between(self, first: int, last: int) -> MotTable:
        """The rows of the frames first <= frame < last."""
        return self.select((self.frames >= first) & (self.frames < last))

    @property
    def centres(self) -> FloatArray:
        """(N, 2) centres of the boxes."""
        return self.boxes[:, :2] + self.boxes[:, 2:] / 2


def read_mot(path: str | Path) -> MotTable:
    """Read MOTChallenge text: ``frame,id,x,y,w,h[,conf,...]``, frames from 1 (here from 0), in
    any order of rows.

    Raises:
        SourceError: as `recorders.formats.MotReader`, with the line; or an identity occurs twice
            in a frame.
        LimitError: a frame number beyond all reason.
    """
    rows: list[Row] = []
    labels: list[str] = []
    seen: dict[tuple[int, int], int] = {}
    for row in MotReader(Path(path), counts_from(Path(path))).rows():
        before = seen.setdefault((row.frame, row.identity), row.line)
        if before != row.line:
            hint = "; these are detections, not tracks" if row.identity < 0 else ""
            raise SourceError(
                f"identity {row.identity} occurs twice in frame {row.frame + 1} (line"
                f" {before}){hint}",
                path,
                row.line,
            )
        rows.append((row.frame, row.identity, *row.box, row.score))
        labels.append(row.label)
    table = MotTable.from_rows(rows)
    if not rows or not all(labels):
        return table
    order = np.argsort(np.array([r[0] for r in rows], np.int64), kind="stable")
    return replace(table, classes=np.array(labels, np.int64)[order])


def read_boxes(path: str | Path, size: tuple[int, int] | None = None) -> MotTable:
    """Read any format of boxes with identities (`recorders.formats`), frames from 0.

    Raises:
        SourceError: it cannot be read, or gives no identities.
        UsageError: it may be read in two ways.
    """
    reader = open_rows(Path(path), size)
    bad = LeftOut()

    def note(what: str, where: str) -> None:
        if what != CROWD:  # that is kept, as a region that nobody labelled
            bad.note(what, where)

    found = list(reader.rows(note))
    if not found:
        raise SourceError("; ".join(["no boxes in it", *bad.lines()]), path)
    if any(row.identity == NOBODY for row in found):
        raise SourceError(
            "a box without an identity: these are detections, not tracks", path
        )
    lowest = min(row.frame for row in found)
    stated = 1 if reader.first_frame is None else reader.first_frame
    first = min(lowest, stated)
    rows = [(row.frame - first, row.identity, *row.box, row.score) for row in found]
    table = replace(MotTable.from_rows(rows), left_out=tuple(bad.lines()))
    if not reader.ignored:
        return table
    regions = [(row.frame - first, *row.box) for row in reader.ignored]
    return replace(table, regions=np.array(regions, np.float64))


def read_table(path: str | Path, size: tuple[int, int] | None = None) -> MotTable:
    """Read boxes with identities by what the file is: MOTChallenge text, CAVIAR or CVAT XML, or
    any other format of boxes.

    Raises:
        SourceError: if it cannot be read.
    """
    kind = Path(path).suffix.lower()
    if kind == ".xml":
        with open_to_read(Path(path)) as file:
            is_cvat = b"<annotations" in file.read(4096)
        return read_boxes(path, size) if is_cvat else read_caviar(path)
    if Path(path).is_dir() or kind in (".json", ".jsonl", ".ndjson", ".parquet", ".csv"):
        return read_boxes(path, size)
    return read_boxes(path) if _is_kitti(Path(path)) else read_mot(path)


def _is_kitti(path: Path) -> bool:
    try:
        return open_rows(path).name.startswith("KITTI")
    except AmbiguousError as error:
        raise SourceError(
            f"{error.why}: a truth or result as text is frame,id,x,y,w,h; columns in another order"
            " are read from a .csv whose first line names them (frame,id,x1,y1,x2,y2)",
            path,
        ) from error
    except SceneTraceError:
        return False  # its own reader says what is wrong


def read_caviar(path: str | Path) -> MotTable:
    """Read a CAVIAR XML: boxes by their centre, labelled identities, frames from 0. A DOCTYPE is
    refused.

    Raises:
        SourceError: it is not such a file, lacks a number, or an identity occurs twice in a frame.
        LimitError: nested too deep, or too many objects in a frame.
    """
    rows: list[Row] = []
    for row in CaviarReader(Path(path)).rows():
        if row.identity == NOBODY:
            raise SourceError(f"frame {row.frame}: an object without id", path)
        rows.append((row.frame, row.identity, *row.box, row.score))
    if not rows:
        raise SourceError("not CAVIAR XML: no frame holds an object with a box", path)
    try:
        return MotTable.from_rows(rows)
    except SceneTraceError as error:
        raise SourceError(str(error), path) from error


def read_truth(path: str | Path) -> MotTable:
    """Read a truth of any format of boxes, without the rows of confidence 0.

    Raises:
        SourceError: if it cannot be read or holds nothing.
    """
    table = read_table(path)
    kept = table.select(table.confidences != 0)
    if not len(kept):
        raise SourceError("no truth in it: no row has a confidence other than 0", path)
    return kept


def fit_truth(
    truth: MotTable, size: tuple[int, int], truth_size: tuple[int, int] | None
) -> MotTable:
    """The truth in the recording's pixels.

    Args:
        truth: in the pixels of its own picture.
        size: (width, height) of the recording.
        truth_size: (width, height) of the picture that the truth was labelled in, None: the
            recording's.

    Raises:
        SceneTraceError: boxes of the truth do not lie in its picture, so its size must be another
            one.
    """
    width, height = truth_size or size
    # Labels of whole bodies reach beyond the picture, and are in it with a part.
    outside = (truth.boxes[:, 0] > width) | (truth.boxes[:, 1] > height)
    if np.count_nonzero(outside) > OUTSIDE_SHARE * len(truth):
        right, bottom = np.max(truth.boxes[:, :2] + truth.boxes[:, 2:], axis=0)
        raise SceneTraceError(
            f"the truth reaches to ({right:.0f}, {bottom:.0f}) but the"
            f" {'picture given by --truth-size' if truth_size else 'recording'} is"
            f" {width}x{height}: say the size of the picture that the truth was labelled in"
            " with --truth-size WxH"
        )
    if truth_size is None or truth_size == size:
        return truth
    return truth.scaled(size[0] / width, size[1] / height)
