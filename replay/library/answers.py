"""Answers of queries as Python rows, Arrow or pandas."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, overload

from reasoning.questions import Answer, Case, QueryLimits
from reasoning.questions.literals import Moment, duration, moment, only
from reasoning.questions.needed import tables_asked, tables_ready
from reasoning.questions.ready_questions import Options, question
from recorders.errors import SceneTraceError

Row = tuple[Any, ...]
Inputs = str | Path | Sequence[str | Path]


class Rows(Sequence[Row]):
    """An answer's rows, all of them, as tuples.

    Attributes:
        columns: their names.
        types: their types in DuckDB's words.
        left_out: how many rows of a ready question were less sure than wanted.
    """

    def __init__(self, answer: Answer) -> None:
        self.left_out = 0
        self.columns = list(answer.columns)
        self.types = list(answer.types)
        self._rows = list(answer.rows)

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, k: int) -> Row: ...

    @overload
    def __getitem__(self, k: slice) -> list[Row]: ...

    def __getitem__(self, k: int | slice) -> Row | list[Row]:
        return self._rows[k]

    def __repr__(self) -> str:
        return f"Rows({len(self)} rows of {', '.join(self.columns)})"

    def _repr_html_(self) -> str:
        """In a notebook: the first rows as a table."""
        from replay.library import html

        return html.table(self.columns, self._rows[: html.MOST_ROWS], len(self))

    def dicts(self) -> list[dict[str, Any]]:
        """Each row as column to value; of columns of one name the last counts."""
        return [dict(zip(self.columns, row, strict=True)) for row in self._rows]

    def to_arrow(self) -> Any:
        """A `pyarrow.Table` with the query's types; a second column ``t`` is called ``t_2``.

        Raises:
            SceneTraceError: pyarrow is not installed.
        """
        return self._in_duckdb("pyarrow", "to_arrow_table")

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame`; a second column ``t`` is called ``t_2``.

        Raises:
            SceneTraceError: pandas is not installed.
        """
        return self._in_duckdb("pandas", "df")

    def _in_duckdb(self, package: str, method: str) -> Any:
        import duckdb

        from reasoning.questions.parquet import load_answer

        try:
            __import__(package)
        except ImportError as error:
            raise SceneTraceError(
                f"{package} is not installed: pip install {package}"
            ) from error
        with duckdb.connect(":memory:", config={"threads": 1}) as db:
            load_answer(db, Answer(self.columns, self.types, iter(self._rows)))
            return getattr(db.sql("SELECT * FROM answer"), method)()


def query(
    inputs: Inputs | Case,
    sql: str,
    parameters: Sequence[Any] | Mapping[str, Any] = (),
    *,
    seconds: float = 60.0,
) -> Rows:
    """Ask annotated logs, indexes or folders of Parquet in SQL. It only reads.

    Args:
        inputs: one or several of them.
        sql: one SELECT over the tables, see docs/questions.md.
        parameters: values for ``?`` (or ``$name``).
        seconds: time until it is interrupted.

    Raises:
        QueryError: refused, wrong, or over a limit.
        RecordingError: an input cannot be read.
    """
    with _Asked(inputs, seconds, tables_asked(sql)) as case:
        return Rows(case.sql(sql, parameters))


def ask(
    inputs: Inputs | Case,
    name: str,
    *words: str | float,
    recording: str | None = None,
    at: str | float | None = None,
    least: str | float | None = None,
    within: str | float | None = None,
    gap: str | float | None = None,
    depth: int | None = None,
    by: str | None = None,
    certainty: float | None = None,
    seconds: float = 60.0,
) -> Rows:
    """Ask a ready question: what ``scenetrace query --ask`` asks, options under the same names.

    Args:
        inputs: annotated logs, indexes, folders of Parquet.
        name: of the question; ``scenetrace query --ask list`` shows them.
        words: its arguments.
        recording: only this one.
        at: a moment: seconds, ``frame:300`` or RFC 3339.
        least: shortest stay (``--min``): seconds, or words like ``30s``; so ``within``, ``gap``.
        within: how far apart in time.
        gap: gaps in a stay up to this are closed.
        depth: longest chain of contacts.
        by: what a contact is.
        certainty: rows less sure than this are left out, and counted in `Rows.left_out`; 0.5 where
            the question asks for that, as most do.
        seconds: time until it is interrupted.

    Raises:
        UsageError: no such question, or not these arguments.
        QueryError, RecordingError: as `query`.
    """
    from reasoning.questions.name_checks import check_recording, check_words
    from reasoning.questions.unsure import Unsure, wanted_certainty

    unsure = Unsure(wanted_certainty(name, certainty, "certainty"))
    asked, texts = question(name), [str(word) for word in words]
    options = Options(
        recordings=only(recording),
        at=_moment(at),
        least_s=_seconds(least),
        within_s=_seconds(within),
        gap_s=_seconds(gap),
        depth=depth,
        by=by,
        certainty=unsure.least,
    )
    # says what is wrong with the words before anything is read
    tables = tables_ready(asked.sql(texts, options), asked.kinds()[: len(texts)])
    with _Asked(inputs, seconds, tables) as case:
        check_recording(case, recording)
        check_words(case, asked, texts, options)
        rows = Rows(unsure.left_out_of(case.sql(asked.sql(texts, options))))
        unsure.add_contacts(case, name, options)
    rows.left_out = unsure.count
    return rows


def _moment(when: str | float | None) -> Moment | None:
    if when is None or isinstance(when, str):
        return None if when is None else moment(when)
    return Moment(seconds=float(when))


def _seconds(span: str | float | None) -> float | None:
    return duration(span) if isinstance(span, str) else span


class _Asked:
    """A case for one question: opened for it, or already open and left so."""

    def __init__(
        self, inputs: Inputs | Case, seconds: float, tables: frozenset[str]
    ) -> None:
        self._own = not isinstance(inputs, Case)
        if isinstance(inputs, Case):
            self._case = inputs
        else:
            paths = [inputs] if isinstance(inputs, str | Path) else list(inputs)
            self._case = Case(paths, QueryLimits(seconds), tables=tables)

    def __enter__(self) -> Case:
        return self._case

    def __exit__(self, *_: object) -> None:
        if self._own:
            self._case.close()
