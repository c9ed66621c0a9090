"""Outputs that appear whole or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recorders.log.output import PartFile


@contextmanager
def whole(path: str | Path, *, force: bool) -> Iterator[PartFile]:
    """A file that gets its name when the block ends well, and is gone when it does not.

    Write with its ``write``, or let a library write to the path ``part``.

    Raises:
        OutputExistsError: it exists and ``force`` is not set.
    """
    out = PartFile(path, force=force)
    try:
        yield out
        out.finish()
    finally:
        out.discard()
