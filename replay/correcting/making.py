"""A new correction, held against the log that it corrects before it is written."""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass

from msgspec.structs import replace

from recorders.corrections import Correction, Corrections, Kind
from recorders.errors import UsageError
from replay.correcting.book import Book
from replay.correcting.names import Names

_OTHER = re.compile(r"(?P<recording>.+):(?P<track>\d{1,10})")
TAKES: dict[Kind, str] = {
    "merge": "A B: target B is target A",
    "split": "A [NEW]: from --at on target A is another",
    "swap": "A B: from --at on A is B and B is A",
    "rename": "A NEW: target A gets another number",
    "delete": "A: target A is nobody",
    "label": "A TEXT: what target A is called",
    "same": "A RECORDING:ID: target A is a target of another recording",
    "not-same": "A B: targets A and B are two",
}
"""What each correction takes, and does."""


@dataclass(frozen=True)
class Wish:
    """A correction as a person gives it.

    Attributes:
        do: what is to be done.
        words: whom it is about, and the rest, as given.
        at, until: seconds from the recording's start; None: from the first, to the last frame.
        by, why, date: who says so, for what reason, when.
    """

    do: Kind
    words: Sequence[str]
    by: str
    why: str
    at: float | None = None
    until: float | None = None
    date: str = ""


def add(book: Book, corrections: Corrections, wish: Wish) -> Corrections:
    """The corrections with one more.

    Args:
        book: the log that is corrected.
        corrections: those that there are.
        wish: the new one.

    Raises:
        UsageError: it cannot be: who is not there, when, or why not.
    """
    now = _current(book, corrections, wish)
    taken = [track for row in corrections.rows for track in row.tracks]
    made = _Maker(now, wish, taken).made()
    if _undoes_a_join(book, made):
        _check_first_word(corrections, made)
    return corrections.then(made)


def _undoes_a_join(book: Book, row: Correction) -> bool:
    return row.do == "not-same" and row.tracks[1] not in book.tracks


def _check_first_word(corrections: Corrections, made: Correction) -> None:
    """That nothing was said of a target while a part was joined into it that is taken out now.

    Raises:
        UsageError: something was.
    """
    track, part = made.tracks
    for row in corrections.in_force:
        if track in row.tracks:
            raise UsageError(
                f"not-same {track} {part}: correction {row.correction} ({row.told()}) was made"
                f" while {part} was a part of target {track}: undo {row.correction} first, and"
                " say it again after a replay"
            )


def take_back(
    corrections: Corrections, number: int, by: str, why: str, date: str = ""
) -> Corrections:
    """The corrections with one taken back.

    Raises:
        UsageError: there is no such one in force, or later ones rest on it.
    """
    found = next((r for r in corrections.in_force if r.correction == number), None)
    if found is None:
        there = ", ".join(str(r.correction) for r in corrections.in_force) or "none"
        raise UsageError(
            f"undo {number}: no such correction is in force; there are: {there}"
        )
    for later in corrections.in_force:
        if later.correction > number and set(later.tracks) & set(found.tracks):
            raise UsageError(
                f"undo {number}: correction {later.correction} ({later.told()}) is about the"
                f" same target and was made after it; undo {later.correction} first"
            )
    return corrections.then(Correction(1, "undo", [], by, why, undone=number, date=date))


