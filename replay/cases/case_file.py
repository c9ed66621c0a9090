"""``case.toml``: what belongs to a case, who examines it, and what is known beside the logs.

Names of files are relative to the case's own. Nothing of it comes from a clock: dates are those
that people gave.
"""

from __future__ import annotations

import datetime as dt
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from recorders.annotated.provenance import provenance_of
from recorders.corrections import read_corrections
from recorders.errors import SourceError, UsageError
from recorders.log import LogReader
from recorders.toml_files import toml_bytes

SUFFIX = ".toml"
Text = Annotated[str, Meta(max_length=4000)]
Name = Annotated[str, Meta(min_length=1, max_length=1000)]
Point = tuple[float, float]


class CaseRecording(Struct, frozen=True, forbid_unknown_fields=True):
    """One recording of a case.

    Attributes:
        log: the annotated log.
        scene: the scene log that it was replayed from.
        source: what that was recorded from.
        corrections: what people corrected.
        start: wall clock of second 0, where the recording was made without a clock.
    """

    log: Name
    scene: Text = ""
    source: Text = ""
    corrections: Text = ""
    start: dt.datetime | None = None

    @property
    def name(self) -> str:
        """What answers call it: the log's name without its suffix."""
        return Path(self.log).stem

    def files(self) -> list[str]:
        """The files that it names."""
        named = (self.source, self.scene, self.corrections, self.log)
        return [name for name in named if name]


class CaseFile(Struct, frozen=True, forbid_unknown_fields=True):
    """A case.

    Attributes:
        recordings: at least one.
        title, reference: what it is called, and its number.
        examiner: who examines it.
        date: as it was given.
        note: a text about it.
        notes: the file of bookmarks and notes.
        files: further files that belong to it: exports, reports.
        zones: polygons of (x, y) in pixels, by name.
        lines: (x1, y1), (x2, y2) in pixels, by name.
    """

    recordings: Annotated[list[CaseRecording], Meta(min_length=1)]
    title: Text = ""
    reference: Text = ""
    examiner: Text = ""
    date: dt.date | None = None
    note: Text = ""
    notes: Text = ""
    files: list[Name] = []
    zones: dict[str, Annotated[list[Point], Meta(min_length=3)]] = {}
    lines: dict[str, tuple[Point, Point]] = {}

    @property
    def day(self) -> str:
        """The date as a text."""
        return "" if self.date is None else self.date.isoformat()

    def all_files(self) -> list[str]:
        """Every file that it names, each once, in order."""
        named = [name for r in self.recordings for name in r.files()]
        named += [*([self.notes] if self.notes else []), *self.files]
        return list(dict.fromkeys(named))


def is_case(path: str | Path) -> bool:
    """Whether a name is that of a case."""
    return Path(path).suffix.lower() == SUFFIX and Path(path).is_file()


def read_case(path: str | Path) -> CaseFile:
    """Read a case.

    Raises:
        SourceError: it is none; names the field. A log that it names is not there.
    """
    path = Path(path)
    try:
        found = msgspec.toml.decode(toml_bytes(path), type=CaseFile)
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path) from error
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:
        raise SourceError(f"not a case (see docs/desk.md): {error}", path) from error
    names = [r.name for r in found.recordings]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise SourceError(f"two recordings are called {twice!r}: rename a log", path)
    for name in found.all_files():
        optional = name == found.notes or name in {r.corrections for r in found.recordings}
        if not optional and not (path.parent / name).exists():
            raise SourceError(f"names {name}, which is not there", path)
    return found


def logs_of(path: str | Path, case: CaseFile) -> list[Path]:
    """The annotated logs of a case."""
    return [Path(path).parent / r.log for r in case.recordings]


def chosen(path: str | Path, case: CaseFile, name: str | None) -> CaseRecording:
    """The recording that is meant.

    Raises:
        UsageError: there are several and none was named, or none of that name.
    """
    there = ", ".join(r.name for r in case.recordings)
    if name is None:
        if len(case.recordings) > 1:
            raise UsageError(f"{path}: several recordings ({there}); give --recording NAME")
        return case.recordings[0]
    for recording in case.recordings:
        if recording.name == name:
            return recording
    raise UsageError(f"--recording {name}: {path} has {there}")


def not_applied(path: str | Path, case: CaseFile) -> list[str]:
    """A line for each log that was not made with its corrections as they are now."""
    said = []
    for r in case.recordings:
        file = Path(path).parent / r.corrections
        if not r.corrections or not file.exists():
            continue
        with LogReader(Path(path).parent / r.log) as log:
            made = provenance_of(log).corrections
        now = read_corrections(file)
        if now.rows and (made is None or made.digest != now.digest):
            said.append(
                f"{r.log} was not made with {r.corrections} as it is now: replay it with"
                f" --corrections {r.corrections}"
            )
    return said
