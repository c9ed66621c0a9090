"""Files of corrections beside the log that they are of."""

from __future__ import annotations

from pathlib import Path

from recorders.annotated.reader import AnnotatedLog
from recorders.corrections import (
    FORMAT,
    VERSION,
    Corrections,
    CorrectionsHeader,
    begun,
    read_corrections,
)
from recorders.errors import UsageError
from replay.export.output import whole_file


def opened(path: Path, log: AnnotatedLog) -> Corrections:
    """The corrections of a file, or a beginning where it is not there.

    Raises:
        SourceError: the file is no whole file of corrections.
        UsageError: it is of another camera or tracker.
    """
    if not path.exists():
        return begun(
            CorrectionsHeader(FORMAT, VERSION, log.path.name, log.camera, log.tracker)
        )
    found = read_corrections(path)
    theirs = found.head.camera, found.head.tracker
    if theirs != (log.camera, log.tracker):
        raise UsageError(
            f"{path}: is of camera {theirs[0]} and tracker {theirs[1]}, {log.path} is of"
            f" {log.camera} and {log.tracker}: their targets have other numbers; name another"
            " file"
        )
    return found


def written(corrections: Corrections, path: Path) -> None:
    """Write the file, whole or not at all."""
    with whole_file(path, force=True) as file:
        file.write(corrections.text.encode())
