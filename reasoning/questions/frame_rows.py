"""What one message of an annotated log becomes: rows without the recording, in the order of the
tables' columns.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

import msgspec
from msgspec import UNSET

from reasoning.questions.recording_facts import Row
from reasoning.questions.runs import Sight
from recorders.annotated.reader import AnnotatedFrame
from recorders.corrections import parse_corrections
from recorders.errors import SceneTraceError
from recorders.messages import Event, Track

_LEAST, _MOST = -(2**31), 2**31 - 1


def check_ids(frame: AnnotatedFrame) -> None:
    """That every id of a frame is one that the tables hold, whichever of them are filled.

    Raises:
        SceneTraceError: one does not fit; names the table.
    """
    tracks = [track.id for track in frame.tracks]
    relations = [i for relation in frame.relations for i in (relation.a, relation.b)]
    groups = [
        i
        for group in frame.groups
        for i in chain((group.label,), group.members, group.formed_from)
    ]
    for track in frame.tracks:
        if track.group is not None:
            groups.append(track.group)
        if track.grouping or track.grouped or track.splitting:
            tracks += track.grouping_partners
            tracks += track.grouped_partners
            tracks += track.splitting_partners
    events = [
        i
        for event in frame.events
        for i in chain((event.id, event.frame), event.subjects, event.groups)
    ]
    for table, ids in (
        ("tracks", tracks), ("relations", relations), ("groups", groups), ("events", events)
    ):  # fmt: skip
        if ids and not (min(ids) >= _LEAST and max(ids) <= _MOST):
            wrong = max(ids, key=abs)
            raise SceneTraceError(
                f"a row of {table} does not fit its columns: {wrong} is over 2^31"
            )


def track_row(track: Track, told: Sight) -> Row:
    """Of ``tracks``, after frame and time."""
    return (
        track.id,
        *track.box,
        *track.velocity,
        track.mode,
        track.confidence,
        track.grouping,
        track.grouped,
        track.splitting,
        track.group,
        track.scene,
        None if track.label is UNSET else track.label,
        track.present,
        bool(told.seen),
        track.identity,
    )


def event_row(event: Event, t: float, told: Sight) -> Row:
    """Of ``events``; ``t`` in seconds from the recording's start."""
    belief = (
        (float(told.seen), told.existence, told.identity)
        if event.subjects
        else (None, None, None)
    )
    return (
        event.id,
        event.kind,
        event.frame,
        t,
        list(event.subjects),
        event.rule,
        msgspec.json.encode(event.evidence).decode(),
        event.text,
        *belief,
        list(told.joins),
    )


def correction_rows(text: str | None, path: str) -> Iterator[Row]:
    """Of ``corrections``: what people corrected, as the log tells it; none where it tells nothing.

    Raises:
        SourceError: it is no such text.
    """
    if text is None:
        return
    found = parse_corrections(text, path)
    for row in found.rows:
        yield (
            row.correction,
            row.do,
            list(row.tracks),
            row.frame,
            row.t,
            row.told(),
            row.by,
            row.why,
            row.date or None,
            row.other or None,
            row.correction in found.undone,
        )
