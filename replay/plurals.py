"""Numbers in sentences."""

from __future__ import annotations


def number(count: int, name: str) -> str:
    """How many of what.

    >>> number(1, "frame"), number(0, "frame")
    ('1 frame', '0 frames')
    """
    return f"{count} {name}{'s' if count != 1 else ''}"
