"""One difference, and all of them."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

CHANGES = ("appeared", "vanished", "moved", "changed")


@dataclass(frozen=True)
class Difference:
    """Something that is in one log and not, or not so, in the other.

    Attributes:
        what: ``frames``, ``track``, ``identity``, ``event``, ``relation`` or ``group``.
        change: ``appeared`` (only in B), ``vanished`` (only in A), ``moved`` (in time or place) or ``changed``.
        frame: where it shows first.
        t: that frame's time in seconds from the recording's start.
        subjects: the tracks, by their ids in A (in B for what appeared).
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
        identical: every annotated frame has the same digest.
        frames: frames that both have.
        tracks: which track of B each track of A is.
        differences: in order of time.
    """

    a: str
    b: str
    identical: bool
    frames: int
    tracks: dict[int, int]
    differences: list[Difference]

    @property
    def equal(self) -> bool:
        """Whether nothing differs beyond the tolerance; ids may."""
        return not self.differences

    def counts(self) -> dict[str, int]:
        """How many differences of each kind, as ``event vanished``, most first."""
        found: dict[str, int] = {}
        for d in self.differences:
            key = f"{d.what} {d.change}"
            found[key] = found.get(key, 0) + 1
        return dict(sorted(found.items(), key=lambda item: (-item[1], item[0])))

    def as_plain(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**asdict(self), "tracks": {str(a): b for a, b in self.tracks.items()}, "counts": self.counts()}
