"""What readers of documents share that are read whole."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from recorders.formats.boxes import BoxRow
from recorders.formats.readers import Bad, checked


class Document:
    """A document that is read whole: what the classes here share."""

    name = ""
    first_frame: int | None = 0
    is_certain = True

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        self.path = path
        self.size: tuple[int, int] | None = None
        self.notes: list[str] = []
        self._picture = size
        self._found: list[BoxRow] = []
        self.ignored: list[BoxRow] = []
        self._bad: list[tuple[str, str]] = []

    def _take(self, row: BoxRow, where: str) -> None:
        kept = checked(
            row, self.path, where, lambda what, why: self._bad.append((what, why))
        )
        if kept is not None:
            self._found.append(kept)

    def rows(self, bad: Bad) -> Iterator[BoxRow]:
        """See `recorders.formats.readers.RowReader`."""
        for what, where in self._bad:
            bad(what, where)
        yield from self._found

    def files(self) -> list[Path]:
        """See `recorders.formats.readers.RowReader`."""
        return [self.path]
