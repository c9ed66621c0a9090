"""The index of a case: many annotated logs in one DuckDB file or in a folder of Parquet, each
recording once.

A recording is known by the SHA-256 of its file. Into a DuckDB file every log goes in a
transaction of its own; into a folder, logs go in parts that appear whole (written beside, then
renamed). So a run that was interrupted leaves what was finished, and the same command again does
the rest.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import duckdb

from reasoning.encounters import EncounterParameters
from reasoning.questions.asking import QueryLimits, locked_down
from reasoning.questions.duckdb_tables import insert, reason
from reasoning.questions.ingest import read_recordings
from reasoning.questions.inputs import PART_PREFIX, free_name, kind_of, parquet_parts
from reasoning.questions.literals import literal
from reasoning.questions.recording_facts import RecordingFacts, file_digest
from reasoning.questions.schema import TABLES, create_statements
from recorders.errors import RecordingError, SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log.output import lock_folder, take_name

PART_RECORDINGS = 32
Told = Callable[[str, int], None]


@dataclass(frozen=True)
class IndexSummary:
    """What a run did: recordings added, logs that were there already, and logs that could not be
    read (path, why).
    """

    added: list[RecordingFacts]
    known: list[Path]
    failed: list[tuple[Path, str]]


def build_index(
    logs: Sequence[Path],
    out: Path,
    *,
    keep_going: bool = False,
    limits: Limits = DEFAULT_LIMITS,
    encounters: EncounterParameters | None = None,
    progress: Told | None = None,
) -> IndexSummary:
    """Add logs to an index; a name with ``.duckdb`` (or ``.db``) is a file, any other a folder of
    Parquet.

    Args:
        logs: annotated logs.
        out: the index; made if it is not there, added to if it is.
        keep_going: note a log that cannot be read and go on, instead of raising.
        limits: bounds on what a log may make us allocate.
        encounters: thresholds for the encounters.
        progress: called with a stage and the number of logs done.

    Raises:
        RecordingError, SceneTraceError: a log or the index cannot be read or written.
    """
    target: _DuckDB | _Parquet = (
        _DuckDB(out) if out.suffix in (".duckdb", ".db") else _Parquet(out)
    )
    added: list[RecordingFacts] = []
    known: list[Path] = []
    failed: list[tuple[Path, str]] = []
    try:
        for done, log in enumerate(logs):
            try:
                if kind_of(log) != "log":
                    raise RecordingError("an index itself; give annotated logs", log)
                digest = file_digest(log)
                if digest in target.digests:
                    known.append(log)
                else:
                    added += target.add(log, digest, limits, encounters)
            except RecordingError as error:
                if not keep_going:
                    raise
                failed.append((log, str(error)))
            if progress is not None:
                progress("index", done)
        target.finish()
    finally:
        target.close()
    return IndexSummary(added, known, failed)


class _Target:
    """What logs are added to: one transaction per log, each recording once."""

    _con: duckdb.DuckDBPyConnection
    _names: list[str]
    digests: set[str]

    def add(
        self, log: Path, digest: str, limits: Limits, encounters: EncounterParameters | None
    ) -> list[RecordingFacts]:
        """Add one log, or nothing of it."""
        name = free_name(log.stem, self._names)
        self._con.execute("BEGIN TRANSACTION")
        try:
            found = read_recordings(
                log,
                self._insert,
                name=name,
                digest=digest,
                limits=limits,
                encounters=encounters,
                looks=True,
            )
            self._con.execute("COMMIT")
        except duckdb.Error as error:
            self._roll_back()
            raise SceneTraceError(
                f"the index cannot be written: {reason(error)}"
            ) from error
        except BaseException:
            self._roll_back()
            raise
        self.digests.add(digest)
        self._names += [f.recording for f in found]
        return found

    def _roll_back(self) -> None:
        # Where the disk failed DuckDB has done so itself.
        with suppress(duckdb.Error):
            self._con.execute("ROLLBACK")

    def _insert(self, table: str, rows: Sequence[tuple[Any, ...]]) -> None:
        insert(self._con, table, rows)


class _DuckDB(_Target):
    """One database file; one transaction per log.

    A new one gets its tables beside and then its name, unless another process was faster: the
    name never stands for anything but a whole index, which DuckDB's lock keeps to one writer.
    """

    def __init__(self, path: Path) -> None:
        self._made = _make_database(path)
        if kind_of(path) != "index":
            raise RecordingError("exists and is no index", path)
        try:
            self._con = _connect(path)
            tables = {
                r[0]
                for r in self._con.execute(
                    "SELECT table_name FROM duckdb_tables()"
                ).fetchall()
            }
            if not set(TABLES) <= tables:
                self._con.close()
                raise RecordingError("a database, but no index of scenetrace", path)
            rows = self._con.execute("SELECT digest, recording FROM recordings").fetchall()
        except duckdb.Error as error:
            raise RecordingError(
                f"cannot be opened for writing: {reason(error)}", path
            ) from error
        self._path = path
        self.digests = {digest for digest, _ in rows}
        self._names = [name for _, name in rows]

    def finish(self) -> None:
        """Fold the write-ahead log into the file."""
        try:
            self._con.execute("CHECKPOINT")
        except duckdb.Error as error:
            raise RecordingError(
                f"cannot be written: {reason(error)}", self._path
            ) from error

    def close(self) -> None:
        """Let go of it; one that was made here and got nothing goes, while nobody else has it."""
        if self._made and not self.digests:
            for path in (self._path, self._path.with_name(f"{self._path.name}.wal")):
                path.unlink(missing_ok=True)
        self._con.close()


def _connect(path: Path) -> duckdb.DuckDBPyConnection:
    return duckdb.connect(
        str(path), config={**locked_down(QueryLimits()), "temp_directory": ""}
    )


def _make_database(path: Path) -> bool:
    """Make an index without recordings where nothing is, or an empty file; whether it was
    made.
    """
    is_empty = path.is_file() and not path.stat().st_size
    if path.exists() and not is_empty:
        return False
    if not path.parent.is_dir():
        raise RecordingError(f"cannot be written: there is no folder {path.parent}", path)
    beside = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with _connect(beside) as con:
            for statement in create_statements():
                con.execute(statement)
        if is_empty:
            beside.replace(path)
        else:
            take_name(beside, path)
    except FileExistsError:
        return False  # another process was faster
    except (duckdb.Error, OSError) as error:
        why = reason(error) if isinstance(error, duckdb.Error) else error.strerror
        raise RecordingError(f"cannot be opened for writing: {why}", path) from error
    finally:
        for left in (beside, beside.with_name(f"{beside.name}.wal")):
            left.unlink(missing_ok=True)
    return True


class _Parquet(_Target):
    """A folder of parts, each a folder with one Parquet file per table; locked while it is added
    to.
    """

    def __init__(self, folder: Path) -> None:
        if folder.exists() and not folder.is_dir():
            raise RecordingError(
                "exists and is no folder; a database's name ends in .duckdb", folder
            )
        strangers = (
            [
                p.name
                for p in folder.iterdir()
                if not p.name.lstrip(".").startswith(PART_PREFIX)
            ]
            if folder.exists()
            else []
        )
        if strangers:
            raise UsageError(
                f"{folder}: holds {strangers[0]!r}, which is no part of an index; give an"
                " own folder"
            )
        self._made = not folder.exists()
        folder.mkdir(parents=True, exist_ok=True)
        self._lock = lock_folder(folder)
        try:
            self._open(folder)
        except BaseException:
            self._let_go()
            raise

    def _open(self, folder: Path) -> None:
        for leftover in folder.glob(f".{PART_PREFIX}*"):
            shutil.rmtree(leftover)
        self._folder = folder
        self._con = duckdb.connect(":memory:", config=locked_down(QueryLimits()))
        rows: list[tuple[str, str]] = []
        parts = parquet_parts(folder)
        try:
            for part in parts:
                rows += self._con.execute(
                    "SELECT digest, recording FROM read_parquet(?)",
                    [str(part / "recordings.parquet")],
                ).fetchall()
            for statement in create_statements():
                self._con.execute(statement)
        except duckdb.Error as error:
            raise RecordingError(
                f"a part cannot be read: {reason(error)}", folder
            ) from error
        self._next = 1 + max(
            (int(part.name.removeprefix(PART_PREFIX)) for part in parts), default=-1
        )
        self._waiting = 0
        self.digests = {digest for digest, _ in rows}
        self._names = [name for _, name in rows]

    def add(
        self, log: Path, digest: str, limits: Limits, encounters: EncounterParameters | None
    ) -> list[RecordingFacts]:
        """Add one log; it is safe on disk once its part is written."""
        found = super().add(log, digest, limits, encounters)
        self._waiting += 1
        if self._waiting >= PART_RECORDINGS:
            self._write()
        return found

    def _write(self) -> None:
        name = f"{PART_PREFIX}{self._next:06d}"
        beside = self._folder / f".{name}"
        beside.mkdir()
        for table in TABLES:
            file = literal(str(beside / f"{table}.parquet"))
            try:
                self._con.execute(f"COPY {table} TO {file} (FORMAT parquet)")
                self._con.execute(f"TRUNCATE {table}")
            except duckdb.Error as error:
                shutil.rmtree(beside, ignore_errors=True)
                raise SceneTraceError(
                    f"{self._folder}: cannot be written: {reason(error)}"
                ) from error
        beside.rename(self._folder / name)
        self._next, self._waiting = self._next + 1, 0

    def finish(self) -> None:
        """Write the last, smaller part."""
        if self._waiting:
            self._write()

    def close(self) -> None:
        """Let go of it; one that was made here and got nothing goes."""
        if self._made and not parquet_parts(self._folder):
            shutil.rmtree(self._folder)
        self._con.close()
        self._let_go()

    def _let_go(self) -> None:
        if self._lock is not None:
            os.close(self._lock)
