"""Who is who after a blob has split (EVENTS 2): the colours that each target had before say if
two were exchanged.

While targets share a blob their colours are not learnt. What is seen of them afterwards is kept
apart until it has been compared with what each one of them looked like before.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from recorders.messages import Notice
from replay.trackers.appearance import distance
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracks import EventsTrack, EventsTracks
from replay.trackers.life import TENTATIVE

NS = 1e9
LOOKS = 3
"""So many looks at a target must have been taken before and after."""


def keep_company(
    tracks: EventsTracks, regions: Sequence[Sequence[int]], frame: int, time_ns: int
) -> None:
    """Remember who shares a region of pixels with whom in this frame, and how near they are to
    one another.
    """
    rows = {
        item.id: index for index, item in enumerate(tracks.items) if item.id != TENTATIVE
    }
    places = tracks.bank.value[:, :2]
    for members in regions:
        for member in members:
            track = tracks.items[rows[member]]
            if track.colours is None or track.colours.updates < LOOKS:
                continue
            for j in members:
                if j != member:
                    away = places[rows[member]] - places[rows[j]]
                    _note(track, j, frame, float(away[0] * away[0] + away[1] * away[1]))
            track.apart_ns, track.apart = time_ns, frame
            track.fresh = None


def _note(track: EventsTrack, other: int, frame: int, distance2: float) -> None:
    """Note a companion, and when the two were nearest to one another: there they were exchanged,
    if they were.
    """
    known = next((c for c in track.company if c[0] == other), None)
    if known is None:
        track.company = sorted([*track.company, [other, frame, distance2]])
    elif distance2 < known[2]:
        known[1:] = [frame, distance2]


def verify(
    tracks: EventsTracks, time_ns: int, parameters: EventsParameters
) -> list[Notice]:
    """Exchange identities where colours say so, and believe the rest; by id of the first of each
    pair.
    """
    notices: list[Notice] = []
    by_id = {item.id: item for item in tracks.items if item.id != TENTATIVE}
    for i in sorted(by_id):
        track = by_id[i]
        if not track.company or not _ready(track):
            continue
        waiting = (time_ns - track.apart_ns) / NS <= parameters.exchange_s
        undecided = False
        for j, nearest, _ in track.company:
            other = by_id.get(int(j))
            if other is None or other.colours is None or other.colours.updates < LOOKS:
                continue
            # Who is not to be seen yet may be anywhere, also where this one is thought to be.
            undecided |= other.lost or not _ready(other)
            if not other.lost and not _ready(other):
                continue
            found = _exchanged(track, other, int(nearest), parameters)
            if found is not None:
                notices.append(found)
                exchange(track, other)
                by_id[track.id], by_id[other.id] = track, other
                break
        if not (undecided and waiting):
            _believe(by_id[i])
    return notices


def _ready(track: EventsTrack) -> bool:
    return track.fresh is not None and track.fresh.updates >= LOOKS


def _exchanged(
    a: EventsTrack, b: EventsTrack, since: int, parameters: EventsParameters
) -> Notice | None:
    """Whether a is b (and b is a, unless it has not been seen since)."""
    if a.colours is None or b.colours is None or a.fresh is None:
        return None
    straight, across = (
        distance(a.colours.table, a.fresh.table),
        distance(b.colours.table, a.fresh.table),
    )
    if _ready(b) and b.fresh is not None:
        straight += distance(b.colours.table, b.fresh.table)
        across += distance(a.colours.table, b.fresh.table)
    if across > parameters.exchange_ratio * straight:
        return None
    return _told(a, b, since, straight, across, parameters)


def crossed(
    orphan: EventsTrack, other: EventsTrack, new: EventsTrack, parameters: EventsParameters
) -> Notice | None:
    """Whether an orphan and one that is seen were exchanged when their blob came apart: ``other``
    is seen in the orphan's colours since, and the ``new`` track in the other's. If so, they are
    exchanged back, and the new track is the orphan's to take.
    """
    met = next((c for c in other.company if c[0] == orphan.id), None)
    if met is None or orphan.colours is None or other.colours is None:
        return None
    if other.fresh is None or new.colours is None or orphan.colours.updates < LOOKS:
        return None
    straight = distance(other.colours.table, other.fresh.table)
    straight += distance(orphan.colours.table, new.colours.table)
    across = distance(orphan.colours.table, other.fresh.table)
    across += distance(other.colours.table, new.colours.table)
    if across > parameters.exchange_ratio * straight:
        return None
    notice = _told(orphan, other, int(met[1]), straight, across, parameters)
    exchange(orphan, other)
    _believe(other)
    return notice


def _told(
    a: EventsTrack,
    b: EventsTrack,
    since: int,
    straight: float,
    across: float,
    parameters: EventsParameters,
) -> Notice:
    evidence: dict[str, Any] = {
        "since_frame": since,
        "as_they_were": straight,
        "exchanged": across,
        "exchanged_at_most": parameters.exchange_ratio * straight,
    }
    rule = "EVENTS 2: after the split each has the colours that the other one had"
    return Notice(
        "track_recovered", sorted([a.id, b.id]), rule, evidence, since_frame=since
    )


def exchange(a: EventsTrack, b: EventsTrack) -> None:
    """Exchange who they are; where they are stays."""
    for name in ("id", "born", "born_ns", "colours", "split", "company"):
        mine, theirs = getattr(a, name), getattr(b, name)
        setattr(a, name, theirs)
        setattr(b, name, mine)


def _believe(track: EventsTrack) -> None:
    """What was seen since the split are the target's own colours."""
    if track.fresh is not None and track.colours is not None:
        track.colours.learn(track.fresh.table)
    track.company, track.fresh = [], None
