"""One difference, and all of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from replay.plurals import count_of

CHANGES = ("appeared", "vanished", "moved", "changed")
KINDS = (
    "recording",
    "frames",
    "track",
    "identity",
    "event",
    "relation",
    "group",
    "encounter",
    "message",
)


@dataclass(frozen=True)
class Difference:
    """Something that is in one log and not, or not so, in the other.

    Attributes:
        what: one of `KINDS`; ``identity``: who it is, ``message``: a value that nobody's story
            shows.
        change: ``appeared`` (only in B), ``vanished`` (only in A), ``moved`` (in time or place)
            or ``changed``.
        frame: where it shows first.
        t: that frame's time in seconds from the recording's start.
        subjects: the tracks, by their ids in A (by their ids in B where A has no such track).
        text: in words.
        details: both sides' values.
    """

    what: str
    change: str
    frame: int
    t: float
    subjects: list[int]
    text: str
    details: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Comparison:
    """The verdict on two logs.

    Attributes:
        a, b: the files.
        identical: every annotated message is the same, byte for byte.
        frames: frames that both have.
        tracks: which track of B each track of A is.
        differences: in order of time.
        made: what differs in how the logs were made: tracker, parameters, versions. No difference
            by itself.
    """

    a: str
    b: str
    identical: bool
    frames: int
    tracks: dict[int, int]
    differences: list[Difference]
    made: list[str] = field(default_factory=list)

    @property
    def equal(self) -> bool:
        """Whether nothing differs beyond the tolerance; ids may."""
        return not self.differences

    def counts(self) -> dict[str, int]:
        """How many differences of each kind, as ``event vanished``, most first."""
        found: dict[str, int] = {}
        for difference in self.differences:
            key = f"{difference.what} {difference.change}"
            found[key] = found.get(key, 0) + 1
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    def lines(self, most: Sequence[Difference] | None = None) -> list[str]:
        """The comparison for a person: one line per difference, all in order of time or those that
        are given, then their number.
        """
        head = [
            line if line.startswith("correction") else f"made with another {line}"
            for line in self.made
        ]
        frames = count_of(self.frames, "frame")
        if self.identical:
            return [*head, f"identical: {frames}"]
        if self.equal:
            why = "track numbers, or values within the tolerance, differ"
            return [*head, f"equal in meaning over {frames}: {why}"]
        shown = self.differences if most is None else most
        rows = [
            f"frame {d.frame:>6} {d.t:>9.2f} s  {d.what:<9} {d.change:<8}  {d.text}"
            for d in shown
        ]
        if len(shown) < len(self.differences):
            rows.append(f"... and {len(self.differences) - len(shown)} more")
        counts = ", ".join(f"{count} {what}" for what, count in self.counts().items())
        total = f"{count_of(len(self.differences), 'difference')} over {frames}: {counts}"
        return [*head, *rows, total]

    def as_plain(self) -> dict[str, Any]:
        """Plain data for JSON."""
        tracks = {str(a): track for a, track in self.tracks.items()}
        return {
            **asdict(self),
            "tracks": tracks,
            "equal": self.equal,
            "counts": self.counts(),
        }
