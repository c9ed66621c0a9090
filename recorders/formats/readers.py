"""What every reader of detections gives, and what all share: rows as the file counts its frames."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import msgspec

from recorders.errors import LimitError, SourceError
from recorders.files import open_to_read
from recorders.formats.boxes import BoxRow, check_box
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.loose_json import decode_loose

Bad = Callable[[str, str], None]
"""Called with what is wrong and where, for each row that is left out."""


class RowReader(Protocol):
    """A file or a folder of boxes, readable from the start as often as wanted.

    Attributes:
        path: what was opened.
        name: its format in words.
        size: width and height of the pictures, where the file says it.
        notes: what had to be assumed.
        first_frame: what the file calls the first frame: 0 or 1; None: 1, and 0 where a frame is
            0, as MOTChallenge's readers have it.
        is_certain: nobody needs to be told of that.
        ignored: where nobody was labelled, as the last whole reading found it.
    """

    path: Path
    name: str
    size: tuple[int, int] | None
    notes: list[str]
    first_frame: int | None
    is_certain: bool
    ignored: list[BoxRow]

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """The rows in the file's order, each with the frame's number as the file has it."""
        ...

    def files(self) -> list[Path]:
        """The files that are read."""
        ...


def checked(row: BoxRow, path: Path, where: str, bad: Bad) -> BoxRow | None:
    """The row, if it is what a recording can hold; else it is told and left out.

    Raises:
        LimitError: a frame number beyond all reason.
    """
    try:
        return check_box(row, path)
    except LimitError:
        raise
    except SourceError:
        bad(_kind_of(row), where)
        return None


def _kind_of(row: BoxRow) -> str:
    x, y, w, h = row.box
    if not math.isfinite(x + y + w + h + row.score):
        return "a row with a number that is not finite"
    if w <= 0 or h <= 0:
        return "a box without width or height"
    return "a box or a score beyond all reason"


def read_json(path: Path, limits: Limits = DEFAULT_LIMITS) -> Any:
    """A JSON document, whole.

    Raises:
        LimitError: larger than a record may be.
        SourceError: it is no JSON.
    """
    with open_to_read(path) as file:
        data = file.read(limits.max_record_bytes + 1)
    if len(data) > limits.max_record_bytes:
        raise LimitError(
            f"over {limits.max_record_bytes} bytes of JSON; --limit"
            f" max_record_bytes={4 * limits.max_record_bytes} allows more",
            path,
        )
    try:
        return decode_loose(data.removeprefix(b"\xef\xbb\xbf"))
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise SourceError(f"not JSON: {error}", path) from error
