"""A person's corrections of tracks, as a file that people read and sign: one JSON document a line.

The first line says of which recording and tracker they are. Each further line is one correction:
what is done, to whom, from when on, by whom and why, and where those whom it names were seen, so
that a replay that numbers its tracks otherwise is found out. Lines are only ever added: an
``undo`` takes an earlier one back and leaves it to be read. Each bears the digest of all lines
before it, so that one that is taken out or altered is found.

Corrections are applied in order; the ids of each are those after the corrections before it.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, TypeVar

import msgspec
from msgspec import Meta, Struct

from recorders.errors import SourceError

FORMAT: Literal["corrections"] = "corrections"
VERSION: Literal[1] = 1
MEDIA = "application/x-ndjson"
_MOST_BYTES = 4 << 20
_DIGITS = 16

T = TypeVar("T")
Kind = Literal[
    "merge", "split", "swap", "rename", "delete", "label", "same", "not-same", "undo"
]
Id = Annotated[int, Meta(ge=0, le=2**31 - 1)]
Text = Annotated[str, Meta(max_length=2000)]
Words = Annotated[str, Meta(min_length=1, max_length=2000)]


class CorrectionsHeader(
    Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True
):
    """The first line.

    Attributes:
        scenetrace, version: what the file is.
        recording: the corrected log's file name, for people.
        camera: whose tracks.
        tracker: the tracker that numbered them.
    """

    scenetrace: Literal["corrections"]
    version: Literal[1]
    recording: Text
    camera: Text
    tracker: Text


class CorrectedSighting(Struct, frozen=True, array_like=True):
    """Where a track was in a frame: id, frame, box in pixels to a tenth."""

    track: Id
    frame: Annotated[int, Meta(ge=0)]
    x: float
    y: float
    w: float
    h: float


class Correction(Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """One correction.

    Attributes:
        correction: its number, from 1.
        do: what is done.
        tracks: whom it is about, by their ids after the corrections before it. ``merge``: the
            second becomes the first. ``split``: the second is the id from ``frame`` on.
            ``swap``: the two change places. ``rename``: from and to. Others: whom it names.
        by: who says so.
        why: the reason.
        frame: the first frame that it holds in; left out: it holds in all.
        t: that frame's time in seconds from the recording's start, for people.
        until_frame: of ``delete``: the first frame that it does not hold in any more.
        text: of ``label``: what the target is called.
        other: of ``same``: a target of another recording, as RECORDING:ID.
        undone: of ``undo``: the number of the correction that is taken back.
        date: as it was given; no clock is asked.
        seen: where they were, to know them by.
        after: digest of all lines before.
    """

    correction: Annotated[int, Meta(ge=1)]
    do: Kind
    tracks: list[Id]
    by: Words
    why: Words
    frame: Annotated[int, Meta(ge=0)] | None = None
    t: float | None = None
    until_frame: Annotated[int, Meta(ge=0)] | None = None
    text: Text = ""
    other: Text = ""
    undone: Annotated[int, Meta(ge=1)] | None = None
    date: Text = ""
    seen: list[CorrectedSighting] = []
    after: Text = ""

    def told(self) -> str:
        """What is done, in words.

        >>> Correction(1, "merge", [3, 7], "Jo", "same coat", 87, 12.4).told()
        'target 7 is target 3 from 12.40 s on'
        """
        a, b = [*self.tracks, 0, 0][:2]
        whole = "" if self.t is None else f" from {self.t:.2f} s on"
        return {
            "merge": f"target {b} is target {a}{whole}",
            "split": f"target {a} is another{whole}: target {b}",
            "swap": f"targets {a} and {b} have one another's numbers{whole}",
            "rename": f"target {a} is called {b}",
            "delete": f"target {a} is nobody{whole}{self._until()}",
            "label": f"target {a} is {self.text!r}{whole}",
            "same": f"target {a} is {self.other}",
            "not-same": f"targets {a} and {b} are two",
            "undo": f"correction {self.undone} is taken back",
        }[self.do]

    def _until(self) -> str:
        return "" if self.until_frame is None else f" until frame {self.until_frame}"


@dataclass(frozen=True)
class Corrections:
    """A file of corrections.

    Attributes:
        head: its first line.
        rows: the corrections, in order.
        text: the file as it is, UTF-8.
    """

    head: CorrectionsHeader
    rows: tuple[Correction, ...]
    text: str

    @property
    def digest(self) -> str:
        """SHA-256 of the file's bytes."""
        return hashlib.sha256(self.text.encode()).hexdigest()

    def summary(self) -> str:
        """How many there are, by whom, and the file's digest, in words."""
        names = ", ".join(dict.fromkeys(row.by for row in self.rows)) or "nobody"
        force = len(self.in_force)
        return (
            f"{force} in force of {len(self.rows)} lines, by {names}; SHA-256 {self.digest}"
        )

    @property
    def undone(self) -> dict[int, Correction]:
        """By the number of each correction that is taken back: what takes it back."""
        return {row.undone: row for row in self.rows if row.undone is not None}

    @property
    def in_force(self) -> list[Correction]:
        """Those that are applied: neither taken back nor a taking back."""
        gone = self.undone
        return [row for row in self.rows if row.do != "undo" and row.correction not in gone]

    def then(self, row: Correction) -> Corrections:
        """With one more, which gets its number and the digest of what stands before it."""
        made = msgspec.structs.replace(
            row, correction=len(self.rows) + 1, after=_after(self.text)
        )
        return Corrections(self.head, (*self.rows, made), self.text + _line(made))


