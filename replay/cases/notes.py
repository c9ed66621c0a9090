"""Bookmarks and notes of a case, one JSON document a line; lines are only ever added."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta, Struct

from recorders.errors import SourceError
from replay.export.output import whole_file

_MOST_BYTES = 16 << 20


class Note(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A bookmark, with a text or without.

    Attributes:
        recording: whose frame.
        frame, t: where; t in seconds from the recording's start.
        text: what is noted.
        by: who noted it.
        date: as it was given.
    """

    recording: Annotated[str, Meta(max_length=1000)]
    frame: Annotated[int, Meta(ge=0)]
    t: float
    text: Annotated[str, Meta(max_length=4000)] = ""
    by: Annotated[str, Meta(max_length=1000)] = ""
    date: Annotated[str, Meta(max_length=100)] = ""


def read_notes(path: str | Path) -> list[Note]:
    """The notes of a file; none where it is not there yet.

    Raises:
        SourceError: a line is no note.
    """
    path = Path(path)
    if not path.exists():
        return []
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise SourceError(f"over {_MOST_BYTES} bytes: no file of notes", path)
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path) from error
    except UnicodeDecodeError as error:
        raise SourceError("not UTF-8: no file of notes", path) from error
    notes = []
    for number, line in enumerate(text.split("\n"), 1):
        if not line.strip():
            continue
        try:
            notes.append(msgspec.json.decode(line.encode(), type=Note))
        except (msgspec.MsgspecError, RecursionError) as error:
            raise SourceError(f"no note: {error}", path, number) from error
    return notes


def add_note(path: str | Path, note: Note) -> None:
    """Add a note to a file, whole or not at all."""
    notes = [*read_notes(path), note]
    with whole_file(path, force=True) as file:
        for each in notes:
            file.write(msgspec.json.encode(each) + b"\n")
