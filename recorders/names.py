"""Names of pictures and files by the numbers in them."""

from __future__ import annotations

import re
from pathlib import Path

_MOST_DIGITS = 18
_DIGITS = re.compile(r"(\d+)")


def whole(text: str) -> int | None:
    """The number of 1 to 18 digits that a text is, None for any other text: ``int`` takes signs,
    blanks, ``_`` and other scripts, and raises on thousands of digits.

    >>> whole("042"), whole("-1"), whole("\u00b2"), whole("9" * 5000)
    (42, None, None, None)
    """
    digits = text.isascii() and text.isdigit() and len(text) <= _MOST_DIGITS
    return int(text) if digits else None


def by_number(name: str) -> tuple[list[tuple[int, str]], str]:
    """A key that orders names by the numbers in them: ``2.jpg`` before ``10.jpg``."""
    parts = _DIGITS.split(Path(name).stem)
    return [
        (int(part), "") if index % 2 else (0, part) for index, part in enumerate(parts)
    ], name


def utf8(name: str) -> str:
    r"""A file's name as a log can hold it: bytes that are not UTF-8 are spelt out.

    >>> utf8("gate\udcff.avi")
    'gate\\udcff.avi'
    """
    return name.encode("utf-8", "backslashreplace").decode()
