"""A case: one file that names its logs, corrections, zones, notes, examiner and times."""

from replay.cases.case_file import CaseFile, CaseRecording, is_case, read_case
from replay.cases.notes import Note, add_note, read_notes

__all__ = [
    "CaseFile",
    "CaseRecording",
    "Note",
    "add_note",
    "is_case",
    "read_case",
    "read_notes",
]
