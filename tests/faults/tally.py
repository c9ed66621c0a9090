"""What a kind of fault did, counted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class Tally:
    """One row of the table.

    Attributes:
        kind: of fault.
        tries: how many.
        survived: the output or answer was whole, or there was one clear error and nothing half.
        lost: what should have survived did not (half an output, whole chunks not recovered).
        silent: an answer that differs, without a word.
        foreign: an exception that is none of ours.
        notes: the first of each that went wrong.
    """

    kind: str
    tries: int = 0
    survived: int = 0
    lost: int = 0
    silent: int = 0
    foreign: int = 0
    notes: list[str] = field(default_factory=list)

    def note(self, text: str) -> None:
        """Keep what went wrong, the first of them."""
        if len(self.notes) < 20:
            self.notes.append(text)

    @property
    def clean(self) -> bool:
        """Whether nothing went wrong."""
        return not (self.lost or self.silent or self.foreign)

    def row(self) -> str:
        """As a row of Markdown."""
        return (
            f"| {self.kind} | {self.tries} | {self.survived} | {self.lost} | {self.silent} |"
            f" {self.foreign} |"
        )


def summed(kind: str, tallies: Sequence[Tally]) -> Tally:
    """All of them as one."""
    return Tally(
        kind,
        sum(t.tries for t in tallies),
        sum(t.survived for t in tallies),
        sum(t.lost for t in tallies),
        sum(t.silent for t in tallies),
        sum(t.foreign for t in tallies),
    )


def added(before: Tally | None, now: Tally) -> Tally:
    """Two runs of one row."""
    if before is None:
        return now
    both = summed(now.kind, [before, now])
    both.notes = (before.notes + now.notes)[:20]
    return both


HEAD = "| kind | tries | survived | lost | silent | foreign exceptions |\n|---|---|---|---|---|---|"
