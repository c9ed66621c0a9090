"""Tables of boxes as text: MOTChallenge of every width and separator, KITTI tracking, columns with
names; and tables with names that are no text (JSON lines, JSON lists, Parquet).
"""

from __future__ import annotations

import codecs
import csv
import io
import re
from collections.abc import Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec

from recorders.errors import SourceError, UsageError
from recorders.files import open_to_read
from recorders.formats.boxes import BoxRow
from recorders.formats.columns import Columns, is_number, number, row_of
from recorders.formats.file_names import FrameNames
from recorders.formats.readers import Bad, checked, read_json
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.loose_json import decode_loose

_LONGEST_LINE = 1 << 16
_MOT = Columns(("frame", "id", "x", "y", "w", "h", "score"))
_KITTI = Columns(
    ("frame", "id", "label", "", "", "", "x1", "y1", "x2", "y2", *[""] * 7, "score")
)
_LEAST_COLUMNS = 6
_SAMPLED = 400
_ASK_FROM = 8
_LISTS = (
    "detections",
    "objects",
    "boxes",
    "predictions",
    "annotations",
    "results",
    "tracks",
)
_BOXES = ("bbox", "box", "bounding_box", "boundingBox")
_DECIMAL_COMMA = re.compile(r"[+-]?\d*,\d+")
_SHARES = "shares of the picture"


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
                self._separator = _separator_of(text)
            first.append(self._cells(text))
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
        elif len(names) > 10 and not is_number(names[2]) and is_number(names[0]):
            self.columns, self.name = _KITTI, "KITTI tracking text"
            self.first_frame, self.is_certain = 0, True
        else:
            self.name, self.is_certain = "MOTChallenge text", True
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
        if not {"x", "y", "w", "h"} <= set(self.columns.roles):
            self.first_frame = 0  # a program's own output counts from 0

    def _learn_names(self, rows: list[list[str]]) -> None:
        """Frames that are named by their pictures count as these do."""
        roles = self.columns.roles
        if "file" not in roles or "frame" in roles:
            return
        place = roles.index("file")
        self._names.learn(cells[place] for cells in rows if len(cells) > place)
        self.first_frame = self._names.first_frame

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

    def _ask(self, why: str, *ways: str) -> UsageError:
        choice = " or ".join(f"--columns {way}" for way in ways)
        return UsageError(f"{self.path}: {why}; say which it is: {choice}")

    def _check_six(self, rows: list[list[float]]) -> None:
        ids = [row[1] for row in rows]
        last = [row[5] for row in rows]
        fractions = any(
            identity != int(identity) for identity in ids if abs(identity) < 2**53
        )
        if rows and (fractions or (all(0 <= value <= 1 for value in last))):
            raise self._ask(
                "six columns, of which the second is no identity or the sixth a score",
                "frame,x1,y1,x2,y2,score",
                "frame,x,y,w,h,score",
                "frame,id,x,y,w,h",
            )

    def _check_corners(self, rows: list[list[float]]) -> None:
        """Whether the fifth and sixth number follow the third and fourth, as a second corner does."""
        if len(rows) < _ASK_FROM or not all(
            row[4] > row[2] and row[5] > row[3] for row in rows
        ):
            return
        across = [(row[2], row[4]) for row in rows]
        spread = _variance([a for a, _ in across])
        if spread > 0 and _variance([b - a for a, b in across]) < spread / 4:
            raise self._ask(
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
            raise self._ask(
                "all boxes lie between 0 and 1, as shares of the picture do",
                "frame,id,xn,yn,wn,hn,score",
                "frame,id,cxn,cyn,wn,hn,score",
                "frame,id,x,y,w,h,score",
            )

    def _cells(self, text: str) -> list[str]:
        if '"' in text and self._separator is not None:
            return [
                cell.strip() for cell in next(csv.reader([text], delimiter=self._separator))
            ]
        if self._separator == ";":
            # Where commas do not separate, they are decimal points.
            return [cell.strip().replace(",", ".") for cell in text.rstrip(";").split(";")]
        if self._separator is None:
            return [_pointed(cell) for cell in text.split()]
        if self._separator == "\t":
            return [_pointed(cell.strip()) for cell in text.split("\t")]
        cells = [cell.strip().strip('"') for cell in text.split(self._separator)]
        return (
            cells[:-1] if cells and not cells[-1] and len(cells) > _LEAST_COLUMNS else cells
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
                    if stripped and not stripped.startswith("#"):
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
            cells = self._cells(text)
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


def _pointed(cell: str) -> str:
    """A number with a decimal point."""
    return cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell


def _separator_of(text: str) -> str | None:
    if ";" in text:
        return ";"
    for separator in ("\t", None):
        cells = [_pointed(cell) for cell in text.split(separator)]
        if "," in text and len(cells) >= _LEAST_COLUMNS and all(map(is_number, cells)):
            return separator  # the commas are decimal points
    if "," in text:
        return ","
    return "\t" if "\t" in text else None


def _numbers(cells: Sequence[str]) -> list[float] | None:
    if len(cells) < _LEAST_COLUMNS or not all(map(is_number, (cells[0], *cells[2:6]))):
        return None
    return [float(cell) if is_number(cell) else 0.0 for cell in cells]


def _variance(values: Sequence[float]) -> float:
    mean = sum(values) / len(values)
    return sum((value - mean) ** 2 for value in values) / len(values)


class Records:
    """Boxes as objects with named values: JSON lines, a JSON list, Parquet.

    Raises:
        SourceError: they name no frames or no boxes.
    """

    first_frame: int | None = 0
    is_certain = False

    def __init__(
        self,
        path: Path,
        kind: str,
        columns: Columns | None = None,
        size: tuple[int, int] | None = None,
        limits: Limits = DEFAULT_LIMITS,
        names: FrameNames | None = None,
    ) -> None:
        self.path = path
        self._pictures = names or FrameNames()
        self.ignored: list[BoxRow] = []
        self.name = {"lines": "JSON lines", "list": "a JSON list"}.get(kind, "Parquet")
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []
        self._kind = kind
        self._picture = size
        self._limits = limits
        first = next(self._objects(), None)
        if first is None:
            raise SourceError("no detections in this file", path)
        self._names = list(first[1])
        self._learn_names()
        if columns is not None and len(columns.roles) == len(self._names):
            self.columns = columns
            return
        try:
            self.columns = Columns.of(self._names)
        except ValueError as error:
            raise SourceError(
                f"{error}; it holds {', '.join(self._names)[:80]}", path
            ) from error

    def _learn_names(self) -> None:
        """Frames that are named by their pictures count as these do."""
        roles = Columns.roles_of(self._names)
        if "file" not in roles or "frame" in roles:
            return
        key = self._names[roles.index("file")]
        self._pictures.learn(str(o.get(key)) for _, o in islice(self._objects(), _SAMPLED))
        self.first_frame = self._pictures.first_frame

    def _objects(self) -> Iterator[tuple[int, dict[str, Any]]]:
        found = {"lines": self._lines, "list": self._list}.get(self._kind, self._parquet)
        for line, one in found():
            if not isinstance(one, dict):
                raise SourceError("a row that is no object", self.path, line)
            for flat in _flattened(one):
                yield line, flat

    def _lines(self) -> Iterator[tuple[int, Any]]:
        with open_to_read(self.path) as file:
            line = 0
            while data := file.readline(_LONGEST_LINE * 16 + 1):
                line += 1
                if data.strip():
                    try:
                        yield line, decode_loose(data)
                    except (
                        msgspec.DecodeError,
                        UnicodeDecodeError,
                        RecursionError,
                    ) as error:
                        raise SourceError(f"not JSON: {error}", self.path, line) from error

    def _list(self) -> Iterator[tuple[int, Any]]:
        found = read_json(self.path, self._limits)
        yield from enumerate(found if isinstance(found, list) else [], 1)

    def _parquet(self) -> Iterator[tuple[int, Any]]:
        import duckdb

        try:
            with duckdb.connect(config={"enable_external_access": True}) as database:
                cursor = database.execute("SELECT * FROM read_parquet(?)", [str(self.path)])
                names = [d[0] for d in cursor.description or []]
                line = 0
                while rows := cursor.fetchmany(10_000):
                    for row in rows:
                        line += 1
                        yield line, dict(zip(names, row, strict=True))
        except duckdb.Error as error:
            raise SourceError(
                f"not Parquet: {str(error).splitlines()[0]}", self.path
            ) from error

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        roles = dict(zip(self._names, self.columns.roles, strict=True))
        for line, one in self._objects():
            held = {roles[k]: value for k, value in one.items() if roles.get(k)}
            where = f"{self.path.name}:{line}"
            try:
                row = row_of(held, self._picture, line, self._pictures)
            except ValueError as error:
                if _SHARES in str(error):
                    raise SourceError(str(error), self.path, line) from error
                bad(f"a row that is none ({error})", where)
                continue
            kept = checked(row, self.path, where, bad)
            if kept is not None:
                yield kept

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return [self.path]


def _flattened(one: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """An object for each box: a frame's list of them with what holds for all, and a box that is an
    object itself, by its values.
    """
    inside = next((one[n] for n in _LISTS if isinstance(one.get(n), list)), None)
    if inside is None or not all(isinstance(entry, dict) for entry in inside):
        box = next((one[n] for n in _BOXES if isinstance(one.get(n), dict)), None)
        yield one if box is None else {**one, **box}
        return
    shared = {n: v for n, v in one.items() if not isinstance(v, list | dict)}
    for entry in inside:
        yield from _flattened({**shared, **entry})


__all__ = ["Records", "TextTable", "number"]
