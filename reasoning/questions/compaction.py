"""Small files of a catalogue's tables put together, one for each table, camera and day."""

from __future__ import annotations

import hashlib
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import duckdb
import msgspec

from reasoning.questions.catalogue import (
    SNAPSHOTS_FOLDER,
    WHOLE,
    Piece,
    Snapshot,
    check_schema,
    local_tables,
    piece_of,
    pieces,
    snapshot,
    tables_in_order,
)
from reasoning.questions.duckdb_tables import reason
from reasoning.questions.literals import literal
from reasoning.questions.schema import TABLES
from recorders.errors import SceneTraceError
from recorders.stores import Store


@dataclass(frozen=True)
class CompactSummary:
    """What a compaction did.

    Attributes:
        files: how many recordings' files became how many.
        into: see `files`.
        removed: files removed that the compaction before had replaced.
    """

    files: int
    into: int
    removed: int


def compact(store: Store, least: int = 2) -> CompactSummary:
    """One file per table, camera and day from the small ones, where there are several.

    Whole or not at all: the new files count when the snapshot that names them is there.

    Args:
        store: the case.
        least: from how many files on.

    Raises:
        SceneTraceError: the store cannot be read or written.
    """
    check_schema(store)
    held = snapshot(store)
    now = pieces(store, held=held)
    here = {piece.place for piece in now}
    gone = [key for key in held.replaced if _is_replaced(key, here)]
    groups: dict[tuple[str, str], list[Piece]] = {}
    for piece in now:
        groups.setdefault((piece.camera, piece.date), []).append(piece)
    groups = {place: some for place, some in groups.items() if len(some) >= least}
    whole = dict(held.whole)
    replaced: list[str] = []
    for (camera, date), some in groups.items():
        digests = sorted(
            {d for piece in some for d in held.whole.get(piece.place, [piece.file])}
        )
        name = WHOLE + hashlib.sha256("\n".join(digests).encode()).hexdigest()[:24]
        made = Piece(camera, date, name)
        _merge(store, some, made)
        for piece in some:
            whole.pop(piece.place, None)
            replaced += [piece.key(table) for table in TABLES]
        whole[made.place] = digests
    if groups or gone:
        number = held.number + 1
        done = Snapshot(number, dict(sorted(whole.items())), replaced)
        store.write(f"{SNAPSHOTS_FOLDER}/{number:08d}.json", msgspec.json.encode(done))
        for key in gone:
            store.delete(key)
        for key in store.keys(SNAPSHOTS_FOLDER)[:-2]:
            store.delete(key)
    files = sum(len(some) for some in groups.values())
    return CompactSummary(files, len(groups), len(gone))


def _is_replaced(key: str, here: set[str]) -> bool:
    """Whether nothing of a file belongs to the catalogue any more."""
    piece = piece_of(key)
    return piece is not None and piece.place not in here


def _merge(store: Store, some: Sequence[Piece], made: Piece) -> None:
    with tempfile.TemporaryDirectory(prefix="scenetrace-", dir=store.workplace()) as folder:
        local = local_tables(store, some, Path(folder) / "cache")
        con = duckdb.connect(":memory:", config={"threads": "1"})
        try:
            for table in tables_in_order():
                files = ", ".join(literal(str(local / p.key(table))) for p in some)
                out = Path(folder) / f"{table}.parquet"
                con.execute(
                    f"COPY (SELECT * FROM read_parquet([{files}], hive_partitioning = false))"
                    f" TO {literal(str(out))} (FORMAT parquet, COMPRESSION zstd)"
                )
                store.put(out, made.key(table))
        except duckdb.Error as error:
            raise SceneTraceError(
                f"{store.uri}: {made.place}: cannot be compacted: {reason(error)}"
            ) from error
        finally:
            con.close()
