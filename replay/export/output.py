"""Outputs that appear whole or not at all."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from recorders.errors import UsageError
from recorders.log.output import PartFile

FIGURES = (".png", ".pdf", ".svg")


def check_figure(path: Path) -> None:
    """Refuse a figure of another kind, before anything is computed or written.

    Raises:
        UsageError: the name does not end in one of `FIGURES`.
    """
    if path.suffix.lower() not in FIGURES:
        raise UsageError(f"{path}: a figure's name must end in .png, .pdf or .svg")


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


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """A folder beside ``path`` to write into: its files get there when the block ends well, and none when it does not.

    A folder that is there already keeps its other files.
    """
    part = path.with_name(f"{path.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        yield part
        if path.is_dir():
            for file in sorted(part.iterdir()):
                file.replace(path / file.name)
        else:
            part.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)
