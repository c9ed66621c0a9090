"""An answer as a Parquet file, written by a connection of our own that never sees the query."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import duckdb
import numpy as np

from reasoning.questions.duckdb_tables import reason
from recorders.errors import SceneTraceError

if TYPE_CHECKING:
    from reasoning.questions.asking import Answer, QueryLimits

_BATCH = 50_000


def write_parquet(answer: Answer, out: Path, limits: QueryLimits) -> None:
    """Write all rows, whole or not at all.

    Raises:
        SceneTraceError: it cannot be written.
    """
    part = out.with_name(f".{out.name}.{secrets.token_hex(4)}.part")
    con = duckdb.connect(":memory:", config={"threads": str(limits.threads)})
    try:
        load_answer(con, answer)
        con.execute(
            f"COPY answer TO '{str(part).replace(chr(39), chr(39) * 2)}' (FORMAT parquet)"
        )
        with part.open("rb+") as file:
            os.fsync(file.fileno())
        part.replace(out)
    except duckdb.Error as error:
        raise SceneTraceError(f"{out}: cannot be written: {reason(error)}") from error
    finally:
        part.unlink(missing_ok=True)
        con.close()


def load_answer(con: duckdb.DuckDBPyConnection, answer: Answer) -> None:
    """Put all rows into a table ``answer`` of a connection, with the answer's types."""
    names = [f'"{c.replace(chr(34), chr(34) * 2)}"' for c in unique(answer.columns)]
    columns = ", ".join(
        f"{name} {kind}" for name, kind in zip(names, answer.types, strict=True)
    )
    con.execute(f"CREATE TABLE answer ({columns})")
    for batch in _batches(answer.rows):
        _append(con, batch, answer.types)


def unique(columns: list[str]) -> list[str]:
    """Column names without repeats: a second ``t`` becomes ``t_2``."""
    out: list[str] = []
    for name in columns:
        new, k = name, 2
        while new.lower() in (o.lower() for o in out):
            new, k = f"{name}_{k}", k + 1
        out.append(new)
    return out


def _batches(rows: Iterator[tuple[Any, ...]]) -> Iterator[list[tuple[Any, ...]]]:
    while batch := list(islice(rows, _BATCH)):
        yield batch


def _append(
    con: duckdb.DuckDBPyConnection, batch: list[tuple[Any, ...]], types: list[str]
) -> None:
    columns = {}
    for index, values in enumerate(zip(*batch, strict=True)):
        column = np.empty(len(values), object)
        column[:] = values
        columns[f"c{index}"] = column
    con.register("batch", columns)
    selected = ", ".join(f"CAST(c{index} AS {kind})" for index, kind in enumerate(types))
    con.execute(f"INSERT INTO answer SELECT {selected} FROM batch")
    con.unregister("batch")