def begun(head: CorrectionsHeader) -> Corrections:
    """A file without corrections yet."""
    return Corrections(head, (), _line(head))


def read_corrections(path: str | Path) -> Corrections:
    """Read a file of corrections.

    Raises:
        SourceError: it is none, or altered; names the line.
    """
    path = Path(path)
    try:
        if path.stat().st_size > _MOST_BYTES:
            raise SourceError(
                f"over {_MOST_BYTES} bytes: no file of `scenetrace correct`", path
            )
        text = path.read_bytes().decode("utf-8")
    except OSError as error:
        raise SourceError(f"cannot be read: {error.strerror}", path) from error
    except UnicodeDecodeError as error:
        raise SourceError("not UTF-8: no file of `scenetrace correct`", path) from error
    return parse_corrections(text, path)


def parse_corrections(text: str, path: str | Path) -> Corrections:
    """Corrections from a file's text.

    Raises:
        SourceError: it is none, or altered; names the line.
    """
    lines = [f"{line}\n" for line in text.split("\n")]
    if lines.pop() != "\n" or not lines:
        raise SourceError(
            "empty, or cut off in its last line: no whole file of `scenetrace correct`",
            path,
        )
    head = _decoded(lines[0], CorrectionsHeader, path, 1)
    rows: list[Correction] = []
    for number, line in enumerate(lines[1:], 2):
        row = _decoded(line, Correction, path, number)
        before = "".join(lines[: number - 1])
        if row.correction != len(rows) + 1 or row.after != _after(before):
            raise SourceError(
                f"correction {row.correction} was not written after the lines before it:"
                " a line was altered, taken out or put in; corrections are only added, with"
                " `scenetrace correct`, and taken back with its `undo`",
                path,
                number,
            )
        _check(row, rows, path, number)
        rows.append(row)
    return Corrections(head, tuple(rows), text)


_TRACKS = {
    "merge": 2, "split": 2, "swap": 2, "rename": 2, "delete": 1, "label": 1, "same": 1,
    "not-same": 2, "undo": 0,
}  # fmt: skip


def _check(row: Correction, before: list[Correction], path: str | Path, line: int) -> None:
    wrong = ""
    if len(row.tracks) != _TRACKS[row.do] or len(set(row.tracks)) < len(row.tracks):
        wrong = f"{row.do} names {_TRACKS[row.do]} different tracks, not {row.tracks}"
    elif row.do in ("split", "swap") and row.frame is None:
        wrong = f"{row.do} needs a frame"
    elif row.do == "label" and not row.text:
        wrong = "label needs a text"
    elif row.do == "same" and not row.other:
        wrong = "same needs RECORDING:ID of the other"
    elif row.do == "undo" and not any(b.correction == row.undone for b in before):
        wrong = f"takes back correction {row.undone}, which does not stand before it"
    if wrong:
        raise SourceError(wrong, path, line)


def _line(row: Struct) -> str:
    return msgspec.json.encode(row).decode() + "\n"


def _after(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:_DIGITS]


def _decoded(line: str, kind: type[T], path: str | Path, number: int) -> T:
    try:
        return msgspec.json.decode(line.encode(), type=kind)
    except (msgspec.MsgspecError, RecursionError) as error:
        what = "no file of `scenetrace correct`" if number == 1 else "no correction"
        raise SourceError(f"{what}: {error}", path, number) from error
