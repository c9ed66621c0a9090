"""Opening a file or a folder of boxes by what is in it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from recorders.errors import SourceError
from recorders.files import existing_file, open_to_read
from recorders.formats.annotations import Frigate, document_of, is_frigate
from recorders.formats.columns import Columns
from recorders.formats.cvat import Cvat
from recorders.formats.file_names import FrameNames
from recorders.formats.folders import BoxFolder
from recorders.formats.readers import RowReader
from recorders.formats.records import Records, json_lines
from recorders.formats.text import TextTable
from recorders.limits import DEFAULT_LIMITS, Limits

TEXT = frozenset({".txt", ".csv", ".tsv", ".dat", ".det"})
OTHERS = frozenset({".json", ".jsonl", ".ndjson", ".parquet", ".pq", ".xml"})
"""What the names of files of boxes end in."""


@dataclass(frozen=True)
class BoxOptions:
    """What a file of boxes does not say of itself.

    Attributes:
        columns: what a table's columns are; None: as its first line or MOTChallenge says.
        first_frame: what the file calls the first frame, 0 or 1; None: 0 where some frame is 0.
        fps: frames per second, for files that give times.
        pictures: the number of each picture beside the file, from 1, by its name.
    """

    columns: Columns | None = None
    first_frame: int | None = None
    fps: float = 25.0
    pictures: Mapping[str, int] | None = None


def open_rows(
    path: Path,
    size: tuple[int, int] | None = None,
    options: BoxOptions | None = None,
    limits: Limits = DEFAULT_LIMITS,
) -> RowReader:
    """A reader of the boxes in a file or a folder.

    Args:
        path: the file or folder.
        size: the pictures' size, for boxes that are shares of it.
        options: what the file does not say.
        limits: what it may make us allocate.

    Raises:
        SourceError: it is of no known format.
        UsageError: it may be read in two ways.
    """
    options = options or BoxOptions()
    names = FrameNames(options.pictures, options.fps)
    if path.is_dir():
        return BoxFolder(path, size, limits, names)
    existing_file(path)
    kind = path.suffix.lower()
    with open_to_read(path) as file:
        start = file.read(4096).removeprefix(b"\xef\xbb\xbf").lstrip()
    if start.startswith(b"PAR1"):
        return Records(path, "parquet", options.columns, size, limits, names)
    if kind == ".xml" or start.startswith(b"<"):
        if b"<annotations" not in start:
            raise SourceError("XML, but neither CVAT's nor CAVIAR's", path)
        return Cvat(path, names)
    if kind in (".jsonl", ".ndjson") or (start.startswith(b"{") and kind != ".json"):
        return _lines(path, size, options, limits, names)
    if kind == ".json" or start[:1] in (b"[", b"{"):
        found = document_of(path, size, options.fps, limits, names)
        return found or Records(path, "list", options.columns, size, limits, names)
    return TextTable(path, options.columns, size, names)


def _lines(
    path: Path,
    size: tuple[int, int] | None,
    options: BoxOptions,
    limits: Limits,
    names: FrameNames,
) -> RowReader:
    """JSON lines: Frigate's updates, or rows with named values."""
    if is_frigate(next(json_lines(path), (0, None))[1]):
        return Frigate(path, [one for _, one in json_lines(path)], size, options.fps)
    return Records(path, "lines", options.columns, size, limits, names)
