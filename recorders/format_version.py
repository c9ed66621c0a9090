"""The version of the logs that are written, and what becomes of a log of another one."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from recorders.errors import RecordingError

FORMAT_VERSION = "1"
RECORDS = ("scenetrace", "scenetrace.started", "scenetrace.recording")
"""Metadata records that say the version of a scene log or an annotated log."""


def check_version(records: Iterable[tuple[str, Mapping[str, str]]], path: Path) -> None:
    """Hold what a log says of its version against the one that is read here.

    A log by others says none, and is read for what it holds.

    Raises:
        RecordingError: it is of another version.
    """
    for name, values in records:
        said = values.get("format_version", FORMAT_VERSION)
        if name in RECORDS and said != FORMAT_VERSION:
            raise RecordingError(
                f"a log of format {said!r}; this scenetrace reads {FORMAT_VERSION!r}: read it"
                " with the version that wrote it, or record its source anew",
                path,
            )
