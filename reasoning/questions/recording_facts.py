"""What is known of one camera of an annotated log as a whole: a row of ``recordings``."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from reasoning.questions.schema import TABLES
from recorders.errors import RecordingError

Row = tuple[Any, ...]
Sink = Callable[[str, Sequence[Row]], None]


@dataclass
class RecordingFacts:
    """What is known of one camera of an annotated log."""

    recording: str
    digest: str
    path: str
    camera: str
    tracker: str = ""
    width: int = 0
    height: int = 0
    frames: int = 0
    start_ns: int = 0
    seconds: float = 0.0
    output_digest: str = ""
    first_frame: int = 0

    def row(self) -> Row:
        """The row of ``recordings``."""
        return tuple(getattr(self, column) for column, _ in TABLES["recordings"])


def file_digest(path: str | Path) -> str:
    """SHA-256 of the file: what makes a recording the same recording.

    Raises:
        RecordingError: it cannot be read.
    """
    try:
        with Path(path).open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot be read: {error.strerror}", path) from error
