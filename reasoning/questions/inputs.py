"""What can be asked, by its content: a log, an index, a folder of Parquet, a catalogue."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from reasoning.questions import catalogue
from recorders.errors import RecordingError

MCAP_MAGIC = b"\x89MCAP0\r\n"
DUCKDB_MAGIC = b"DUCK"
PART_PREFIX = "part-"


def kind_of(path: Path) -> str:
    """``log``, ``index``, ``parquet`` or ``catalogue``, by content.

    Raises:
        RecordingError: none of them.
    """
    if path.is_dir():
        if catalogue.is_catalogue(path):
            return "catalogue"
        if not parquet_parts(path):
            raise RecordingError(
                f"a folder without parts ({PART_PREFIX}*/) of an index in Parquet", path
            )
        return "parquet"
    try:
        with path.open("rb") as file:
            head = file.read(16)
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", path) from error
    if head.startswith(MCAP_MAGIC):
        return "log"
    if head[8:12] == DUCKDB_MAGIC:
        return "index"
    what = "an empty file" if not head else "neither an MCAP log nor an index"
    raise RecordingError(
        f"{what}; give annotated logs, an index of `scenetrace index`, or a folder of"
        " Parquet",
        path,
    )


def parquet_parts(folder: Path) -> list[Path]:
    """The whole parts of a Parquet index, in order."""
    return sorted(
        p for p in folder.glob(f"{PART_PREFIX}*") if (p / "recordings.parquet").is_file()
    )


def free_name(stem: str, taken: Iterable[str]) -> str:
    """The stem, or the stem with the lowest free number behind it."""
    used = set(taken)
    name, k = stem, 2
    while name in used or any(u.startswith(f"{name}/") for u in used):
        name, k = f"{stem}~{k}", k + 1
    return name