def _current(book: Book, corrections: Corrections, wish: Wish) -> Book:
    """The log's tracks as they are after all corrections, also those that it was not made with.

    Raises:
        UsageError: it was made with others, or what became of the targets is not known before it
            is replayed.
    """
    applied = 0
    if book.applied is not None:
        if not corrections.text.startswith(book.applied.text):
            raise UsageError(
                "the log was made with other corrections than those of the file: give the"
                " file that it was made with"
            )
        applied = len(book.applied.rows)
    pending = list(corrections.rows[applied:])
    numbers = {r.correction for r in pending}
    back = next((r for r in pending if r.do == "undo" and r.undone not in numbers), None)
    if back is not None:
        raise UsageError(
            f"correction {back.correction} takes back one that the log was made with: replay"
            " it first (scenetrace replay SCENE --corrections FILE), and correct the new log"
        )
    pending = [r for r in corrections.in_force if r.correction in numbers]
    named = {int(word) for word in wish.words if word.isdecimal()}
    for row in pending:
        if _undoes_a_join(book, row) and named & set(row.tracks):
            raise UsageError(
                f"correction {row.correction} ({row.told()}) undoes a join, and who goes on"
                " as whom then is known after a replay: replay first (scenetrace replay"
                " SCENE --corrections FILE), and correct the new log"
            )
    return book.under(Names(pending))


