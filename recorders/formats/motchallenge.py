"""MOTChallenge text: ``frame,id,x,y,w,h[,confidence[,...]]``, frames from 1, boxes by their top
left corner.

Rules, for detections, truths and results alike:

- cells are parted by commas; in a row without a comma by blanks or tabs; by ``;``, ``|``, or a comma
  and a blank where the first row is (`recorders.formats.cells`), then with decimal commas as well;
- lines that begin with ``#``, ``%`` or ``//`` are no rows;
- a row has 6 to 10 columns, as many as the first row: a row that was cut short is no row;
- the first line may name the columns; names in another order are refused;
- blank lines, Windows line ends and a byte order mark do not matter;
- frame and identity are whole numbers; every value is finite; width and height are over 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

from recorders.errors import LimitError, SourceError
from recorders.files import open_to_read
from recorders.formats.boxes import MAX_FRAMES, BoxRow, check_box
from recorders.formats.cells import COMMENTS, SPREADSHEET, cells_of, is_number, separator_of
from recorders.names import whole

_COLUMNS = range(6, 11)
_WITH_CLASS = 9
_LONGEST_LINE = 4096
_LARGEST_IDENTITY = 2**53
_FIELDS = ("frame", "id", "x", "y", "width", "height", "confidence")
_HEADER = (
    frozenset({"frame", "frame_id", "frame_number"}),
    frozenset({"id", "identity", "track", "track_id", "target", "target_id"}),
    frozenset({"x", "left", "bb_left", "bbox_left"}),
    frozenset({"y", "top", "bb_top", "bbox_top"}),
    frozenset({"w", "width", "bb_width", "bbox_width"}),
    frozenset({"h", "height", "bb_height", "bbox_height"}),
)
_BLANKS = bytes.maketrans(b",;|", b"   ")
_WORDS = "not MOTChallenge text (frame,id,x,y,w,h,confidence,...)"


class MotReader:
    """A MOTChallenge file; every reading goes through it anew. One without rows is none of its
    affair.
    """

    def __init__(self, path: Path, first_frame: int = 1) -> None:
        self.path = path
        self._first = first_frame

    def rows(self) -> Iterator[BoxRow]:
        """The rows in the file's order, frames from 0.

        Raises:
            SourceError: the file cannot be read, or a row is not as it must be; names the line.
            LimitError: a frame number beyond all reason.
        """
        columns = 0
        separator: str | None = ""
        for line, text in self._lines():
            separator = separator_of(text) if separator == "" else separator
            if separator == "," or (separator in (None, "\t") and "," not in text):
                cells = text.split(",") if "," in text else text.split()
            else:
                cells = cells_of(text, separator)
            if not columns and self._is_header(cells, line):
                continue
            columns = columns or len(cells)
            if len(cells) != columns or columns not in _COLUMNS:
                wanted = (
                    f"{columns} as in the first row"
                    if columns in _COLUMNS
                    else "6 to 10, separated by commas, blanks or tabs"
                )
                raise SourceError(
                    f"{len(cells)} columns, wanted {wanted}: {text[:60]!r}", self.path, line
                )
            yield self._row(cells, line)

    def _lines(self) -> Iterator[tuple[int, str]]:
        """Number and text of every line that is not blank."""
        with open_to_read(self.path) as file:
            number = 0
            while data := file.readline(_LONGEST_LINE + 1):
                number += 1
                if len(data) > _LONGEST_LINE:
                    raise SourceError(
                        f"a line of over {_LONGEST_LINE} bytes: {_WORDS}", self.path, number
                    )
                try:
                    text = data.decode("utf-8-sig" if number == 1 else "utf-8").strip()
                except UnicodeDecodeError:
                    raise SourceError(f"not text: {_WORDS}", self.path, number) from None
                told = number == 1 and SPREADSHEET.fullmatch(text)
                if text and not told and not text.startswith(COMMENTS):
                    yield number, text

    def _is_header(self, cells: list[str], line: int) -> bool:
        """Whether the cells name the columns.

        Raises:
            SourceError: they name other columns, or the same ones in another order.
        """
        names = [cell.strip().strip('"').lower() for cell in cells]
        if len(names) < len(_HEADER) or any(map(is_number, names[: len(_HEADER)])):
            return False
        if not all(name in known for name, known in zip(names, _HEADER, strict=False)):
            raise SourceError(
                f"the columns {','.join(names)[:60]!r}: wanted frame,id,x,y,w,h, the corner"
                " at the top left",
                self.path,
                line,
            )
        return True

    def _row(self, cells: list[str], line: int) -> BoxRow:
        values = [
            self._number(name, cell.strip(), line)
            for name, cell in zip(_FIELDS, cells, strict=False)
        ]
        frame, identity, x, y, w, h = values[:6]
        if frame != int(frame) or frame < self._first:
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
        if identity != int(identity) or abs(identity) >= _LARGEST_IDENTITY:
            raise SourceError(
                f"identity {cells[1].strip()[:40]}: must be a whole number", self.path, line
            )
        score = values[6] if len(values) > 6 else 1.0
        box = (x, y, w, h)
        label = _class_of(cells)
        row = BoxRow(int(frame) - self._first, int(identity), box, score, label, line)
        return check_box(row, self.path)

    def _number(self, name: str, cell: str, line: int) -> float:
        try:
            value = float(cell) if "_" not in cell else math.nan
        except ValueError:
            raise SourceError(
                f"{name} {cell[:40]!r} is not a number: {_WORDS}", self.path, line
            ) from None
        if not math.isfinite(value):
            raise SourceError(
                f"{name} is {cell[:40]}, a finite number is wanted", self.path, line
            )
        return value


def _class_of(cells: list[str]) -> str:
    """The class of a row of nine columns, as MOT16 and later have them; empty where there is none."""
    cell = cells[7].strip() if len(cells) == _WITH_CLASS else ""
    return cell if whole(cell) else ""


def counts_from(path: Path) -> int:
    """What a file calls its first frame: 0 where some row is of frame 0, else 1.

    Raises:
        SourceError: it cannot be read.
    """
    with open_to_read(path) as file:
        while line := file.readline(_LONGEST_LINE):
            cell = line.translate(_BLANKS).split()[:1]
            if cell and cell[0].strip(b"0.") == b"" and cell[0][:1] == b"0":
                return 0
    return 1
