"""Answers as text: a table for people, JSON and CSV for machines, written row by row."""

from __future__ import annotations

import csv
import json
import math
from collections.abc import Iterator, Sequence
from datetime import date, datetime, time
from itertools import chain, islice
from typing import IO, Any

from reasoning.questions.asking import Answer
from reasoning.questions.parquet import unique

FORMATS = ("table", "json", "csv", "parquet")
FORMULA_STARTS = ("=", "+", "-", "@", "\t", "\r")
_MEASURED = 1_000
_WIDEST = 80
_MILLI = 3
_CSV_ITSELF = (
    str,
    int,
    float,
    type(None),
)  # written by csv as `_text` would; no bool, which is an int
_JSON_ITSELF = (str, int, bool, type(None))
_TO_JSON = json.JSONEncoder(ensure_ascii=False, allow_nan=False)


def write(answer: Answer, form: str, out: IO[str]) -> int:
    """Write an answer as ``table``, ``json`` or ``csv``; returns the number of rows."""
    if form == "json":
        return _json(answer, out)
    if form == "csv":
        return _csv(answer, out)
    return _table(answer, out)


def _json(answer: Answer, out: IO[str]) -> int:
    names = unique(answer.columns)
    nested = [kind == "JSON" for kind in answer.types]
    count = 0
    out.write("[")
    for row in answer.rows:
        values = [
            json.loads(v)
            if is_json and isinstance(v, str)
            else v
            if type(v) in _JSON_ITSELF
            else plain(v)
            for v, is_json in zip(row, nested, strict=True)
        ]
        out.write(",\n " if count else "\n ")
        out.write(_TO_JSON.encode(dict(zip(names, values, strict=True))))
        count += 1
    out.write("\n]\n" if count else "]\n")
    return count


def plain(value: Any) -> Any:
    """A value that JSON can hold: times as ISO 8601, bytes in hex, not finite as null, foreign
    things as text.
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    if isinstance(value, (list, tuple)):
        return [plain(v) for v in value]
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    return _plain_text(value)


def _plain_text(value: Any) -> str:
    if isinstance(value, (datetime, date, time)):
        return value.isoformat()
    return value.hex() if isinstance(value, (bytes, bytearray)) else str(value)


def _csv(answer: Answer, out: IO[str]) -> int:
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(answer.columns)
    count = 0
    for row in answer.rows:
        writer.writerow([_csv_cell(v) for v in row])
        count += 1
    return count


def _csv_cell(value: Any) -> Any:
    if type(value) is str:
        return no_formula(value)
    return value if type(value) in _CSV_ITSELF else _text(value)


def no_formula(text: str) -> str:
    """A text of a recording that a spreadsheet shows and does not compute: what begins like a
    formula gets an apostrophe before it.

    >>> no_formula("=1+1"), no_formula("door")
    ("'=1+1", 'door')
    """
    return f"'{text}" if text.startswith(FORMULA_STARTS) else text


def _text(value: Any) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, (list, tuple, dict)):
        return _TO_JSON.encode(plain(value))
    return _plain_text(value)


def _cell(value: Any, decimals: int | None = None) -> str:
    if value is None:
        return ""
    if isinstance(value, float):
        text = (
            f"{value:.10g}"
            if decimals is None or not math.isfinite(value)
            else f"{value:.{decimals}f}"
        )
    else:
        text = _text(value)
    # A recording's text must not steer the terminal.
    clean = (
        text if text.isprintable() else "".join(c if c.isprintable() else " " for c in text)
    )
    return clean if len(clean) <= _WIDEST else clean[: _WIDEST - 1] + "…"


def _table(answer: Answer, out: IO[str]) -> int:
    """Columns as wide as the first rows need; numbers to the right, with as many decimals as the
    longest has.
    """
    raw = iter(answer.rows)
    measured = list(islice(raw, _MEASURED))
    columns = list(zip(*measured, strict=True)) or [()] * len(answer.columns)
    decimals = [
        _decimals(name, values)
        for name, values in zip(answer.columns, columns, strict=True)
    ]
    rows: Iterator[list[str]] = (
        [_cell(v, decimal) for v, decimal in zip(row, decimals, strict=True)] for row in raw
    )
    first = [
        [_cell(v, decimal) for v, decimal in zip(row, decimals, strict=True)]
        for row in measured
    ]
    names = [_cell(column) for column in answer.columns]
    widths = [
        max(len(name), *(len(r[index]) for r in first), 0)
        for index, name in enumerate(names)
    ]
    numeric = [_is_number(kind) for kind in answer.types]

    def line(cells: list[str]) -> str:
        padded = (
            cell.rjust(width) if n else cell.ljust(width)
            for cell, width, n in zip(cells, widths, numeric, strict=True)
        )
        return "  ".join(padded).rstrip() + "\n"

    out.write(line(names))
    out.write("  ".join("-" * width for width in widths) + "\n")
    count = 0
    for row in chain(first, rows):
        out.write(line(row))
        count += 1
    return count


def _decimals(name: str, values: Sequence[Any]) -> int | None:
    """Decimals that show all of a column's numbers to ten digits; None if it has none, or very
    small or large ones.

    Times in seconds are shown to the millisecond (JSON and CSV have all of their digits).
    """
    shown = [
        f"{value:.10g}"
        for value in values
        if isinstance(value, float) and math.isfinite(value)
    ]
    if not shown or any("e" in text for text in shown):
        return None
    most = max(len(text.partition(".")[2]) for text in shown)
    return min(most, _MILLI) if name == "t" or name.endswith("_t") else most


def _is_number(kind: str) -> bool:
    return (
        kind in ("DOUBLE", "FLOAT")
        or kind.startswith("DECIMAL")
        or (kind.endswith("INT") or kind == "INTEGER")
    )
