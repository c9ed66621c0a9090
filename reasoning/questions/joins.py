"""The joins that identities rest on: after each a track may be another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from reasoning.questions.case import Case
from reasoning.questions.literals import literal


@dataclass(frozen=True)
class IdentityJoin:
    """An event after which a track may be another.

    Attributes:
        event: its number.
        track: the track.
        frame, t: the first frame after it, and its time in seconds.
        text: in words.
    """

    event: int
    track: int
    frame: int
    t: float
    text: str


def joins_of(
    case: Case, recording: str, subjects: Sequence[int], until_frame: int
) -> list[IdentityJoin]:
    """The joins that the identities of tracks rest on up to a frame, in order."""
    if not subjects:
        return []
    rows = case.rows(
        f"""SELECT event, subjects, frame, t, text, rule FROM events
        WHERE recording = {literal(recording)} AND frame <= {until_frame}
          AND list_has_any(subjects, {list(subjects)}) AND (kind = 'identity' OR
            (kind = 'track_recovered' AND json_extract(evidence, '$.fragment') IS NOT NULL))
        ORDER BY event"""
    )
    # One join may be told by two events.
    found = {
        (who[0], frame): IdentityJoin(event, who[0], frame, t, text or rule)
        for event, who, frame, t, text, rule in rows
        if who
    }
    return sorted(found.values(), key=lambda join: join.event)
