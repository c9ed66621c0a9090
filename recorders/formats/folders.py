"""Boxes in one file for each picture: YOLO and KITTI text, LabelMe JSON, Pascal VOC XML.

The last number in a file's name is the frame's.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from recorders.errors import SourceError, UsageError
from recorders.files import open_to_read
from recorders.formats.boxes import NOBODY, BoxRow
from recorders.formats.cells import is_number, pointed
from recorders.formats.columns import number
from recorders.formats.file_names import FrameNames
from recorders.formats.readers import Bad, checked, read_json
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.names import by_number, whole
from recorders.upright import box_around

_LARGEST_FILE = 1 << 24
_NOT_SUCH = (ValueError, IndexError, KeyError, TypeError, AttributeError, OverflowError)
_SUFFIXES = (".txt", ".json", ".xml")
_YOLO = range(5, 8)
_TRACKED = 7
_LISTED = re.compile(
    r"^names:[ ]*(?:(\[[^\]]*\])|\n((?:(?:-|\d+:)[^\n]*(?:\n|$))+))", re.MULTILINE
)
_ITEM = re.compile(r"^(-|\d+:)")
_KITTI_LEAST = 8
_NAMES = (
    "classes.txt",
    "labels.txt",
    "obj.names",
    "predefined_classes.txt",
    "data.yaml",
    "dataset.yaml",
)
_FOLDERS = frozenset(
    {"labels", "label", "label_2", "label_02", "annotations", "obj_train_data", "data"}
)
"""What tools call the folder in which the files of boxes lie."""
_BELOW = ("*", "*/*")
Rows = Iterator[tuple[tuple[float, float, float, float], float, str]]


class BoxFolder:
    """A folder with a file for each picture.

    Args:
        path: the folder.
        size: the pictures' size, for boxes that are shares of it (YOLO).
        limits: what a file may take.
        names: which picture a file belongs to.

    Raises:
        SourceError: no such files in it, or of no known kind.
    """

    is_certain = False

    def __init__(
        self,
        path: Path,
        size: tuple[int, int] | None = None,
        limits: Limits = DEFAULT_LIMITS,
        names: FrameNames | None = None,
    ) -> None:
        path = boxes_below(path, (names or FrameNames()).are_known) or path
        self.path = path
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []
        self.ignored: list[BoxRow] = []
        self._names = names or FrameNames()
        self._picture = size
        self._limits = limits
        found = box_files(path, self._names.are_known)
        if not found:
            raise SourceError("no files of boxes (.txt, .json, .xml) in this folder", path)
        self._files = found
        self._names.learn(p.name for p in found)
        self.first_frame = self._names.first_frame
        self._read, self.name = self._kind()
        self._classes = _class_names(path) if self.name.startswith("YOLO") else []

    def _kind(self) -> tuple[Callable[[Path, Bad], Rows], str]:
        suffix = self._files[0].suffix.lower()
        if suffix == ".json":
            return self._labelme, "LabelMe JSON"
        if suffix == ".xml":
            return self._voc, "Pascal VOC XML"
        for path in self._files:
            cells = next((line.split() for _, line in _lines(path)), None)
            if cells is None:
                continue
            numbers = sum(is_number(pointed(cell)) for cell in cells)
            if not is_number(cells[0]) and numbers >= _KITTI_LEAST - 1:
                return self._kitti, "KITTI text"
            if len(cells) >= _YOLO[0] and all(map(is_number, cells[1:])):
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
            try:
                frame = self._names.frame(path.name)
            except ValueError as error:
                bad(f"a file of no picture ({error})", path.name)
                continue
            try:
                for box, score, label in self._read(path, bad):
                    row = BoxRow(frame, NOBODY, box, score, label)
                    kept = checked(row, path, f"{path.name}", bad)
                    if kept is not None:
                        yield kept
            except SourceError as error:
                bad(f"a file that cannot be read ({error.reason})", path.name)
            except _NOT_SUCH as error:
                bad(f"a file that is no {self.name} ({error})", path.name)

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return list(self._files)

    def _yolo(self, path: Path, bad: Bad) -> Rows:
        assert self._picture is not None
        width, height = self._picture
        for line_number, line in _lines(path):
            name, *cells = line.split()
            try:
                place = int(number(name, "class")) if is_number(name) else -1
                values = [number(cell, "box") for cell in cells]
                (x, y, across, down), score = _yolo_box(values)
            except (ValueError, OverflowError) as error:
                bad(f"a row that is none ({error})", f"{path.name}:{line_number}")
                continue
            if max(x, y, across, down) > 2:
                raise ValueError(f"boxes in pixels ({line[:40]!r}), shares of 1 are wanted")
            box = (
                (x - across / 2) * width,
                (y - down / 2) * height,
                across * width,
                down * height,
            )
            known = 0 <= place < len(self._classes)
            word = name if place < 0 else str(place)
            yield box, score, self._classes[place] if known else word

    @staticmethod
    def _kitti(path: Path, bad: Bad) -> Rows:
        for line_number, line in _lines(path):
            cells = line.split()
            # A class may be several words; some write numbers with a comma.
            words = next(
                (k for k, cell in enumerate(cells) if is_number(pointed(cell))), len(cells)
            )
            label, cells = " ".join(cells[:words]), [pointed(c) for c in cells[words:]]
            # A tracker's dump has the identity behind the class.
            at = 4 if len(cells) in (16, 17) else 3
            try:
                left, top, right, bottom = (
                    number(cell, "box") for cell in cells[at : at + 4]
                )
                score = number(cells[-1], "score") if len(cells) in (15, 16, 17) else 1.0
            except ValueError as error:
                bad(f"a row that is none ({error})", f"{path.name}:{line_number}")
                continue
            if label != "DontCare":
                yield (left, top, right - left, bottom - top), score, label

    def _labelme(self, path: Path, bad: Bad) -> Rows:
        document = read_json(path, self._limits)
        if not isinstance(document, dict):
            raise SourceError("its JSON is no object", path)
        size = document.get("imageWidth"), document.get("imageHeight")
        if isinstance(size[0], int) and isinstance(size[1], int):
            self.size = size[0], size[1]
        for shape in document["shapes"]:
            xs = [number(p[0], "point") for p in shape["points"]]
            ys = [number(p[1], "point") for p in shape["points"]]
            if shape.get("shape_type", "rectangle") in ("rectangle", "polygon") and xs:
                box = box_around(xs, ys)
                yield box, 1.0, str(shape.get("label", ""))
            else:
                bad(f"a shape without a box ({shape['shape_type']})", path.name)

    def _voc(self, path: Path, bad: Bad) -> Rows:  # noqa: ARG002 (all kinds are called alike)
        document = _parsed(path)
        size = [whole(document.findtext(f"size/{n}") or "") for n in ("width", "height")]
        if size[0] and size[1]:
            self.size = size[0], size[1]
        for one in document.iter("object"):
            box: Any = one.find("bndbox")
            left, top, right, bottom = (
                number(box.findtext(n), n) for n in ("xmin", "ymin", "xmax", "ymax")
            )
            yield (left, top, right - left, bottom - top), 1.0, one.findtext("name") or ""


def _yolo_box(values: list[float]) -> tuple[tuple[float, float, float, float], float]:
    """Centre and size of a box, and its score, of what stands behind the class: a box, with a score,
    an identity, or points of a body behind it; or the corners of a polygon or a turned box.

    Raises:
        ValueError: fewer than four numbers.
    """
    if len(values) < 4:
        raise ValueError(f"{len(values)} numbers behind the class, 4 are wanted")
    box = values[0], values[1], values[2], values[3]
    rest = values[4:]
    if len(values) < _TRACKED:
        # A tracker writes the identity before the score, or alone.
        scores = [value for value in rest if 0 <= value <= 1 and value != 0]
        return box, scores[-1] if scores else 1.0
    seen = rest[2::3]
    body = len(rest) % 3 == 0 and all(value in (0, 1, 2) for value in seen)
    if len(values) % 2 or body:
        return box, 1.0
    left, top, across, down = box_around(values[::2], values[1::2])
    return (left + across / 2, top + down / 2, across, down), 1.0


def box_files(folder: Path, any_name: bool = False) -> list[Path]:
    """The files of boxes in a folder, of the kind that most are of, by the numbers in their names;
    those without one as well where pictures tell which they are.
    """
    by_kind: dict[str, list[Path]] = {}
    for path in folder.iterdir():
        named = path.name.lower() in _NAMES or path.name.startswith(".")
        numbered = any_name or any(map(str.isdigit, path.stem))
        if path.suffix.lower() in _SUFFIXES and not named and numbered:
            by_kind.setdefault(path.suffix.lower(), []).append(path)
    largest = max(sorted(by_kind.items()), key=lambda kind: len(kind[1]), default=("", []))[
        1
    ]
    return sorted(largest, key=lambda p: by_number(p.name))


def boxes_below(folder: Path, any_name: bool = False) -> Path | None:
    """The folder itself where it holds files of boxes, else the one folder in it that does, as
    tools lay them out (``labels``, ``labels/train``, ``Annotations`` ...); None where there is none.

    Raises:
        UsageError: there are several.
    """
    if box_files(folder, any_name):
        return folder
    found = [
        inner
        for depth in _BELOW
        for inner in sorted(folder.glob(depth))
        if inner.is_dir()
        and inner.relative_to(folder).parts[0].lower() in _FOLDERS
        and box_files(inner, any_name)
    ]
    if len(found) > 1:
        names = ", ".join(str(inner.relative_to(folder)) for inner in found[:6])
        raise UsageError(f"{folder}: files of boxes in several folders ({names}): name one")
    return found[0] if found else None


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
    for place in (folder, *list(folder.parents)[:3]):
        for name in _NAMES[:4]:
            if (place / name).is_file():
                return [line for _, line in _lines(place / name)]
        for name in _NAMES[4:]:
            if (place / name).is_file():
                return _names_in("\n".join(text for _, text in _lines(place / name)))
    return []


def _names_in(text: str) -> list[str]:
    """The classes that a YOLO data set's description lists."""
    found = _LISTED.search(text)
    if found is None:
        return []
    names = found[1].strip("[]").split(",") if found[1] else found[2].splitlines()
    plain = (_ITEM.sub("", name.strip()).strip(" \"'") for name in names)
    return [name for name in plain if name]
