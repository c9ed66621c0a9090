"""Rows into DuckDB tables, a batch at a time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import duckdb
import numpy as np

from reasoning.questions.recording_facts import Row
from reasoning.questions.schema import TABLES, Columns
from recorders.errors import SceneTraceError

_BATCH = "scenetrace_batch"
_DTYPES = {
    "INTEGER": np.int64,
    "BIGINT": np.int64,
    "DOUBLE": np.float64,
    "BOOLEAN": np.bool_,
}


def insert(
    con: duckdb.DuckDBPyConnection,
    table: str,
    rows: Sequence[Row],
    columns: Columns | None = None,
    schema: str = "",
) -> None:
    """Insert rows whose values are in the order of the table's columns; lists become INTEGER[].

    ``columns`` are those of `schema.TABLES` unless given, ``schema`` where the table is.

    Raises:
        SceneTraceError: a value does not fit its column (an id over 2^31).
    """
    if not rows:
        return
    batch, selected = {}, []
    for index, ((name, kind), values) in enumerate(
        zip(columns or TABLES[table], zip(*rows, strict=True), strict=True)
    ):
        batch[f"c{index}"] = _column(kind, values)
        selected.append(f"CAST(c{index} AS {kind}) AS {name}")
    place = f"{schema}.{table}" if schema else table
    try:
        con.register(_BATCH, batch)
        con.execute(f"INSERT INTO {place} SELECT {', '.join(selected)} FROM {_BATCH}")
        con.unregister(_BATCH)
    except (duckdb.Error, OverflowError) as error:
        raise SceneTraceError(
            f"a row of {table} does not fit its columns: {reason(error)}"
        ) from error


def reason(error: Exception) -> str:
    """DuckDB's message as one line; a failed write's is a JSON document in a line, of which the
    message is taken.
    """
    text = (str(error).strip() or type(error).__name__).splitlines()[0]
    inner = re.search(r'"exception_message":"((?:[^"\\]|\\.)*)"', text)
    return inner[1].replace('\\"', '"') if inner else text


def first_line(error: Exception) -> str:
    """The first line of DuckDB's message, or the error's name."""
    return (str(error).strip() or type(error).__name__).splitlines()[0]


def _column(kind: str, values: Sequence[Any]) -> np.ndarray[Any, Any]:
    if kind.endswith("[]"):
        return np.array([str(value) for value in values], object)
    if kind not in _DTYPES or any(value is None for value in values):
        out = np.empty(len(values), object)
        out[:] = values
        return out
    try:
        return np.array(values, _DTYPES[kind])
    except OverflowError:
        return np.array(values, object)
