"""An output file that appears whole or not at all: written as ``<name>.part``, renamed when it is
complete.
"""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from recorders.errors import OutputExistsError, RecordingError

try:
    import fcntl
except (
    ImportError
):  # not a POSIX system: an exclusive part file is all the protection there
    fcntl = None  # type: ignore[assignment]


PART_SUFFIX = ".part"


class PartFile:
    """Writes ``<path><suffix>``; `finish` makes it ``path`` (fsync, rename, fsync of the folder),
    `discard` removes it.

    ``path`` is never overwritten without ``force``: checked at the start, and again by the rename
    itself. Two writers of one output cannot meet: the part file is created exclusively and locked
    while it is written. A part file that an interrupted run left is kept as it is, unless
    ``force`` is given.

    Raises:
        OutputExistsError: ``path`` exists.
        RecordingError: it cannot be written; a full disk says so.
    """

    def __init__(
        self, path: str | Path, *, force: bool = False, suffix: str = PART_SUFFIX
    ) -> None:
        self.path = Path(path)
        self.part = self.path.with_name(self.path.name + suffix)
        self._force = force
        if self.path.is_dir():
            raise RecordingError("this is a folder; name a file to write", self.path)
        if not force and _exists(self.path):
            raise OutputExistsError(self.path)
        self._descriptor: int | None = self._open()

    def _open(self) -> int:
        flags = (
            os.O_WRONLY
            | os.O_CREAT
            | getattr(os, "O_BINARY", 0)
            | getattr(os, "O_CLOEXEC", 0)
            # Who may write into the folder must not choose by a link what is written over.
            | getattr(os, "O_NOFOLLOW", 0)
        )
        ours = True
        try:
            try:
                descriptor = os.open(self.part, flags | os.O_EXCL, 0o666)
            except FileExistsError:
                if not self._force:
                    raise
                ours = False
                descriptor = os.open(self.part, flags, 0o666)
        except FileExistsError as error:
            raise self._occupied() from error
        except OSError as error:
            raise self._failure(error) from error
        if not lock(descriptor):
            os.close(descriptor)
            raise RecordingError("another process is writing it now", self.part)
        try:
            if os.fstat(descriptor).st_nlink > 1:
                # A run was killed between the output's two names (`take_name`): it is the output.
                fresh = self._anew(flags)
                os.close(descriptor)
                return fresh
            os.ftruncate(descriptor, 0)
        except OSError as error:
            if ours:
                with contextlib.suppress(OSError):
                    self.part.unlink()
            os.close(descriptor)
            raise self._failure(error) from error
        return descriptor

    def _anew(self, flags: int) -> int:
        """A part file in place of one that has other names, which keep what is in it."""
        self.part.unlink()
        descriptor = os.open(self.part, flags | os.O_EXCL, 0o666)
        lock(descriptor)
        return descriptor

    def _occupied(self) -> RecordingError:
        return RecordingError(
            "exists already: another run is writing it, or one was interrupted;"
            f" `scenetrace recover {self.part} -o NEW` keeps what is whole in it, --force"
            " overwrites it",
            self.part,
        )

    def _failure(self, error: OSError) -> RecordingError:
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            return RecordingError("the disk is full", self.path)
        if error.errno == errno.ELOOP:
            return RecordingError(
                "cannot be written: it is a link to another file; remove it", self.part
            )
        if error.errno == errno.ENOENT:
            return RecordingError(
                f"cannot be written: there is no folder {self.path.parent}", self.path
            )
        return RecordingError(f"cannot be written: {error.strerror or error}", self.path)

    @property
    def is_open(self) -> bool:
        """It can still be written."""
        return self._descriptor is not None

    def write(self, data: bytes | bytearray | memoryview) -> None:
        """Append ``data``: handed to the system at once, so that a killed process loses none of
        it.
        """
        if self._descriptor is None:
            raise RecordingError("is closed already", self.path)
        view = memoryview(data)
        try:
            while view:
                view = view[os.write(self._descriptor, view) :]
        except OSError as error:
            raise self._failure(error) from error

    def finish(self) -> None:
        """Make the part file the output."""
        if self._descriptor is None:
            raise RecordingError("is closed already", self.path)
        try:
            os.fsync(self._descriptor)
            self._rename()
            self._close()
            sync_folder(self.path.parent)
        except OSError as error:
            raise self._failure(error) from error

    def _rename(self) -> None:
        if self._force:
            rename(self.part, self.path)
            return
        try:
            take_name(self.part, self.path)
        except FileExistsError as error:
            raise OutputExistsError(self.path) from error

    def discard(self, *, keep: bool = False) -> None:
        """Stop writing; remove the part file unless ``keep``. Does nothing once it is closed."""
        if self._descriptor is None:
            return
        if not keep:
            with contextlib.suppress(OSError):
                self.part.unlink()
        self._close()

    def _close(self) -> None:
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            os.close(descriptor)


def take_name(part: Path, path: Path) -> None:
    """Give ``part`` the name ``path``, unless something has it.

    A server of files may do what it is asked, lose its answer, and refuse when it is asked again:
    what counts is what is there.

    Raises:
        FileExistsError: something has it.
        OSError: it cannot be renamed.
    """
    try:
        os.link(part, path)  # unlike a rename, this fails where the name exists
    except OSError:
        if not _same(part, path):
            if _exists(path):
                raise FileExistsError(path) from None
            rename(part, path)  # a file system without hard links
            return
    part.unlink()


def rename(part: Path, path: Path) -> None:
    """Rename a file, or a folder to where none is; one that is told to have failed and has not,
    has not.

    Raises:
        OSError: it cannot be renamed.
    """
    held = part.stat()
    try:
        part.replace(path)
    except OSError:
        if _exists(part) or not _exists(path) or not os.path.samestat(held, path.stat()):
            raise


def _same(a: Path, b: Path) -> bool:
    """Whether both are names of one file, and no links."""
    try:
        return os.path.samestat(a.lstat(), b.lstat())
    except OSError:
        return False


def sync_folder(path: Path) -> None:
    """Have the system write the names in a folder to the disk, where it can open folders."""
    if not hasattr(os, "O_DIRECTORY"):
        return
    folder = os.open(path, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def lock_folder(folder: Path) -> int | None:
    """Lock a folder for this process alone until the descriptor is closed.

    Returns:
        The descriptor; None where the system cannot open folders.

    Raises:
        RecordingError: another process has it.
    """
    if not hasattr(os, "O_DIRECTORY"):
        return None
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    if not lock(descriptor):
        os.close(descriptor)
        raise RecordingError("another process adds to it now; try again later", folder)
    return descriptor


def lock(descriptor: int) -> bool:
    """Lock an open file or folder for this process alone; false where another one has it. Where
    the system or the file system knows no locks, true.
    """
    if fcntl is not None:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return False
        except OSError:
            pass
    return True


def _exists(path: Path) -> bool:
    """Something has that name, be it a dangling link."""
    return os.path.lexists(path)
