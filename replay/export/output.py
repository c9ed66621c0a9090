"""Outputs that appear whole or not at all."""

from __future__ import annotations

import io
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, TextIO

from recorders.errors import OutputExistsError, UsageError
from recorders.log.output import PartFile

if TYPE_CHECKING:
    from typing_extensions import Buffer

FIGURES = (".png", ".pdf", ".svg")


def check_figure(path: Path) -> None:
    """Refuse a figure of another kind, before anything is computed or written.

    Raises:
        UsageError: the name does not end in one of `FIGURES`.
    """
    if path.suffix.lower() not in FIGURES:
        raise UsageError(f"{path}: a figure's name must end in .png, .pdf or .svg")


@contextmanager
def whole_file(path: str | Path, *, force: bool) -> Iterator[PartFile]:
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


def check_folder(path: Path, mark: str | None, *, force: bool) -> None:
    """That a folder may be written: it is not there, or empty, or was written by us and ``force``
    is set.

    Args:
        path: the folder.
        mark: a file that every folder of this sort holds; None: any folder will do.
        force: whether an older one may be written into.

    Raises:
        OutputExistsError: it holds something, and ``force`` is not set.
        UsageError: it is no folder, or one of somebody else's.
    """
    if path.exists() and not path.is_dir():
        raise UsageError(f"{path}: is there and no folder; give another name")
    if not path.is_dir() or not (held := sorted(p.name for p in path.iterdir())):
        return
    if not force:
        raise OutputExistsError(path)
    if mark is not None and mark not in held:
        raise UsageError(
            f"{path}: holds {held[0]!r} and no {mark}, so it is no folder of ours; give"
            " another name"
        )


@contextmanager
def whole_text(path: str | Path, *, force: bool) -> Iterator[TextIO]:
    """`whole_file`, to be written as text: UTF-8, newlines as they are given."""
    with (
        whole_file(path, force=force) as file,
        io.TextIOWrapper(
            io.BufferedWriter(_Sink(file)), encoding="utf-8", newline=""
        ) as text,
    ):
        yield text


class _Sink(io.RawIOBase):
    """A part file as a stream."""

    def __init__(self, file: PartFile) -> None:
        self._file = file

    def writable(self) -> bool:
        return True

    def write(self, data: Buffer, /) -> int:
        view = memoryview(data)
        self._file.write(view)
        return view.nbytes


@contextmanager
def whole_folder(
    path: Path, mark: str | None, *, force: bool = False, stale: Iterable[str] = ()
) -> Iterator[Path]:
    """A folder beside ``path`` to write into: its files get there when the block ends well, and
    none when it does not.

    A folder that is there already keeps its other files.

    Args:
        path: the folder.
        mark: a file that every folder of this sort holds; None: any folder will do.
        force: whether an older one of this sort may be written into.
        stale: what of an older one goes when its successor comes, relative to ``path``.

    Raises:
        OutputExistsError, UsageError: as `check_folder`; a folder in it is a link that leads out.
    """
    check_folder(path, mark, force=force)
    part = path.with_name(f"{path.name}.part")
    shutil.rmtree(part, ignore_errors=True)
    part.mkdir(parents=True)
    try:
        yield part
        if path.is_dir():
            # What is new comes first: names of what is old are another file's word, and one of
            # them may be no name.
            new = {file.relative_to(part) for file in part.rglob("*")}
            _move_into(part, path)
            _remove(path, [name for name in stale if Path(name) not in new])
        else:
            part.rename(path)
    finally:
        shutil.rmtree(part, ignore_errors=True)


def _move_into(part: Path, path: Path) -> None:
    root = path.resolve()
    for file in sorted(p for p in part.rglob("*") if p.is_file()):
        place = path / file.relative_to(part)
        if not place.parent.resolve().is_relative_to(root):
            raise UsageError(f"{place.parent}: leads out of {path}; remove it")
        place.parent.mkdir(parents=True, exist_ok=True)
        file.replace(place)


def _remove(path: Path, names: Iterable[str]) -> None:
    """Remove files below a folder, never one outside of it, and the folders that are empty then."""
    root = path.resolve()
    for name in names:
        file = path / name
        try:
            ours = file.parent.resolve().is_relative_to(root) and (
                file.is_file() or file.is_symlink()
            )
        except (OSError, ValueError):
            continue
        if not ours:
            continue
        file.unlink()
        if file.parent.resolve() != root and not any(file.parent.iterdir()):
            file.parent.rmdir()
