"""Cells of a row of text, whatever parts them, and whatever stands for the decimal point."""

from __future__ import annotations

import csv
import re

COMMENTS = ("#", "%", "//")
"""What lines begin with that are no rows."""
SPREADSHEET = re.compile(r"sep=.", re.IGNORECASE)
"""A first line by which a spreadsheet is told of the separator."""
_LEAST = 6
_DECIMAL = re.compile(r"[+-]?\d*,\d+")
_DECIMAL_WITHIN = re.compile(r"\d,\d")


def separator_of(text: str) -> str | None:
    r"""What parts the cells of a row: ``;``, ``|``, ``,``, a comma and a blank, a tab; None: blanks.

    >>> separator_of("1;1;2,5;3"), separator_of("1, 1, 2,5, 3,5, 4,0, 5,5"), separator_of("1 2")
    (';', ', ', None)
    """
    if ";" in text:
        return ";"
    if "|" in text and "," not in text.split("|", 1)[0]:
        return "|"
    for separator in ("\t", ", ", None):
        cells = [pointed(cell) for cell in text.split(separator)]
        decimal = _DECIMAL_WITHIN.search(text)
        if decimal and len(cells) >= _LEAST and all(map(is_number, cells)):
            return separator  # the commas are decimal points
    if "," in text:
        return ","
    return "\t" if "\t" in text else None


def cells_of(text: str, separator: str | None) -> list[str]:
    """A row's cells, without blanks and quotes around them, with decimal points."""
    if '"' in text and separator is not None:
        cells = next(csv.reader([text], delimiter=separator[0]))
        return [pointed(cell.strip()) for cell in cells]
    if separator == ";":
        # Where commas do not separate, they are decimal points.
        return [cell.strip().replace(",", ".") for cell in text.rstrip(";").split(";")]
    if separator is None:
        return [pointed(cell) for cell in text.split()]
    if separator != ",":
        return [pointed(cell.strip()) for cell in text.split(separator)]
    cells = [cell.strip().strip('"') for cell in text.split(separator)]
    return cells[:-1] if cells and not cells[-1] and len(cells) > _LEAST else cells


def pointed(cell: str) -> str:
    """A number with a decimal point."""
    return cell.replace(",", ".") if _DECIMAL.fullmatch(cell) else cell


def is_number(cell: str) -> bool:
    """Whether a cell's text is a number (also one that is not finite)."""
    try:
        float(cell)
    except ValueError:
        return False
    return "_" not in cell
