"""What a case adds to the page of one of its recordings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from msgspec import to_builtins

from replay.cases.case_file import CaseFile, CaseRecording
from replay.cases.notes import Note, read_notes


def of_recording(path: Path, case: CaseFile, recording: CaseRecording) -> dict[str, Any]:
    """Title, examiner, notes and clock, as the page takes them."""
    notes = read_notes(path.parent / case.notes) if case.notes else []
    more: dict[str, Any] = {
        "case": {
            "title": case.title,
            "reference": case.reference,
            "examiner": case.examiner,
            "date": case.day,
            "note": case.note,
        },
        "notes": plain(notes, recording.name),
    }
    if recording.start is not None:
        offset = recording.start.utcoffset()
        more["start_ms"] = round(recording.start.timestamp() * 1000)
        more["zone_minutes"] = 0 if offset is None else round(offset.total_seconds() / 60)
    return more


def plain(notes: list[Note], recording: str) -> list[Any]:
    """The notes of a recording as plain data, every field there."""
    empty = {"text": "", "by": "", "date": ""}
    return [empty | to_builtins(n) for n in notes if n.recording == recording]
