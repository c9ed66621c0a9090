"""TOML that is given to us: no larger and no deeper than a person writes it."""

from __future__ import annotations

import re
from pathlib import Path

_MOST_BYTES = 1 << 20
_MOST_PARTS = 100
_BETWEEN_KEYS = re.compile(rb"[=,{}\[\]\n]")


def toml_bytes(path: Path) -> bytes:
    """What is in the file, once it is known that parsing it takes no time to speak of: the time
    grows as the square of the parts of a dotted key.

    Raises:
        OSError: it cannot be read.
        ValueError: it is too large, or a key has too many parts.
    """
    with path.open("rb") as file:
        data = file.read(_MOST_BYTES + 1)
    if len(data) > _MOST_BYTES:
        raise ValueError(f"it has over {_MOST_BYTES} bytes")
    if any(piece.count(b".") > _MOST_PARTS for piece in _BETWEEN_KEYS.split(data)):
        raise ValueError(f"a key has over {_MOST_PARTS} parts")
    return data
