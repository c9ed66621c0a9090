"""Tables of boxes as text: MOTChallenge of every width and separator, KITTI tracking, columns with
names.
"""

from __future__ import annotations

import codecs
import io
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from recorders.errors import AmbiguousError, SourceError, UsageError
from recorders.files import open_to_read
from recorders.formats.boxes import BoxRow
from recorders.formats.cells import COMMENTS, SPREADSHEET, cells_of, is_number, separator_of
from recorders.formats.columns import (
    Columns,
    ask_of_corners,
    ask_of_times,
    box_of,
    grow_as_corners,
)
from recorders.formats.file_names import FrameNames
from recorders.formats.readers import Bad, checked

_LONGEST_LINE = 1 << 16
_MOT = Columns(("frame", "id", "x", "y", "w", "h", "score"))
_KITTI = Columns(
    ("frame", "id", "label", "", "", "", "x1", "y1", "x2", "y2", *[""] * 7, "score")
)
_LEAST_COLUMNS = 6
_SAMPLED = 400
_ASK_FROM = 8
_SHARES = "shares of the picture"
_PICTURE = re.compile(r"\.(jpe?g|png|bmp|webp|tiff?)$", re.IGNORECASE)
_MOST_CLASSES = 100


class TextTable:
    """A text of boxes, one a line.

    Columns that the first line names may come in any order; without names they are MOTChallenge's:
    ``frame,id,x,y,w,h[,score[,class...]]``, or KITTI's where the third is a word. A text whose
    columns may as well mean something else is asked about, not guessed.

    Args:
        path: the file.
        columns: what the columns are, where the caller says it.
        size: the picture's, for boxes that are shares of it.
        names: which picture a name means.

    Raises:
        SourceError: no such text.
        UsageError: it may be read in two ways.
    """

    def __init__(
        self,
        path: Path,
        columns: Columns | None = None,
        size: tuple[int, int] | None = None,
        names: FrameNames | None = None,
    ) -> None:
        self._names = names or FrameNames()
        self.ignored: list[BoxRow] = []
        self.first_frame: int | None = None
        self.is_certain = False
        self.path = path
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []
        self._picture = size
        self._encoding = _encoding_of(path)
        self._separator: str | None = None
        self._given = columns
        self.columns = columns or _MOT
        self._named = False
        self._least = _least(self.columns)
        self._labelled = False
        self.name = "a table of boxes"
        self._look()

    def _look(self) -> None:
        """Learn the separator and the columns from the first lines."""
        first: list[list[str]] = []
        for _, text in self._texts():
            if not first:
                self._separator = separator_of(text)
            first.append(cells_of(text, self._separator))
            if len(first) == _SAMPLED:
                break
        if not first:
            raise SourceError("no detections in this file", self.path)
        names = first[0]
        if self._given is not None:
            self._named = not any(is_number(name) for name in names)
        elif not any(map(is_number, names[:_LEAST_COLUMNS])) and len(names) > 1:
            self._take_names(names)
            self._learn_names(first[1:])
            self._ask(first[1:])
        elif len(names) > 10 and not is_number(names[2]) and is_number(names[0]):
            self.columns, self.name = _KITTI, "KITTI tracking text"
            self.first_frame, self.is_certain = 0, True
        elif _PICTURE.search(names[0]):
            raise UsageError(
                f"{self.path}: the first column names pictures; say what the others are, as"
                " --columns file,x1,y1,x2,y2,label or --columns file,id,x,y,w,h,score"
            )
        else:
            self.name, self.is_certain = "MOTChallenge text", True
            self._check_commas(first)
            self._check_mot(first)

    def _take_names(self, names: list[str]) -> None:
        self._named = True
        try:
            self.columns = Columns.of(names)
        except ValueError as error:
            raise SourceError(
                f"the columns {','.join(names)[:80]!r}: {error}", self.path, 1
            ) from error
        self.name = "a table with named columns"
        self._least = _least(self.columns)
        roles = set(self.columns.roles)
        if not {"x", "y", "w", "h"} <= roles or not {"frame", "file"} & roles:
            self.first_frame = 0  # a program's own output counts from 0

    def _learn_names(self, rows: list[list[str]]) -> None:
        """Frames that are named by their pictures count as these do."""
        roles = self.columns.roles
        if "file" not in roles or "frame" in roles:
            return
        place = roles.index("file")
        self._names.learn(cells[place] for cells in rows if len(cells) > place)
        self.first_frame = self._names.first_frame

    def _ask(self, rows: list[list[str]]) -> None:
        """Ask about boxes and times with names that may be read in two ways."""
        boxes, times = [], []
        for cells in rows:
            held = dict(zip(self.columns.roles, cells, strict=False))
            with suppress(ValueError):
                boxes.append(box_of(held, (1, 1)))
            with suppress(ValueError):
                times.append(float(held.get("time", "")))
        ask_of_corners(self.path, self.columns, boxes)
        ask_of_times(self.path, self.columns, times)

    def _check_commas(self, first: list[list[str]]) -> None:
        """Refuse commas that separate columns and decimals: which is which nobody can tell."""
        cells = [cell for row in first for cell in row[2:]]
        whole = all(cell.lstrip("+-").isdigit() for cell in cells)
        decimals = any(cell.startswith("0") and len(cell) > 1 for cell in cells)
        ragged = len({len(row) for row in first}) > 1
        most = max(map(len, first))
        odd = decimals or (ragged and most > 10)
        if self._separator == "," and whole and most > _LEAST_COLUMNS + 1 and odd:
            raise SourceError(
                "its commas separate columns and are decimal points as well: which is which"
                " cannot be told; write it with semicolons, or with decimal points",
                self.path,
            )

    def _check_mot(self, first: list[list[str]]) -> None:
        """Whether the columns can only be MOTChallenge's, and whether the eighth is a class."""
        widths = {len(cells) for cells in first}
        common = sum(len(cells) == len(first[0]) for cells in first)
        if 10 * common > 9 * len(first) or len(first) == 2:
            self._least = len(first[0])  # a shorter row was cut
        if max(widths) < _LEAST_COLUMNS:
            wanted = "frame,id,x,y,w,h and more"
            raise SourceError(
                f"{max(widths)} columns, wanted {wanted}, separated by commas, semicolons,"
                " blanks or tabs; --columns frame,x,y,w,h says what others are",
                self.path,
                1,
            )
        numbers = [_numbers(cells[:7]) for cells in first]
        whole = [n for n in numbers if n is not None]
        if widths == {_LEAST_COLUMNS}:
            self._check_six(whole)
        self._check_corners(whole)
        self._check_shares(whole)
        eighth = [cells[7].strip() for cells in first if len(cells) > 7]
        self._labelled = bool(eighth) and not all(
            cell in ("-1", "-1.0", "") or "." in cell for cell in eighth
        )
        scores = [n[6] for n in whole if len(n) > 6]
        if scores and all(score == -1 for score in scores):
            self._unsure = True

    _unsure = False

    def _choice(self, why: str, *ways: str) -> AmbiguousError:
        choice = " or ".join(f"--columns {way}" for way in ways)
        return AmbiguousError(self.path, why, f"say which it is: {choice}")

    def _check_six(self, rows: list[list[float]]) -> None:
        ids = [row[1] for row in rows]
        last = [row[5] for row in rows]
        fractions = any(
            identity != int(identity) for identity in ids if abs(identity) < 2**53
        )
        # A class is one of few; an identity comes again, a corner seldom does.
        classes = len(set(last)) <= len(last) / 8 and all(
            value == int(value) and 0 <= value < _MOST_CLASSES for value in last
        )
        corners = len(set(ids)) > len(ids) / 4
        if rows and (
            fractions or all(0 <= value <= 1 for value in last) or (classes and corners)
        ):
            raise self._choice(
                "six columns, of which the second is no identity, or the sixth a score or a"
                " class",
                "frame,x1,y1,x2,y2,score",
                "frame,x,y,w,h,score",
                "frame,id,x,y,w,h",
            )

    def _check_corners(self, rows: list[list[float]]) -> None:
        """Whether the fifth and sixth number follow the third and fourth, as a second corner does."""
        if grow_as_corners([row[2:6] for row in rows]):
            raise self._choice(
                "the fifth column grows with the third, as x2 does with x1",
                "frame,id,x1,y1,x2,y2,score",
                "frame,id,x,y,w,h,score",
            )

    def _check_shares(self, rows: list[list[float]]) -> None:
        if len(rows) >= _ASK_FROM and all(
            abs(row[2]) <= 1.5
            and abs(row[3]) <= 1.5
            and 0 < row[4] <= 1
            and 0 < row[5] <= 1
            for row in rows
        ):
            raise self._choice(
                "all boxes lie between 0 and 1, as shares of the picture do",
                "frame,id,xn,yn,wn,hn,score",
                "frame,id,cxn,cyn,wn,hn,score",
                "frame,id,x,y,w,h,score",
            )

    def _texts(self) -> Iterator[tuple[int, str]]:
        """Number and text of every line that is neither blank nor a comment."""
        with open_to_read(self.path) as data:
            file = io.TextIOWrapper(data, self._encoding, newline=None)
            line = 0
            try:
                while text := file.readline(_LONGEST_LINE + 1):
                    line += 1
                    if len(text) > _LONGEST_LINE:
                        raise SourceError(
                            f"a line of over {_LONGEST_LINE} characters: no table of boxes",
                            self.path,
                            line,
                        )
                    stripped = text.strip().lstrip("\ufeff")
                    if "\0" in stripped:
                        raise SourceError("not text: no table of boxes", self.path, line)
                    if line == 1 and SPREADSHEET.fullmatch(stripped):
                        continue  # what a spreadsheet is told of the separator
                    if stripped and not stripped.startswith(COMMENTS):
                        yield line, stripped
            except UnicodeDecodeError:
                raise SourceError(
                    "not text: no table of boxes", self.path, line + 1
                ) from None

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        texts = self._texts()
        self.ignored.clear()
        if self._named:
            next(texts, None)
        for line, text in texts:
            cells = cells_of(text, self._separator)
            where = f"{self.path.name}:{line}"
            if len(cells) < self._least:
                bad("a row that is cut short", where)
                continue
            try:
                row = self.columns.row(cells, self._picture, line, self._names)
            except ValueError as error:
                if _SHARES in str(error):
                    raise SourceError(f"{error}: {text[:60]!r}", self.path, line) from error
                bad(f"a row that is none ({error})", where)
                continue
            if self.columns is _KITTI and row.label == "DontCare":
                self.ignored.append(row)  # a region that nobody labelled, no object
                continue
            if self._labelled and len(cells) > 7 and cells[7] not in ("", "-1"):
                row = row._replace(label=cells[7])
            if self._unsure:
                row = row._replace(score=1.0)
            kept = checked(row, self.path, where, bad)
            if kept is not None:
                yield kept

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return [self.path]


def _least(columns: Columns) -> int:
    """How many cells a row has at least: up to the last that a box and its frame need."""
    needed = [
        place
        for place, role in enumerate(columns.roles)
        if role and role not in ("score", "label", "id")
    ]
    return max(needed) + 1


def _encoding_of(path: Path) -> str:
    with open_to_read(path) as file:
        start = file.read(4)
    if start.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    return "utf-8-sig"


def _numbers(cells: Sequence[str]) -> list[float] | None:
    if len(cells) < _LEAST_COLUMNS or not all(map(is_number, (cells[0], *cells[2:6]))):
        return None
    return [float(cell) if is_number(cell) else 0.0 for cell in cells]
