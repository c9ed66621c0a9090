"""What every row reader gives: one box of one frame, held to the rules that all formats share."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple, Protocol

from recorders.errors import LimitError, SourceError
from recorders.message_checks import LARGEST
from recorders.messages import Box

MAX_FRAMES = 100_000_000
NOBODY = -1
"""The identity of a row that names none."""


class BoxRow(NamedTuple):
    """One box of one frame.

    Attributes:
        frame: from 0.
        identity: whole number as in the file, `NOBODY` where the file gives none.
        box: x, y, w, h in the file's pixels, by the top left corner.
        score: the detector's confidence, 1 where the file gives none.
        label: the class's name, empty where the file gives none.
        line: where the row stands in the file, from 1; 0 where a format has no lines.
    """

    frame: int
    identity: int
    box: Box
    score: float = 1.0
    label: str = ""
    line: int = 0


class BoxReader(Protocol):
    """A file of boxes, readable from the start as often as wanted.

    Attributes:
        path: the file.
    """

    path: Path

    def rows(self) -> Iterator[BoxRow]:
        """The rows in the file's order, each checked.

        Raises:
            SourceError: the file or a row is not as it must be; names file, place and value.
            LimitError: it claims more than the limits allow.
        """
        ...


def check_box(row: BoxRow, path: Path) -> BoxRow:
    """The row, if its frame, box and score are what a recording can hold.

    Raises:
        SourceError: a box without a size or beyond any picture, a number that is not finite.
        LimitError: a frame number beyond all reason.
    """
    x, y, w, h = row.box
    line = row.line or None
    if row.frame >= MAX_FRAMES:
        where = f"{path}:{line}" if line else path
        raise LimitError(f"frame {row.frame}, over the limit of {MAX_FRAMES} frames", where)
    if not math.isfinite(x + y + w + h + row.score):
        raise SourceError(
            f"a box at {x:g}, {y:g} of {w:g} x {h:g}, confidence {row.score:g}: finite"
            " numbers are wanted",
            path,
            line,
        )
    if w <= 0 or h <= 0:
        raise SourceError(
            f"a box of width {w:g} and height {h:g}: both must be over 0", path, line
        )
    if max(abs(x), abs(y), w, h) > LARGEST:
        raise SourceError(
            f"a box at {x:g}, {y:g} of {w:g} x {h:g}: beyond any picture", path, line
        )
    if abs(row.score) > LARGEST:
        raise SourceError(
            f"confidence {row.score:g}: at most {LARGEST:g} is wanted", path, line
        )
    return row
