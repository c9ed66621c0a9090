"""A safe way to ask: one SELECT (or EXPLAIN, DESCRIBE, SUMMARIZE) that reads the tables and nothing
else, within a time and a memory limit.

DuckDB enforces the file and memory part with external access off and its configuration locked
(`reasoning.questions.case`); the kind of statement is checked before it runs, in a transaction
that is read only; a timer interrupts it.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import duckdb

from reasoning.questions.duckdb_tables import first_line
from reasoning.questions.literals import Recordings
from reasoning.questions.schema import SURE, TABLES
from recorders.errors import SceneTraceError

_FETCH = 2_000
_MOST_FETCH = 16_000
_ALLOWED = ("SELECT", "EXPLAIN")
_FIRST_ROWS = 400_000
_MOST_ROWS = 4_000_000


@dataclass(frozen=True, slots=True)
class QueryLimits:
    """What one query may take.

    Attributes:
        seconds: time until it is interrupted.
        memory_mib: memory of the tables in memory and the query together.
        threads: threads it may use.
    """

    seconds: float = 60.0
    memory_mib: int = 2048
    threads: int = 2


class QueryError(SceneTraceError):
    """A query was refused, is wrong, or went over a limit."""


class QueryMemoryError(QueryError):
    """A query needs more memory than it may take."""


def locked_down(limits: QueryLimits) -> dict[str, str | bool | int | float | list[str]]:
    """DuckDB settings for a connection that never loads code and never spills to disk."""
    return {
        "threads": str(limits.threads),
        "memory_limit": f"{limits.memory_mib}MiB",
        "temp_directory": "",
        "autoinstall_known_extensions": "false",
        "autoload_known_extensions": "false",
        "allow_community_extensions": "false",
        "python_enable_replacements": "false",
    }


@dataclass(frozen=True)
class Answer:
    """A query's result: column names, DuckDB types, and rows that are fetched while they are
    read.
    """

    columns: list[str]
    types: list[str]
    rows: Iterator[tuple[Any, ...]]


class Asking:
    """Tables that are open for questions.

    Attributes:
        limits: what one query may take.
    """

    def __init__(self, limits: QueryLimits) -> None:
        self.limits = limits
        self._con = duckdb.connect(":memory:", config=locked_down(limits))
        self._begun = False

    def sql(self, query: str, parameters: Sequence[Any] | Mapping[str, Any] = ()) -> Answer:
        """Ask one question in SQL; rows are fetched as they are read, within the time limit.

        Raises:
            QueryError: refused, wrong, over a limit; also while rows are read.
        """
        deadline = time.monotonic() + self.limits.seconds
        cursor = self._started(query, parameters, deadline)
        return _answer(cursor, self._rows(cursor, deadline))

    def _started(
        self, query: str, parameters: Sequence[Any] | Mapping[str, Any], deadline: float
    ) -> duckdb.DuckDBPyConnection:
        self._check(query)
        self._before(query)
        with self._guarded(deadline):
            # A SELECT can hold a DELETE (in WITH ... RETURNING); the transaction is what forbids
            # it.
            self._end_transaction()
            self._con.execute("BEGIN TRANSACTION READ ONLY")
            self._begun = True
            return self._con.execute(query, parameters or None)

    def _before(self, query: str) -> None:
        """What has to be done before a query is run: nothing, where all tables are filled."""

    def _end_transaction(self) -> None:
        if self._begun:
            self._con.execute("ROLLBACK")
        self._begun = False

    def by_recording(
        self,
        make: Callable[[Recordings | None], str],
        chosen: Recordings | None = None,
        *,
        keeps_few: bool = False,
    ) -> Answer:
        """Ask what is a question to each recording on its own, some recordings at a time, in the
        order of their names.

        Nothing that happens in one recording meets another's ids, so the answer is that of the
        whole question; but it needs the memory of a few recordings, and its first rows come while
        the rest is not yet read.

        A question that keeps few of the rows that it looks through is asked of all recordings at
        once: one plan and one pass instead of many. If that takes too much memory all the same,
        some at a time.

        Args:
            make: the SQL for the recordings that it is given (None: all).
            chosen: the recordings to ask, all at once (None: all there are).
            keeps_few: see above.

        Raises:
            QueryError: as `sql`.
        """
        if chosen is not None:
            return self.sql(make(chosen))
        whole = make(None)
        deadline = time.monotonic() + self.limits.seconds
        if keeps_few:
            try:
                cursor = self._started(whole, (), deadline)
                return _answer(cursor, self._rows(cursor, deadline))
            except QueryMemoryError:
                pass
        spans = self._spans(whole)
        if len(spans) < 2:
            return self.sql(whole)
        first = self._started(make(spans[0]), (), deadline)

        def rows() -> Iterator[tuple[Any, ...]]:
            yield from self._rows(first, deadline)
            for span in spans[1:]:
                yield from self._rows(self._started(make(span), (), deadline), deadline)

        return _answer(first, rows())

    def _spans(self, query: str) -> list[Recordings]:
        """Spans of recordings that hold few, then more rows of the tables that the query reads
        (by the average).
        """
        names = sorted(row[0] for row in self.rows("SELECT recording FROM recordings"))
        words = {w.removeprefix(SURE) for w in re.findall(r"\w+", query)}
        counts = " + ".join(
            f"(SELECT count(*) FROM {t})"
            for t in TABLES
            if t in words and t != "recordings"
        )
        total = self.rows(f"SELECT {counts}")[0][0] if counts and len(names) > 1 else 0
        if total <= _FIRST_ROWS:
            return []
        spans, start, budget = [], 0, _FIRST_ROWS
        while start < len(names):
            end = min(len(names), start + max(1, budget * len(names) // total))
            spans.append(Recordings(names[start], names[end - 1]))
            start, budget = end, min(4 * budget, _MOST_ROWS)
        return spans

    def rows(
        self, query: str, parameters: Sequence[Any] | Mapping[str, Any] = ()
    ) -> list[tuple[Any, ...]]:
        """All rows of a query."""
        return list(self.sql(query, parameters).rows)

    def _rows(
        self, cursor: duckdb.DuckDBPyConnection, deadline: float
    ) -> Iterator[tuple[Any, ...]]:
        size = _FETCH
        while True:
            with self._guarded(deadline):
                batch = cursor.fetchmany(size)
            if not batch:
                return
            yield from batch
            size = min(2 * size, _MOST_FETCH)

    def _check(self, query: str) -> None:
        try:
            statements = self._con.extract_statements(query)
        except duckdb.Error as error:
            raise QueryError(f"SQL: {_error_text(error)}") from error
        if len(statements) != 1:
            raise QueryError(f"SQL: one statement is wanted, this is {len(statements)}")
        try:
            kind = statements[0].type.name
        except ValueError:  # a kind that DuckDB's Python does not know by name
            kind = query.split(maxsplit=1)[0].upper()
        words = query.split()
        if kind not in _ALLOWED or (
            kind == "EXPLAIN" and "ANALYZE" in (word.upper().strip("(),") for word in words)
        ):
            shown = "EXPLAIN ANALYZE" if kind == "EXPLAIN" else kind
            raise QueryError(
                f"SQL: {shown} is refused; a query may only read: SELECT, DESCRIBE,"
                " SUMMARIZE, EXPLAIN"
            )

    @contextmanager
    def _guarded(self, deadline: float) -> Iterator[None]:
        over = threading.Event()

        def stop() -> None:
            over.set()
            self._con.interrupt()

        timer = threading.Timer(max(0.001, deadline - time.monotonic()), stop)
        timer.daemon = True
        timer.start()
        try:
            yield
        except duckdb.InterruptException as error:
            # The timer of the batch before may have struck between two batches: it is this
            # query's time all the same.
            if not over.is_set() and time.monotonic() < deadline:
                raise
            raise QueryError(
                f"SQL: stopped after {self.limits.seconds:g} s (--time-limit)"
            ) from error
        except (duckdb.OutOfMemoryException, MemoryError) as error:
            raise QueryMemoryError(
                f"SQL: needs more than {self.limits.memory_mib} MiB of memory (--memory)"
            ) from error
        except duckdb.PermissionException as error:
            raise QueryError(
                "SQL: refused, a query may read the tables and nothing else:"
                f" {first_line(error)}"
            ) from error
        except (duckdb.Error, RuntimeError) as error:
            if isinstance(error, duckdb.TransactionException) and "read-only" in str(error):
                raise QueryError(
                    "SQL: refused, a query may only read: it holds a statement that writes"
                ) from error
            if (
                "'pytz'" in str(error)
            ):  # DuckDB hands time zones to Python through a package that is not ours to ask for
                raise QueryError(
                    "SQL: show a TIMESTAMP WITH TIME ZONE as text: CAST(... AS VARCHAR)"
                ) from error
            raise QueryError(f"SQL: {_error_text(error)}") from error
        finally:
            timer.cancel()
            timer.join(
                1.0
                # a thread that still ends while the process does keeps DuckDB's objects: it complains
            )


def _answer(cursor: duckdb.DuckDBPyConnection, rows: Iterator[tuple[Any, ...]]) -> Answer:
    described = cursor.description or []
    return Answer([d[0] for d in described], [str(d[1]) for d in described], rows)


def _error_text(error: Exception) -> str:
    """DuckDB's message on one line, with the caret's position as a column number, and its
    suggestion.
    """
    lines = [line.rstrip() for line in str(error).strip().splitlines()]
    kept = [
        line.strip() for line in lines if line.strip(" ^") and not line.startswith("LINE ")
    ]
    caret = next((line for line in lines if line.strip() and not line.strip(" ^")), None)
    marked = next((line for line in lines if line.startswith("LINE ")), None)
    if caret is not None and marked is not None:
        column = caret.index("^") - marked.index(":") - 1
        kept.append(f"at line {marked[5 : marked.index(':')]}, column {max(1, column)}")
    return "; ".join(kept) if kept else type(error).__name__
