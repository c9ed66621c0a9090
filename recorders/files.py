"""Files that are given to us: whether there is something to read, and its digest."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import BinaryIO

from recorders.errors import SourceError


def existing_file(path: Path) -> Path:
    """The path, if it is a file with something in it.

    Raises:
        SourceError: no such file, a folder, empty, or not readable.
    """
    try:
        with path.open("rb") as file:
            empty = not file.read(1)
    except FileNotFoundError:
        raise SourceError("no such file", path) from None
    except IsADirectoryError:
        raise SourceError("is a folder, a file is wanted", path) from None
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path) from error
    if empty:
        raise SourceError("the file is empty", path)
    return path


def open_to_read(path: Path) -> BinaryIO:
    """The file, open for reading bytes.

    Raises:
        SourceError: it cannot be opened.
    """
    try:
        return path.open("rb")
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path) from error


def sha256(path: Path) -> str:
    """The file's SHA-256, hexadecimal, read in pieces."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
