"""Boxes in one file for each picture: YOLO and KITTI text, LabelMe JSON, Pascal VOC XML.

The last number in a file's name is the frame's.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from recorders.errors import SourceError
from recorders.files import open_to_read
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.columns import is_number, number, number_in
from recorders.formats.readers import Bad, checked, read_json
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.names import by_number

_LARGEST_FILE = 1 << 24
_SUFFIXES = (".txt", ".json", ".xml")
_YOLO = range(5, 8)
_KITTI_LEAST = 8
_NAMES = ("classes.txt", "labels.txt", "obj.names", "predefined_classes.txt", "data.yaml")
Rows = Iterator[tuple[tuple[float, float, float, float], float, str]]


class BoxFolder:
    """A folder with a file for each picture.

    Args:
        path: the folder.
        size: the pictures' size, for boxes that are shares of it (YOLO).
        limits: what a file may take.

    Raises:
        SourceError: no such files in it, or of no known kind.
    """

    is_certain = False

    def __init__(
        self,
        path: Path,
        size: tuple[int, int] | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self.path = path
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []
        self._picture = size
        self._limits = limits
        found = box_files(path)
        if not found:
            raise SourceError("no files of boxes (.txt, .json, .xml) in this folder", path)
        self._files = found
        self.first_frame: int | None = min(1, *(number_in(p.name) for p in found))
        self._read, self.name = self._kind()
        self._classes = _class_names(path) if self.name.startswith("YOLO") else []

    def _kind(self) -> tuple[Callable[[Path], Rows], str]:
        suffix = self._files[0].suffix.lower()
        if suffix == ".json":
            return self._labelme, "LabelMe JSON"
        if suffix == ".xml":
            return self._voc, "Pascal VOC XML"
        for path in self._files:
            cells = next((line.split() for _, line in _lines(path)), None)
            if cells is None:
                continue
            if not is_number(cells[0]) and len(cells) >= _KITTI_LEAST:
                return self._kitti, "KITTI text"
            if len(cells) in _YOLO and all(map(is_number, cells)):
                if self._picture is None:
                    raise SourceError(
                        "YOLO's boxes are shares of a picture whose size is not known: say it"
                        " with --size, or give the pictures beside",
                        self.path,
                    )
                return self._yolo, "YOLO text"
            raise SourceError(
                f"{len(cells)} columns: neither YOLO's (class cx cy w h) nor KITTI's text",
                path,
            )
        return self._kitti, "empty text"

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        for path in self._files:
            frame = number_in(path.name)
            try:
                for box, score, label in self._read(path):
                    row = BoxRow(frame, NOBODY, box, score, label)
                    kept = checked(row, path, f"{path.name}", bad)
                    if kept is not None:
                        yield kept
            except (ValueError, IndexError, KeyError, TypeError) as error:
                raise SourceError(f"not {self.name}: {error}", path) from error

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return list(self._files)

    def _yolo(self, path: Path) -> Rows:
        assert self._picture is not None
        width, height = self._picture
        for _, line in _lines(path):
            name, cx, cy, w, h, *rest = line.split()
            shares = [number(v, "box") for v in (cx, cy, w, h)]
            if max(shares) > 2:
                raise ValueError(f"boxes in pixels ({line[:40]!r}), shares of 1 are wanted")
            x, y, across, down = shares
            box = (
                (x - across / 2) * width,
                (y - down / 2) * height,
                across * width,
                down * height,
            )
            place = int(number(name, "class"))
            label = self._classes[place] if 0 <= place < len(self._classes) else str(place)
            yield box, number(rest[0], "score") if rest else 1.0, label

    @staticmethod
    def _kitti(path: Path) -> Rows:
        for _, line in _lines(path):
            cells = line.split()
            # A tracker's dump has the identity behind the class.
            at = 5 if len(cells) in (17, 18) else 4
            left, top, right, bottom = (number(cell, "box") for cell in cells[at : at + 4])
            score = number(cells[-1], "score") if len(cells) in (16, 18) else 1.0
            if cells[0] != "DontCare":
                yield (left, top, right - left, bottom - top), score, cells[0]

    def _labelme(self, path: Path) -> Rows:
        document = read_json(path, self._limits)
        if isinstance(document.get("imageWidth"), int):
            self.size = document["imageWidth"], document["imageHeight"]
        for shape in document["shapes"]:
            xs = [number(p[0], "point") for p in shape["points"]]
            ys = [number(p[1], "point") for p in shape["points"]]
            if shape.get("shape_type", "rectangle") in ("rectangle", "polygon") and xs:
                box = (min(xs), min(ys), max(xs) - min(xs), max(ys) - min(ys))
                yield box, 1.0, str(shape.get("label", ""))

    @staticmethod
    def _voc(path: Path) -> Rows:
        for one in _parsed(path).iter("object"):
            box: Any = one.find("bndbox")
            left, top, right, bottom = (
                number(box.findtext(n), n) for n in ("xmin", "ymin", "xmax", "ymax")
            )
            yield (left, top, right - left, bottom - top), 1.0, one.findtext("name") or ""


def box_files(folder: Path) -> list[Path]:
    """The files of boxes in a folder, of the kind that most are of, by the numbers in their names."""
    by_kind: dict[str, list[Path]] = {}
    for path in folder.iterdir():
        named = path.name.lower() in _NAMES or path.name.startswith(".")
        if (
            path.suffix.lower() in _SUFFIXES
            and not named
            and any(map(str.isdigit, path.stem))
        ):
            by_kind.setdefault(path.suffix.lower(), []).append(path)
    largest = max(sorted(by_kind.items()), key=lambda kind: len(kind[1]), default=("", []))[
        1
    ]
    return sorted(largest, key=lambda p: by_number(p.name))


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    with open_to_read(path) as file:
        data = file.read(_LARGEST_FILE + 1)
    if len(data) > _LARGEST_FILE:
        raise SourceError(f"over {_LARGEST_FILE} bytes for one picture", path)
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise SourceError("not text", path) from None
    for number_, line in enumerate(text.splitlines(), 1):
        if line.strip():
            yield number_, line.strip()


def _parsed(path: Path) -> Any:
    from xml.etree.ElementTree import ParseError

    from defusedxml import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    with open_to_read(path) as file:
        data = file.read(_LARGEST_FILE)
    try:
        return fromstring(data, forbid_dtd=True)
    except (ParseError, DefusedXmlException, ValueError, LookupError) as error:
        raise SourceError(f"not XML that is read: {error}", path) from error


def _class_names(folder: Path) -> list[str]:
    """The names of YOLO's classes, from a list beside the boxes or one folder above."""
    for place in (folder, folder.parent):
        for name in _NAMES[:4]:
            if (place / name).is_file():
                return [line for _, line in _lines(place / name)]
    return []
