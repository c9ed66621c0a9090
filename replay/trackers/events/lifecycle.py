"""Who becomes a target: new ones, and orphans that come back (EVENTS 2, matching case 2).

An orphan is a target without an observation, whether or not it is lost already. Where it was in
one blob with another target, and the new track has that one's colours while that one is seen in
the orphan's, the two were exchanged as the blob came apart: each gets its own track.

The life itself is `replay.trackers.life`, as every tracker's.
"""

from __future__ import annotations

from typing import Any

from recorders.messages import Notice
from replay.trackers.events.identity import crossed, exchange
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.recover import Recovery, recover
from replay.trackers.events.tracks import EventsTracks
from replay.trackers.life import NANOS, TENTATIVE, Life, sightings_of
from replay.trackers.tracker import Frame

SAME = 0.3
"""Hellinger distance of colours up to which a young target is taken for one who was lost."""

YOUNG_LOOKS = 2
"""So often must a young target have been looked at for that."""


def confirm(
    tracks: EventsTracks, life: Life, frame: Frame, parameters: EventsParameters
) -> list[Notice]:
    """Tentative tracks with enough support become targets, new ones or ones that had been lost."""
    items = tracks.items
    ripe = [
        index
        for index, item in enumerate(items)
        if not item.members and life.is_ripe(item, frame.time_ns)
    ]
    if not ripe:
        return []
    notices = _change_places(tracks, ripe, parameters)
    orphans = [
        k for k, item in enumerate(items) if item.id != TENTATIVE and not item.observed
    ]
    found = {
        recovery.track: recovery
        for recovery in recover(tracks, orphans, ripe, frame.time_ns, parameters)
    }
    for row in ripe:
        if row in found:
            notices.append(_take_over(tracks, found[row], frame, parameters))
        elif life.may_confirm(tracks.box(row)):
            notices.append(life.confirm(items[row], frame.time_ns))
    gone = [recovery.orphan for recovery in found.values()]
    tracks.keep([k for k in range(len(items)) if k not in gone])
    return notices


def reclaim(
    tracks: EventsTracks, time_ns: int, parameters: EventsParameters
) -> list[Notice]:
    """A young target that turns out to be one who was lost in a shared blob: he is it.

    The colours of a new track are known only some looks after its confirmation, and those of who
    left the blob with it too, so that `confirm` may have come too early.
    """
    items = tracks.items
    lost = [index for index, item in enumerate(items) if item.told and item.lost]
    young = [
        row
        for row, item in enumerate(items)
        if item.told
        and item.observed
        and (time_ns - item.born_ns) / NANOS <= parameters.exchange_s
        and item.colours is not None
        and item.colours.updates >= YOUNG_LOOKS
    ]
    if not lost or not young:
        return []
    found = [
        recovery
        for recovery in recover(tracks, lost, young, time_ns, parameters)
        if recovery.appearance is not None
        and recovery.appearance <= SAME
        and items[recovery.track].born_ns > items[recovery.orphan].seen_ns
    ]
    notices = []
    for r in found:
        orphan, track = items[r.orphan], items[r.track]
        evidence = {
            "cost": r.cost,
            "cost_at_most": parameters.recover_cost,
            "unseen_s": orphan.unseen_s(time_ns),
            "motion": r.motion,
            "size": r.size,
            "appearance": r.appearance,
        }
        rule = "EVENTS 2, matching case 2: a young target is the orphan by its colours"
        ids = sorted([orphan.id, track.id])
        notices.append(
            Notice("track_recovered", ids, rule, evidence, since_frame=track.born)
        )
        exchange(orphan, track)
    tracks.keep(
        [
            row
            for row in range(len(items))
            if row not in [recovery.orphan for recovery in found]
        ]
    )
    return notices


def _change_places(
    tracks: EventsTracks, ripe: list[int], parameters: EventsParameters
) -> list[Notice]:
    """Exchange an orphan with whom it was in one blob, where a new track makes it plain that they
    had been taken for one another.
    """
    items = tracks.items
    notices: list[Notice] = []
    for new in ripe:
        orphans = [item for item in items if item.id != TENTATIVE and not item.observed]
        seen = [item for item in items if item.id != TENTATIVE and item.observed]
        tried = (
            crossed(orphan, other, items[new], parameters)
            for orphan in orphans
            for other in seen
        )
        notices += [
            n
            for n in (next((notice for notice in tried if notice is not None), None),)
            if n
        ]
    return notices


def _take_over(
    tracks: EventsTracks, recovery: Recovery, frame: Frame, parameters: EventsParameters
) -> Notice:
    """The new track lives on under the orphan's id, with the orphan's past."""
    orphan, track = tracks.items[recovery.orphan], tracks.items[recovery.track]
    track.id, track.split, track.mode = orphan.id, orphan.split, orphan.mode
    track.born, track.born_ns = orphan.born, orphan.born_ns
    track.hits += orphan.hits
    if orphan.colours is not None:
        track.colours = orphan.colours
    evidence: dict[str, Any] = {
        "unseen_s": orphan.unseen_s(frame.time_ns),
        "cost": recovery.cost,
        "cost_at_most": parameters.recover_cost,
        "motion": recovery.motion,
        "size": recovery.size,
    }
    if recovery.appearance is not None:
        evidence["appearance"] = recovery.appearance
    earlier, track.sightings = track.sightings[:-1], []
    rule = "EVENTS 2, matching case 2: an orphan and a new track look alike"
    return Notice(
        "track_recovered", [track.id], rule, evidence, sightings=sightings_of(earlier)
    )
