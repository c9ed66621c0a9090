"""A case: annotated logs, indexes and Parquet folders behind one set of tables, and a safe way to
ask them.

A query reads the tables and nothing else: one SELECT (or EXPLAIN, DESCRIBE, SUMMARIZE), no other
file, no setting, no extension, no other database, within a time and a memory limit. DuckDB
enforces the file and memory part with external access off and its configuration locked; the kind
of statement is checked before it runs, in a transaction that is read only; a timer interrupts it.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence, Set
from functools import partial
from pathlib import Path

import duckdb

from reasoning.encounters import EncounterParameters
from reasoning.questions import catalogue
from reasoning.questions.asking import Asking, QueryError, QueryLimits
from reasoning.questions.drawn import Drawn
from reasoning.questions.drawn_tables import draw, make_tables
from reasoning.questions.duckdb_tables import first_line, insert
from reasoning.questions.ingest import read_recordings
from reasoning.questions.inputs import free_name, kind_of, parquet_parts
from reasoning.questions.literals import literal
from reasoning.questions.macros import macro_statements
from reasoning.questions.metres import GroundPlane, make_metres
from reasoning.questions.needed import DIGEST, EVERYTHING, OF_DRAWING, tables_of
from reasoning.questions.recording_facts import RecordingFacts, file_digest
from reasoning.questions.schema import DRAWN, SURE, TABLES, create_statements, shown
from recorders.closing import Closing
from recorders.errors import RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.messages import EVENT_LEVELS
from recorders.stores import is_uri, open_store
from recorders.told_times import CLOCKED_NS, clock_text

_LOGS = "logs"


_OF_TRACKERS = ", ".join(
    f"'{kind}'" for kind, level in EVENT_LEVELS.items() if level == "DEBUG"
)


class Case(Asking, Closing):
    """Tables over any number of inputs, open for questions.

    Attributes:
        inputs: what was opened.
        limits: what one query may take.
        log_limits: bounds on what a log may make us allocate.
        drawn: the zones and lines that were drawn after the fact.
    """

    def __init__(
        self,
        inputs: Sequence[str | Path],
        limits: QueryLimits | None = None,
        *,
        log_limits: Limits = DEFAULT_LIMITS,
        encounters: EncounterParameters | None = None,
        brief: bool = False,
        drawn: Drawn | None = None,
        start_ns: int | Mapping[str, int] | None = None,
        looks: bool = False,
        choice: catalogue.Choice | None = None,
        ground: GroundPlane | None = None,
        tables: Set[str] = EVERYTHING,
    ) -> None:
        """Open and read the inputs.

        Args:
            inputs: annotated logs, indexes, Parquet folders, cases of `scenetrace batch` (a
                folder or a URI).
            limits: what one query may take.
            log_limits: bounds on what a log may make us allocate.
            encounters: the thresholds of encounters in logs; an index keeps those that it was
                made with.
            brief: leave out of ``events`` what trackers say of themselves: the kinds whose level
                is DEBUG in `recorders.messages.EVENT_LEVELS`.
            drawn: zones and lines that are drawn after the fact; stays in the zones join those
                in recorded ones, crossings of the lines are the table ``crossings``.
            looks: look at pictures of the logs, so that targets have colours; an index has them.
            start_ns: when the recording began (ns since 1970), where it was made without a clock;
                of several, by their names.
            choice: the part of a fleet's catalogue that is asked; nothing else is opened.
            ground: how pixels become metres, in the view ``metres``, which is empty without.
            tables: what will be asked for (`reasoning.questions.needed`). Logs are read to their end,
                but other tables are filled only once a question reads them, by reading the logs
                again.

        Raises:
            UsageError: a zone or line lies beyond a picture, or is called as a recorded zone is;
                a start for several recordings, or one that has a clock.
            RecordingError: an input is neither log, index nor Parquet folder, or is damaged.
        """
        if not inputs:
            raise UsageError(
                "no recordings to ask; give annotated logs, an index, or a folder of"
                " Parquet"
            )
        self.inputs = [Path(p) for p in inputs]
        self._uris = {Path(p): str(p) for p in inputs if is_uri(str(p))}
        self._choice = choice or catalogue.Choice()
        super().__init__(limits or QueryLimits())
        self.log_limits = log_limits
        self._brief = brief
        self.drawn = drawn or Drawn()
        self._start_ns = start_ns
        self._looks = looks
        self.ground = ground
        self._places: list[tuple[Path, Callable[[str], str]]] = []
        self._files: list[Path] = []
        self._folders: list[Path] = []
        self._known: dict[tuple[str, str], str] = {}
        self._encounters = encounters
        self._logs: list[tuple[Path, str]] = []
        self._filled: Set[str] = EVERYTHING
        self._wanted = tables | {"recordings"}
        if self.drawn or ground is not None:
            self._wanted |= OF_DRAWING
        try:
            self._open()
        except duckdb.OutOfMemoryException as error:
            self._con.close()
            raise QueryError(
                f"the recordings need more than {self.limits.memory_mib} MiB (--memory); "
                "make an index of them with `scenetrace index` and ask that"
            ) from error
        except BaseException:
            self._con.close()
            raise

    def close(self) -> None:
        """Let go of the tables."""
        self._con.close()

    def _take_in(self) -> list[Path]:
        """Attach what holds tables; the inputs that are logs."""
        logs: list[Path] = []
        for path in self.inputs:
            kind = "catalogue" if path in self._uris else kind_of(path)
            if kind == "catalogue":
                self._catalogue(path)
            elif kind == "log":
                logs.append(path)
            elif kind == "index":
                self._attach(path)
            else:
                self._folder(path)
        return logs

    def _open(self) -> None:
        logs = self._take_in()
        if self._choice != catalogue.Choice() and not self._folders:
            raise UsageError(
                "--camera and --date choose within a case of `scenetrace batch`; none of"
                f" these is one: {', '.join(map(str, self.inputs))}"
            )
        if logs:
            self._read_logs(logs)
        made = make_tables(self._con)
        for table in TABLES:
            parts = " UNION ALL BY NAME ".join(
                [
                    *(f"SELECT * FROM {place(table)}" for _, place in self._places),
                    *([made[table]] if table in made else []),
                ]
            )
            if table == "recordings" and self._start_ns is not None:
                begun = self._began(parts)
                parts = (
                    f"SELECT * REPLACE (CAST({begun} AS BIGINT) AS start_ns) FROM ({parts})"
                )
            if table == "events" and self._brief:
                parts = f"SELECT * FROM ({parts}) WHERE kind NOT IN ({_OF_TRACKERS})"
            try:
                self._con.execute(f"CREATE VIEW {SURE}{table} AS {parts}")
                columns = ", ".join(shown(table))
                self._con.execute(
                    f"CREATE VIEW {table} AS SELECT {columns} FROM {SURE}{table}"
                )
            except duckdb.Error as error:
                raise RecordingError(
                    f"{table} cannot be read: {first_line(error)}", self._damaged(table)
                ) from error
        for table in DRAWN:
            self._con.execute(f"CREATE VIEW {table} AS {made[table]}")
        for statement in macro_statements():
            self._con.execute(statement)
        draw(self._con, self.drawn)
        make_metres(self._con, self.ground)
        self._lock()

    def _began(self, recordings: str) -> str:
        """An expression of when each recording began."""
        rows = self._con.execute(
            f"SELECT recording, start_ns FROM ({recordings})"
        ).fetchall()
        given = self._start_ns
        if not isinstance(given, Mapping):
            if len(rows) > 1:
                raise UsageError(
                    f"--start: of {len(rows)} recordings; give one of them alone"
                )
            for name, start_ns in rows:
                if start_ns >= CLOCKED_NS:
                    raise UsageError(
                        f"--start: {name} has a clock, it began at {clock_text(start_ns)}"
                    )
            return str(given)
        cases = [
            f"WHEN recording = {literal(name)} THEN {given[name]}"
            for name, start_ns in rows
            if name in given and start_ns < CLOCKED_NS
        ]
        return f"CASE {' '.join(cases)} ELSE start_ns END" if cases else "start_ns"

    def _lock(self) -> None:
        """From here on nothing but the tables can be read, and no setting changed."""
        self._con.execute("SET TimeZone = 'UTC'")
        if self._files:
            self._con.execute(
                f"SET allowed_paths = [{', '.join(map(_quoted, self._files))}]"
            )
        if self._folders:
            folders = ", ".join(_quoted(folder) for folder in self._folders)
            self._con.execute(f"SET allowed_directories = [{folders}]")
        self._con.execute("SET enable_external_access = false")
        self._con.execute("SET lock_configuration = true")

    def _damaged(self, table: str) -> Path:
        """The input whose table cannot be read, to be named."""
        for path, place in self._places:
            try:
                self._con.execute(f"SELECT * FROM {place(table)} LIMIT 0")
            except duckdb.Error:
                return path
        return self.inputs[0]

    def _attach(self, path: Path) -> None:
        name = f"source_{len(self._places)}"
        try:
            self._con.execute(f"ATTACH {_quoted(path)} AS {name} (READ_ONLY)")
            columns = {(row[0], row[1]) for row in self._con.execute(
                "SELECT table_name, column_name FROM duckdb_columns() WHERE database_name = ?",
                [name],
            ).fetchall()}  # fmt: skip
        except duckdb.Error as error:
            raise RecordingError(
                f"cannot be opened as an index: {first_line(error)}", path
            ) from error
        tables = {table for table, _ in columns}
        missing = [f"table {t}" for t in TABLES if t not in tables] + [
            f"column {c} of {t}"
            for t in TABLES
            for c, _ in TABLES[t]
            if (t, c) not in columns
        ]
        if missing:
            old = (
                "an index of another version"
                if "recordings" in tables
                else "no index of scenetrace"
            )
            raise RecordingError(
                f"{old}: it has no {missing[0]}; make it with `scenetrace index`",
                path,
            )
        self._add(lambda table: f"{name}.{table}", path)

    def _folder(self, path: Path) -> None:
        parts = [part.resolve() for part in parquet_parts(path)]
        self._files += [part / f"{table}.parquet" for part in parts for table in TABLES]
        self._add(
            lambda table: (
                f"read_parquet([{', '.join(_quoted(part / f'{table}.parquet') for part in parts)}])"
            ),
            path,
        )

    def _catalogue(self, path: Path) -> None:
        """The files of a fleet's tables that belong to the case at this moment."""
        store = open_store(self._uris.get(path, path))
        catalogue.check_schema(store)
        chosen = catalogue.pieces(store, self._choice)
        if not chosen:
            raise RecordingError(
                catalogue.none_chosen(store, self._choice), self._uris.get(path, path)
            )
        root = catalogue.local_tables(store, chosen, _cache()).resolve()
        self._folders.append(root / catalogue.TABLES_FOLDER)

        def place(table: str) -> str:
            files = ", ".join(_quoted(root / piece.key(table)) for piece in chosen)
            return f"read_parquet([{files}], hive_partitioning = false)"

        self._add(place, path)

    def _add(self, place: Callable[[str], str], path: Path) -> None:
        """Take an input in, unless it holds a recording that another one holds already."""
        try:
            rows = self._con.execute(
                f"SELECT digest, camera, recording FROM {place('recordings')}"
            ).fetchall()
        except duckdb.Error as error:
            raise RecordingError(
                f"cannot be read as an index: {first_line(error)}", path
            ) from error
        names = set(self._known.values())
        for digest, camera, name in rows:
            if (digest, camera) in self._known or name in names:
                raise UsageError(
                    f"{path}: recording {name!r} is in another input already; give one of"
                    " them"
                )
            self._known[digest, camera] = name
            names.add(name)
        self._places.append((path, place))

    def _read_logs(self, logs: list[Path]) -> None:
        self._con.execute(f"CREATE SCHEMA {_LOGS}")
        for statement in create_statements():
            self._con.execute(
                statement.replace("CREATE TABLE ", f"CREATE TABLE {_LOGS}.", 1)
            )
        if len(self.inputs) > 1:  # of one log nobody need know whether it is another
            self._wanted |= {DIGEST}
        self._filled = self._wanted
        digests = {digest for digest, _ in self._known}
        for path in logs:
            digest = file_digest(path) if DIGEST in self._wanted else ""
            if digest in digests:
                continue
            digests.add(digest)
            name = free_name(path.stem, self._known.values())
            self._logs.append((path, name))
            for facts in self._fill(path, name, self._wanted, digest):
                self._known[digest, facts.camera] = facts.recording
        self._places.append((logs[0], lambda table: f"{_LOGS}.{table}"))

    def _fill(
        self, path: Path, name: str, tables: Set[str], digest: str = ""
    ) -> list[RecordingFacts]:
        """Fill tables with what a log says."""
        return read_recordings(
            path,
            partial(insert, self._con, schema=_LOGS),
            name=name,
            digest=digest,
            limits=self.log_limits,
            encounters=self._encounters,
            looks=self._looks,
            tables=tables,
        )

    def _before(self, query: str) -> None:
        """Fill what a query reads and nobody has asked for yet."""
        missing = tables_of(query) - self._filled
        if not missing or not self._logs:
            return
        self._end_transaction()
        self._con.begin()
        try:
            for path, name in self._logs:
                if DIGEST in missing:
                    self._con.execute(
                        f"UPDATE {_LOGS}.recordings SET digest = ?", [file_digest(path)]
                    )
                if missing != {DIGEST}:
                    self._fill(path, name, missing)
        except BaseException:
            self._con.rollback()
            raise
        self._con.commit()
        self._filled |= missing


def _cache() -> Path:
    """Where copies of remote tables lie: the user's own, so that nobody else puts files there."""
    home = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    return Path(home) / "scenetrace"


def _quoted(path: Path) -> str:
    return literal(str(path))
