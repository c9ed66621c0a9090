"""What a case holds, and whether its files are those that its statuses tell of."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from pathlib import Path

from msgspec import Struct

from reasoning.questions import catalogue
from reasoning.questions.schema import TABLES
from recorders.errors import RecordingError
from recorders.files import sha256
from recorders.stores import FolderStore, NoSuchKeyError, Store
from replay.batch.driver import status_summary, statuses


class CaseFacts(Struct, frozen=True):
    """What a case holds.

    Attributes:
        case: its folder or URI.
        recordings: in its catalogue.
        frames: recorded, of all.
        cameras: their names.
        days: first and last day (UTC), empty where no recording tells its day.
        set_aside: sources that failed.
        left_out: recordings with something left out.
        compactions: how often its tables were put together.
    """

    case: str
    recordings: int
    frames: int
    cameras: list[str]
    days: list[str]
    set_aside: int
    left_out: int
    compactions: int


def case_facts(store: Store) -> CaseFacts:
    """Count.

    Raises:
        RecordingError: no case, its tables are of another version, or a snapshot is damaged.
    """
    catalogue.check_schema(store)
    _check_begun(store)
    held = catalogue.snapshot(store)
    pieces = catalogue.pieces(store, held=held)
    days = sorted({piece.date for piece in pieces} - {catalogue.NO_DATE})
    summary = status_summary(store)
    return CaseFacts(
        case=store.uri,
        recordings=sum(len(held.whole.get(piece.place, [piece.file])) for piece in pieces),
        frames=summary["frames"],
        cameras=sorted({piece.camera for piece in pieces}),
        days=[days[0], days[-1]] if days else [],
        set_aside=summary["failed"],
        left_out=summary["left_out"],
        compactions=held.number,
    )


class Fault(Struct, frozen=True):
    """A file of a case that is not as it was made.

    Attributes:
        key: the file.
        reason: ``missing``, or what is wrong.
    """

    key: str
    reason: str


def faults(store: Store) -> Iterator[Fault]:
    """Hold the files of a case against the SHA-256 that its statuses have of them.

    A table's file that a compaction replaced may be gone; then the compacted one must be there.

    Raises:
        RecordingError: no case, or a snapshot is damaged.
    """
    _check_begun(store)
    held = catalogue.snapshot(store)
    replaced = held.inside()
    for status in statuses(store):
        if status.state != "done":
            continue
        for key, digest in status.outputs.items():
            found = _digest(store, key)
            piece = catalogue.piece_of(key)
            if found is None and piece is not None and piece.place in replaced:
                continue
            if found != digest:
                yield Fault(key, "missing" if found is None else "changed: another SHA-256")
    for place in held.whole:
        for table in TABLES:
            key = f"{catalogue.TABLES_FOLDER}/{table}/{place}.parquet"
            if not store.exists(key):
                yield Fault(key, "missing")


def _check_begun(store: Store) -> None:
    if not store.exists(catalogue.SCHEMA_FILE):
        raise RecordingError("no case of `scenetrace batch`", store.uri)


def _digest(store: Store, key: str) -> str | None:
    if isinstance(store, FolderStore):
        path = store.folder / key
        return sha256(path) if path.is_file() else None
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "file"
        try:
            store.fetch(key, copy)
        except NoSuchKeyError:
            return None
        return sha256(copy)