class _Maker:
    """Makes one correction."""

    def __init__(self, book: Book, wish: Wish, taken: Sequence[int]) -> None:
        self._book = book
        self._wish = wish
        self._taken = taken

    def made(self) -> Correction:
        """The correction, without its number.

        Raises:
            UsageError: it cannot be.
        """
        do = self._wish.do
        if do in ("merge", "swap"):
            return self._two()
        if do == "split":
            return self._split()
        if do == "rename":
            a, b = self._words(2)
            return self._row([self._known(a), self._free(b)], [int(a)], None)
        if do == "not-same":
            return self._not_same()
        return self._delete() if do == "delete" else self._said()

    def _said(self) -> Correction:
        """What is said of one target, in words."""
        a, text = self._words(2)
        track = self._known(a)
        if self._wish.do == "label":
            if not text.strip():
                raise self._error("label needs a text")
            frame = self._from([track])
            return replace(self._row([track], [track], frame), text=text.strip())
        match = _OTHER.fullmatch(text)
        if match is None:
            raise self._error(f"{text!r}: give the other as RECORDING:ID, like monday:12")
        return replace(self._row([track], [track], None), other=text)

    def _two(self) -> Correction:
        a, b = (self._known(word) for word in self._words(2))
        if a == b:
            raise self._error("give two different targets")
        swap = self._wish.do == "swap"
        frame = self._from([a, b] if swap else [b], needed=swap)
        if not swap:
            self._check_apart(a, b, frame or 0)
        return self._row([a, b], [a, b], frame)

    def _check_apart(self, a: int, b: int, frame: int) -> None:
        ours, theirs = (
            {f for f, seen in zip(p.frames, p.seen, strict=True) if seen and f >= start}
            for p, start in ((self._book.tracks[a], 0), (self._book.tracks[b], frame))
        )
        both = sorted(ours & theirs)
        if both:
            first, last = (self._book.times[f] for f in (both[0], both[-1]))
            raise self._error(
                f"targets {a} and {b} are both seen in {len(both)} frames, between"
                f" {first:.2f} and {last:.2f} s, so they are two; if one of them is"
                " somebody else there, swap or split it first; if it is nobody, delete it"
            )

    def _split(self) -> Correction:
        words = self._words(1, 2)
        track = self._known(words[0])
        given = words[1] if len(words) == 2 else str(self._next())
        frame = self._from([track], needed=True)
        assert frame is not None
        frames = self._book.tracks[track].frames
        if frame <= frames[0]:
            raise self._error(
                f"target {track} is there {self._book.span(track)}: a split lies after its"
                " first frame"
            )
        return self._row([track, self._free(given)], [track], frame)

    def _delete(self) -> Correction:
        track = self._known(self._words(1)[0])
        frame = self._from([track])
        until = self._frame(self._wish.until) if self._wish.until is not None else None
        if until is not None and until <= (frame or 0):
            raise self._error(f"--until {self._wish.until:g} is not after --at")
        return replace(self._row([track], [track], frame), until_frame=until)

    def _not_same(self) -> Correction:
        first, second = self._words(2)
        a = self._known(first)
        b = self._number(second)
        if b not in self._book.tracks and b not in self._book.joined.get(a, []):
            parts = ", ".join(map(str, self._book.joined.get(a, []))) or "none"
            raise self._error(
                f"there is no target {b}, and hindsight joined none of that number into"
                f" target {a} (it joined: {parts})"
            )
        if a == b:
            raise self._error("give two different targets")
        return self._row([a, b], [i for i in (a, b) if i in self._book.tracks], None)

    def _row(self, tracks: list[int], named: list[int], frame: int | None) -> Correction:
        """The row: of everybody named, where he was seen last before and first from ``frame``
        on, or first and last.
        """
        wish = self._wish
        if wish.until is not None and wish.do != "delete":
            raise self._error("--until is of delete alone")
        if frame is None and wish.at is not None:
            raise self._error(f"{wish.do} holds in all frames: it takes no --at")
        seen = []
        for track in named:
            there = self._book.tracks[track]
            # What is not joined any more may go on as another: only its beginning is known.
            at = [0, 0 if wish.do == "not-same" else len(there.frames) - 1]
            if frame is not None:
                place = bisect_left(there.frames, frame)
                at = [k for k in (place - 1, place) if 0 <= k < len(there.frames)]
            seen += [there.witness(track, k) for k in sorted(set(at))]
        t = None if frame is None else round(self._book.times[frame], 3)
        return Correction(
            1, wish.do, tracks, wish.by, wish.why, frame, t, date=wish.date, seen=seen
        )

    def _from(self, tracks: Sequence[int], needed: bool = False) -> int | None:
        """The first frame from --at on in which they are there; None without --at."""
        at = self._wish.at
        if at is None:
            if needed:
                raise self._error(f"{self._wish.do} needs a time: --at 12.4")
            return None
        frame = self._frame(at)
        for track in tracks:
            frames = self._book.tracks[track].frames
            place = bisect_left(frames, frame)
            if place == len(frames):
                raise self._error(
                    f"target {track} is not there at or after {at:.2f} s (it is there"
                    f" {self._book.span(track)})"
                )
            if len(tracks) == 1:
                frame = frames[place]
        return frame

    def _frame(self, t: float) -> int:
        found = self._book.frame_at(t)
        times = list(self._book.times.values())
        if found is None or t < times[0] - 0.0051:
            raise self._error(
                f"{t:g} s: the log's frames are from {times[0]:.2f} to {times[-1]:.2f} s"
            )
        return found

    def _known(self, word: str) -> int:
        track = self._number(word)
        if track not in self._book.tracks:
            there = sorted(self._book.tracks)
            some = ", ".join(map(str, there[:12])) + (" ..." if len(there) > 12 else "")
            raise self._error(f"there is no target {track}; there are {some or 'none'}")
        return track

    def _free(self, word: str) -> int:
        track = self._number(word)
        frames = self._book.tracks.get(track)
        if frames is not None or track in {
            i for j in self._book.joined.values() for i in j
        }:
            raise self._error(
                f"{track} is a target already; a free number is {self._next()}, and to make"
                " two one there is merge"
            )
        return track

    def _next(self) -> int:
        joined = [i for j in self._book.joined.values() for i in j]
        # A number that was somebody's in an earlier correction is not given to another.
        return max([0, *self._book.tracks, *joined, *self._taken]) + 1

    def _number(self, word: str) -> int:
        if not re.fullmatch(r"\d{1,9}", word):
            raise self._error(f"{word!r}: must be a target's number")
        return int(word)

    def _words(self, *counts: int) -> list[str]:
        if len(self._wish.words) not in counts:
            raise UsageError(f"{self._wish.do} takes {TAKES[self._wish.do]}")
        return list(self._wish.words)

    def _error(self, text: str) -> UsageError:
        named = " ".join([self._wish.do, *self._wish.words])
        return UsageError(f"{named}: {text}")
