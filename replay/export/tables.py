"""The tables that questions are asked of, as one JSON document, as Parquet or as CSV.

Rows go through temporary files, one per table, so that memory stays flat over the length of the
recording.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any

import msgspec

from reasoning.questions.answer_text import FORMULA_STARTS
from reasoning.questions.duckdb_tables import reason
from reasoning.questions.ingest import read_recordings
from reasoning.questions.schema import TABLES, shown
from recorders.annotated.reader import AnnotatedLog
from recorders.errors import SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from replay.export.graphml import interaction_graph, node_link
from replay.export.output import whole_file, whole_folder

if TYPE_CHECKING:
    import duckdb
    import networkx as nx

_BLOCK = 1 << 20


class TableSpool:
    """An annotated log's tables on disk, one JSON object per line, until the block that holds it
    ends.

    Attributes:
        rows: how many rows each table has.
    """

    def __init__(
        self, log: str | Path, camera: str | None = None, limits: Limits = DEFAULT_LIMITS
    ) -> None:
        self.rows = dict.fromkeys(TABLES, 0)
        self._camera = camera
        self._log, self._limits = log, limits
        self._folder = tempfile.TemporaryDirectory(prefix="scenetrace-")

    def __enter__(self) -> TableSpool:
        try:
            # All are closed, also where closing one fails: on a full disk.
            with ExitStack() as files:
                self._files = {
                    name: files.enter_context(self.path(name).open("wb")) for name in TABLES
                }
                read_recordings(self._log, self._take, limits=self._limits)
        except BaseException:
            self._folder.cleanup()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._folder.cleanup()

    def path(self, table: str) -> Path:
        """Where a table's rows are."""
        return Path(self._folder.name) / f"{table}.jsonl"

    def lines(self, table: str) -> Iterator[bytes]:
        """A table's rows, each a JSON object."""
        with self.path(table).open("rb") as file:
            for line in file:
                yield line.rstrip(b"\n")

    def _take(self, table: str, rows: Sequence[tuple[Any, ...]]) -> None:
        names = [name for name, _ in TABLES[table]]
        raw = [kind == "JSON" for _, kind in TABLES[table]]
        columns = shown(table)
        kept = [row for row in rows if self._is_wanted(str(row[0]))]
        self._files[table].write(
            b"".join(
                msgspec.json.encode(
                    {
                        name: (
                            msgspec.Raw(value.encode())
                            if is_raw and value is not None
                            else value
                        )
                        for name, value, is_raw in zip(names, row, raw, strict=True)
                        if name in columns
                    }
                )
                + b"\n"
                for row in kept
            )
        )
        self.rows[table] += len(kept)

    def _is_wanted(self, recording: str) -> bool:
        # With several cameras in a log, its recordings are called name/camera.
        return (
            self._camera is None
            or "/" not in recording
            or recording.rsplit("/", 1)[1] == self._camera
        )


def write_json(
    log: str | Path,
    out: str | Path,
    *,
    camera: str | None = None,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> dict[str, int]:
    """Write all tables as one JSON document, an object of lists of objects; returns each table's
    rows.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
        RecordingError: ``log`` is no annotated log, or damaged.
    """
    with whole_file(out, force=force) as file, TableSpool(log, camera, limits) as spool:
        for index, table in enumerate(TABLES):
            file.write(
                f"{',' if index else '{'}\n{msgspec.json.encode(table).decode()}: [".encode()
            )
            pending = b""
            for n, line in enumerate(spool.lines(table)):
                pending += (b",\n  " if n else b"\n  ") + line
                if len(pending) > _BLOCK:
                    file.write(pending)
                    pending = b""
            file.write(pending + b"]")
        graph = msgspec.json.encode(node_link(_graph(log, camera, limits)))
        file.write(b',\n"graph": ' + graph + b"\n}\n")
        return spool.rows


def _graph(log: str | Path, camera: str | None, limits: Limits) -> nx.MultiGraph:
    with AnnotatedLog(log, camera, limits) as opened:
        return interaction_graph(opened)


def write_parquet(
    log: str | Path,
    out: str | Path,
    *,
    table: str = "tracks",
    camera: str | None = None,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> dict[str, int]:
    """Write Parquet: see `_write_tables`."""
    return _write_tables(log, out, PARQUET, table, camera, force=force, limits=limits)


def write_csv(
    log: str | Path,
    out: str | Path,
    *,
    table: str = "tracks",
    camera: str | None = None,
    force: bool = False,
    limits: Limits = DEFAULT_LIMITS,
) -> dict[str, int]:
    """Write CSV with a row of names: see `_write_tables`."""
    return _write_tables(log, out, CSV, table, camera, force=force, limits=limits)


PARQUET = ("parquet", "FORMAT parquet, COMPRESSION zstd")
CSV = ("csv", "FORMAT csv, HEADER true")


def _write_tables(
    log: str | Path,
    out: str | Path,
    kind: tuple[str, str],
    table: str,
    camera: str | None,
    *,
    force: bool,
    limits: Limits,
) -> dict[str, int]:
    """Write tables: one where ``out`` is a file name with a suffix, else a folder with one file
    per table.

    Returns:
        the rows of each table written.

    Raises:
        OutputExistsError: ``out`` exists (a folder: and is not empty) and ``force`` is not set.
        UsageError: no such table.
        RecordingError: ``log`` is no annotated log, or damaged.
    """
    if table not in TABLES:
        raise UsageError(f"no table {table!r}; there are: {', '.join(TABLES)}")
    import duckdb

    path = Path(out)
    suffix, options = kind
    if path.suffix and not path.is_dir():
        with (
            whole_file(path, force=force) as file,
            TableSpool(log, camera, limits) as spool,
            duckdb.connect(config={"threads": 1}) as db,
        ):
            _copy(db, spool, table, file.part, options)
            return {table: spool.rows[table]}
    with (
        whole_folder(path, None, force=force) as folder,
        TableSpool(log, camera, limits) as spool,
        duckdb.connect(config={"threads": 1}) as db,
    ):
        for name in TABLES:
            _copy(db, spool, name, folder / f"{name}.{suffix}", options)
        return spool.rows


def _csv_cell(column: str, kinds: dict[str, str]) -> str:
    """A column of a CSV; text that a spreadsheet would compute gets an apostrophe before it."""
    if kinds[column] != "VARCHAR":
        return column
    starts = ", ".join(f"chr({ord(start)})" for start in FORMULA_STARTS)
    return (
        f"CASE WHEN left({column}, 1) IN ({starts}) THEN chr(39) || {column} ELSE {column} END"
        f" AS {column}"
    )


def _copy(
    db: duckdb.DuckDBPyConnection, spool: TableSpool, table: str, out: Path, options: str
) -> None:
    import duckdb

    kinds = dict(TABLES[table])
    columns = ", ".join(f"{name}: '{kinds[name]}'" for name in shown(table))
    rows = (
        f"read_json($rows, format = 'newline_delimited', columns = {{{columns}}},"
        " maximum_object_size = 134217728)"
    )
    try:
        cells = (
            "*"
            if options is not CSV[1]
            else ", ".join(_csv_cell(c, kinds) for c in shown(table))
        )
        db.execute(
            f"COPY (SELECT {cells} FROM {rows}) TO $out ({options},"  # noqa: S608
            " USE_TMP_FILE false)",
            {"rows": str(spool.path(table)), "out": str(out)},
        )
    except duckdb.Error as error:
        raise SceneTraceError(f"{out}: cannot be written: {reason(error)}") from error
