"""Tables of boxes with names that are no text: JSON lines, a JSON list or document, Parquet."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from pathlib import Path
from typing import Any

import msgspec

from recorders.errors import SourceError, UsageError
from recorders.files import open_to_read
from recorders.formats.boxes import BoxRow
from recorders.formats.columns import Columns, ask_of_corners, ask_of_times, box_of, row_of
from recorders.formats.file_names import FrameNames
from recorders.formats.readers import Bad, checked, read_json
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.loose_json import decode_loose

_LONGEST_LINE = 1 << 20
_LEAST_COLUMNS = 2
_SAMPLED = 400
_LISTS = (
    "detections",
    "objects",
    "boxes",
    "predictions",
    "annotations",
    "results",
    "tracks",
    "labels",
    "instances",
)
_BOXES = ("bbox", "box", "bounding_box", "boundingBox", "box2d", "rect")
_RELATIVE = "relative_coordinates"
_CENTRED = ("cx", "cy", "w", "h")
_DARKNET = ("center_x", "center_y", "width", "height")
_DOCUMENTS = ("frames", *_LISTS, "data", "images")
_SHARES = "shares of the picture"


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
        # A row without a class or a score does not name that column: others do.
        sampled = (name for _, one in islice(self._objects(), _SAMPLED) for name in one)
        self._names = list(dict.fromkeys(sampled))
        if not self._names:
            raise SourceError("no detections in this file", path)
        self._learn_names()
        if columns is not None:
            if len(columns.roles) != len(self._names):
                raise UsageError(
                    f"{path}: --columns says {len(columns.roles)} columns; it holds"
                    f" {len(self._names)}: {', '.join(self._names)[:200]}"
                )
            self.columns = columns
            return
        try:
            self.columns = Columns.of(self._names)
        except ValueError as error:
            raise SourceError(
                f"{error}; it holds {', '.join(self._names)[:80]}", path
            ) from error
        self._ask()

    def _ask(self) -> None:
        """Ask about boxes and times that may be read in two ways."""
        boxes, times = [], []
        for _, one in islice(self._objects(), _SAMPLED):
            held = dict(zip(self.columns.roles, map(one.get, self._names), strict=True))
            with suppress(ValueError):
                boxes.append(box_of(held, (1, 1)))
            if isinstance(moment := held.get("time"), int | float):
                times.append(float(moment))
        ask_of_corners(self.path, self.columns, boxes)
        ask_of_times(self.path, self.columns, times)

    def _learn_names(self) -> None:
        """Frames that are named by their pictures count as these do."""
        roles = Columns.roles_of(self._names)
        if "file" not in roles or "frame" in roles:
            return
        key = self._names[roles.index("file")]
        self._pictures.learn(str(o.get(key)) for _, o in islice(self._objects(), _SAMPLED))
        self.first_frame = self._pictures.first_frame

    def _objects(self) -> Iterator[tuple[int, dict[str, Any]]]:
        found = {"lines": lambda: json_lines(self.path), "list": self._list}.get(
            self._kind, self._parquet
        )
        for line, one in found():
            if not isinstance(one, dict):
                raise SourceError("a row that is no object", self.path, line)
            for flat in _flattened(one):
                yield line, flat

    def _list(self) -> Iterator[tuple[int, Any]]:
        yield from enumerate(rows_in(read_json(self.path, self._limits)) or [], 1)

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


def json_lines(path: Path) -> Iterator[tuple[int, Any]]:
    """Number and value of each line.

    Raises:
        SourceError: a line is no JSON.
    """
    with open_to_read(path) as file:
        line = 0
        while data := file.readline(_LONGEST_LINE + 1):
            line += 1
            if data.strip():
                try:
                    yield line, decode_loose(data)
                except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
                    raise SourceError(f"not JSON: {error}", path, line) from error


def rows_in(document: Any) -> list[Any] | None:
    """The rows of a JSON document: itself, a list in it (``frames``, ``detections`` ...), lists by
    the frame's number or the picture's name, or a list for each column; None of none of these.
    """
    if isinstance(document, list):
        return document
    if not isinstance(document, dict):
        return None
    for name in _DOCUMENTS:
        inside = document.get(name)
        if isinstance(inside, dict):
            inside = rows_in(inside)
        if isinstance(inside, list) and inside and isinstance(inside[0], dict):
            return inside
    return _by_key(document)


def _by_key(document: dict[str, Any]) -> list[Any] | None:
    values = list(document.values())
    if not values or not all(isinstance(v, list | dict) for v in values):
        return None
    for role, told in (("frame", str.isdigit), ("file", _holds_digit)):
        if all(map(told, document)):
            return [_framed({role: key}, held) for key, held in document.items()]
    columns = [list(v.values()) if isinstance(v, dict) else v for v in values]
    if len(columns) < _LEAST_COLUMNS or len({len(column) for column in columns}) != 1:
        return None
    return [dict(zip(document, row, strict=True)) for row in zip(*columns, strict=True)]


def _holds_digit(name: str) -> bool:
    return any(map(str.isdigit, name))


def _framed(frame: dict[str, Any], held: Any) -> dict[str, Any]:
    return {**frame, **(held if isinstance(held, dict) else {"detections": held})}


def _flattened(one: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """An object for each box: a frame's list of them with what holds for all, and a box that is an
    object itself, by its values.
    """
    inside = next((one[n] for n in _LISTS if isinstance(one.get(n), list)), None)
    if inside is None or not all(isinstance(entry, dict) for entry in inside):
        box = next((one[n] for n in _BOXES if isinstance(one.get(n), dict)), None)
        shares = one.get(_RELATIVE)
        if isinstance(shares, dict):
            box = {
                f"{role}n": shares.get(name)
                for role, name in zip(_CENTRED, _DARKNET, strict=True)
            }
        yield one if box is None else {**one, **box}
        return
    shared = {n: v for n, v in one.items() if not isinstance(v, list | dict)}
    for entry in inside:
        yield from _flattened({**shared, **entry})
