"""Numbers in sentences."""

from __future__ import annotations


def count_of(count: int, name: str) -> str:
    """How many of what.

    >>> count_of(1, "frame"), count_of(0, "frame")
    ('1 frame', '0 frames')
    """
    return f"{count} {name}{'s' if count != 1 else ''}"
