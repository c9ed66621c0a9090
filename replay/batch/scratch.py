"""The folders in which jobs work until they are done."""

from __future__ import annotations

import shutil
import socket
from pathlib import Path


def work_of(process: int) -> str:
    """How the folders begin in which a process works; processes of other machines may share their
    place.
    """
    return f"job-{socket.gethostname()}-{process}-"


def clear(folder: Path, pattern: str = "*") -> None:
    """Remove what is in a folder, or of it what fits a pattern; another process may be at the same."""
    for left in folder.glob(pattern):
        if left.is_dir():
            shutil.rmtree(left, ignore_errors=True)
        else:
            left.unlink(missing_ok=True)
