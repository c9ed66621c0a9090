"""Outputs that appear whole or not at all."""

from __future__ import annotations

import contextlib
import errno
import io
import os
import shutil
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, TextIO

from recorders.errors import OutputExistsError, RecordingError, UsageError
from recorders.log.output import PartFile, lock_folder, rename, sync_folder

if TYPE_CHECKING:
    from typing_extensions import Buffer

# Where the system names files relative to an open folder.
_BY_FOLDER = {os.open, os.mkdir, os.unlink, os.rmdir} <= os.supports_dir_fd
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
        RecordingError: another process writes it now, or what an interrupted one left is there
            and ``force`` is not set.
    """
    check_folder(path, mark, force=force)
    part = path.with_name(f"{path.name}.part")
    held = _part_folder(part, force=force)
    try:
        yield part
        if held is not None and not os.path.samestat(os.fstat(held), part.lstat()):
            raise UsageError(f"{part}: something else was put in its place")
        _sync(part)
        if path.is_dir():
            # What is new comes first: names of what is old are another file's word, and one of
            # them may be no name.
            new = {file.relative_to(part) for file in part.rglob("*")}
            _move_into(part, path)
            _remove(path, [name for name in stale if Path(name) not in new])
        else:
            rename(part, path)
        sync_folder(path.parent)
    finally:
        shutil.rmtree(part, ignore_errors=True)
        if held is not None:
            os.close(held)


def _part_folder(part: Path, *, force: bool) -> int | None:
    """Make the folder to write into, and lock it for this process: two writers cannot meet.

    Raises:
        RecordingError: another process has it, or it is there already and ``force`` is not set.
    """
    try:
        part.mkdir(parents=True)
    except FileExistsError:
        if not force or part.is_symlink():
            raise RecordingError(
                "exists already: another run is writing it, or one was interrupted; --force"
                " overwrites it",
                part,
            ) from None
        held = lock_folder(part)
        _empty(part)
        return held
    try:
        return lock_folder(part)
    except BaseException:
        with contextlib.suppress(OSError):
            part.rmdir()
        raise


def _empty(folder: Path) -> None:
    for path in folder.iterdir():
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def _sync(part: Path) -> None:
    """Have the system write all of a folder to the disk."""
    for file in sorted(part.rglob("*")):
        if file.is_dir():
            sync_folder(file)
        else:
            with file.open("rb+") as f:
                os.fsync(f.fileno())
    sync_folder(part)


def _move_into(part: Path, path: Path) -> None:
    for file in sorted(p for p in part.rglob("*") if p.is_file()):
        with _place(path, file.relative_to(part), make=True) as (folder, name):
            os.replace(file, name, dst_dir_fd=folder)


def _remove(path: Path, names: Iterable[str]) -> None:
    """Remove files below a folder, never one outside of it, and the folders that are empty then.

    The names are another file's word: what is no name of a file in there is passed over.
    """
    for inner in map(PurePath, names):
        if not inner.name or inner.is_absolute() or ".." in inner.parts:
            continue
        with contextlib.suppress(OSError, ValueError, UsageError):
            with _place(path, inner) as (folder, name):
                os.unlink(name, dir_fd=folder)
            if inner.parent.name:
                with _place(path, inner.parent) as (folder, name):
                    os.rmdir(name, dir_fd=folder)  # where it is empty


@contextmanager
def _place(
    root: Path, inner: PurePath, *, make: bool = False
) -> Iterator[tuple[int | None, str]]:
    """Where a file below ``root`` is, as ``dir_fd`` and name for `os`: folders are opened one in
    the other, so that no link leads out, not even one that is put there meanwhile.

    Raises:
        UsageError: one of the folders is a link, or no folder.
    """
    within = root / inner.parent
    refused = UsageError(f"{within}: leads out of {root}; remove it")
    if not _BY_FOLDER:
        if not within.resolve().is_relative_to(root.resolve()):
            raise refused
        if make:
            within.mkdir(parents=True, exist_ok=True)
        yield None, str(root / inner)
        return
    folder = os.open(root, os.O_RDONLY | os.O_DIRECTORY)
    try:
        for name in inner.parent.parts:
            if make:
                with contextlib.suppress(FileExistsError):
                    os.mkdir(name, dir_fd=folder)
            try:
                flags = os.O_RDONLY | os.O_DIRECTORY | os.O_NOFOLLOW
                inside = os.open(name, flags, dir_fd=folder)
            except OSError as error:
                if error.errno in (errno.ELOOP, errno.ENOTDIR):
                    raise refused from error
                raise
            os.close(folder)
            folder = inside
        yield folder, inner.name
    finally:
        os.close(folder)
