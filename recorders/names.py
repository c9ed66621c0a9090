"""Names of pictures and files by the numbers in them."""

from __future__ import annotations

import re
from pathlib import Path

_DIGITS = re.compile(r"(\d+)")


def by_number(name: str) -> tuple[list[tuple[int, str]], str]:
    """A key that orders names by the numbers in them: ``2.jpg`` before ``10.jpg``."""
    parts = _DIGITS.split(Path(name).stem)
    return [
        (int(part), "") if index % 2 else (0, part) for index, part in enumerate(parts)
    ], name
