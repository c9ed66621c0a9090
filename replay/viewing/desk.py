"""What the served page asks for: any frame's boxes and picture, questions, notes, corrections."""

from __future__ import annotations

import threading
from bisect import bisect_right
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec

from reasoning.questions import Case
from reasoning.questions.literals import literal
from recorders.annotated.reader import AnnotatedLog
from recorders.closing import Closing
from recorders.corrections import Corrections
from recorders.errors import SceneTraceError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.pictures import encode_jpeg
from recorders.scene import SceneLog
from replay.cases.notes import Note, add_note, read_notes
from replay.cases.on_page import plain
from replay.correcting import Book, Wish, add, opened, take_back, written
from replay.correcting.making import TAKES
from replay.report.data import ReportOptions, collect, steps
from replay.report.html import page

_QUALITY = 88
_KEPT = 64
"""Pictures that are kept, as people go to and fro."""


class Desk(Closing):
    """One recording, open to be looked at.

    Args:
        path: the annotated log.
        camera: which camera, where there are several.
        corrections, notes: files that are read, and written where ``edit`` is set.
        edit: whether notes and corrections may be added.
        more: what a case adds to the page's data.
        limits: what the log may ask for.

    Raises:
        RecordingError: no annotated log, or a damaged one.
        SourceError, UsageError: the corrections are not of this log.
    """

    def __init__(
        self,
        path: Path,
        camera: str | None = None,
        *,
        corrections: Path,
        notes: Path,
        edit: bool = False,
        more: dict[str, Any] | None = None,
        limits: Limits = DEFAULT_LIMITS,
    ) -> None:
        self.path = path
        self.edit = edit
        self._corrections, self._notes = corrections, notes
        self._lock = threading.Lock()
        self._pictures: OrderedDict[int, bytes] = OrderedDict()
        self._log = AnnotatedLog(path, camera, limits)
        self._case = Case([path], log_limits=limits)
        self._scene = (
            SceneLog(path, self._log.camera, self._log.limits)
            if self._log.has_pictures
            else None
        )
        self._book: Book | None = None
        options = ReportOptions(thumbnails=0)
        self._data = collect(self._case, self._log, options) | (more or {})
        self._recording: str = self._data["recording"]
        self._name = literal(self._recording)
        self._stamps = {f.index: f.time_ns for f in self._log.frames(("tracks",))}
        self._frames = list(self._stamps)
        begun = self._log.start_ns
        self._times = {f: (stamp - begun) / 1e9 for f, stamp in self._stamps.items()}
        self._data["notes"] = plain(read_notes(notes), self._recording)

    def close(self) -> None:
        """Let go of the log."""
        self._case.close()
        self._log.close()
        if self._scene is not None:
            self._scene.close()

    def html(self) -> str:
        """The page as it is now."""
        with self._lock:
            now = self._now() if self.edit else {}
            server = {
                "api": "./",
                "pictures": self._scene is not None,
                "edit": self.edit,
                "takes": [
                    *([k, v] for k, v in TAKES.items()),
                    ["undo", "N: take one back"],
                ],
                **now,
            }
            notes = plain(read_notes(self._notes), self._recording)
            return page(self._data | {"server": server, "notes": notes})

    def _now(self) -> dict[str, Any]:
        """The corrections as they are in the file, and which of them the log was not made with."""
        found = opened(self._corrections, self._log)
        applied = {row[0] for row in self._data["corrections"]}
        undone = found.undone
        rows = [
            [
                r.correction,
                r.do,
                r.tracks,
                r.frame,
                r.t,
                r.told(),
                r.by,
                r.why,
                r.date,
                r.correction in undone,
            ]
            for r in found.rows
        ]
        pending = [r.correction for r in found.rows if r.correction not in applied]
        return {"corrections": rows, "pending": pending}

    def frame(self, number: int) -> dict[str, Any]:
        """A frame's boxes and edges: of the last one at or before a number."""
        if not self._frames:
            return {"error": "the log holds no frames"}
        found = self._frames[max(0, bisect_right(self._frames, number) - 1)]
        with self._lock:
            return steps(self._case, self._name, [found], self._times)[0]

    def picture(self, number: int) -> bytes | None:
        """A frame's picture as a JPEG of full size; None where there is none."""
        if self._scene is None or number not in self._times:
            return None
        with self._lock:
            if number in self._pictures:
                self._pictures.move_to_end(number)
                return self._pictures[number]
            frame = next(self._scene.frames(self._stamps[number], number), None)
            if frame is None or frame.image is None:
                return None
            data = self._pictures[number] = encode_jpeg(frame.image, _QUALITY)
            if len(self._pictures) > _KEPT:
                self._pictures.popitem(last=False)
            return data

    def note(self, body: Any) -> dict[str, Any]:
        """Add a note; the notes then."""

        def write() -> dict[str, Any]:
            note = msgspec.convert(body, Note)
            if note.recording != self._recording or note.frame not in self._times:
                raise UsageError(f"frame {note.frame} of {note.recording!r} is not here")
            add_note(self._notes, note)
            return {"notes": plain(read_notes(self._notes), self._recording)}

        return self._edited(write)

    def correct(self, body: Any) -> dict[str, Any]:
        """Add a correction; the corrections then."""

        def write() -> dict[str, Any]:
            asked = msgspec.convert(body, _AskedCorrection)
            if not asked.by.strip() or not asked.why.strip():
                raise UsageError("a correction says who made it and for what reason")
            made = self._made(asked, opened(self._corrections, self._log))
            written(made, self._corrections)
            last = made.rows[-1]
            return {
                "told": (
                    f"Correction {last.correction} is written into {self._corrections.name}:"
                    f" {last.told()}. scenetrace replay --corrections {self._corrections.name}"
                    " applies it."
                ),
                **self._now(),
            }

        return self._edited(write)

    def _made(self, asked: _AskedCorrection, found: Corrections) -> Corrections:
        by, why = asked.by.strip(), asked.why.strip()
        label = asked.do in ("label", "same")
        words = asked.words.split(maxsplit=1) if label else asked.words.split()
        if asked.do == "undo":
            if len(words) != 1 or not words[0].isdecimal():
                raise UsageError("undo takes the number of a correction")
            return take_back(found, int(words[0]), by, why, asked.date)
        kind = next((name for name in TAKES if name == asked.do), None)
        if kind is None:
            raise UsageError(f"no correction {asked.do!r}")
        if self._book is None:
            self._book = Book.of(self._log)
        whole = kind in ("rename", "same", "not-same")
        at = None if asked.frame is None or whole else self._times.get(asked.frame)
        return add(self._book, found, Wish(kind, words, by, why, at, date=asked.date))

    def _edited(self, write: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        if not self.edit:
            return {"error": "read only: start scenetrace view with --edit"}
        with self._lock:
            try:
                return write()
            except msgspec.ValidationError as error:
                return {"error": f"not understood: {error}"}
            except SceneTraceError as error:
                return {"error": str(error)}


class _AskedCorrection(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A correction as the page sends it."""

    do: str
    words: str
    by: str
    why: str
    frame: int | None = None
    date: str = ""
