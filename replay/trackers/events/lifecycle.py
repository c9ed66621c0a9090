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
from replay.trackers.events.tracks import Tracks
from replay.trackers.life import NANOS, TENTATIVE, Life, sightings_of
from replay.trackers.tracker import Frame

SAME = 0.3
"""Hellinger distance of colours up to which a young target is taken for one who was lost."""

YOUNG_LOOKS = 2
"""So often must a young target have been looked at for that."""


def confirm(tracks: Tracks, life: Life, frame: Frame, p: EventsParameters) -> list[Notice]:
    """Tentative tracks with enough support become targets, new ones or ones that had been lost."""
    items = tracks.items
    ripe = [
        k for k, t in enumerate(items) if not t.members and life.is_ripe(t, frame.time_ns)
    ]
    if not ripe:
        return []
    notices = _change_places(tracks, ripe, p)
    orphans = [k for k, t in enumerate(items) if t.id != TENTATIVE and not t.observed]
    found = {r.track: r for r in recover(tracks, orphans, ripe, frame.time_ns, p)}
    for row in ripe:
        if row in found:
            notices.append(_take_over(tracks, found[row], frame, p))
        elif life.may_confirm(tracks.box(row)):
            notices.append(life.confirm(items[row], frame.time_ns))
    gone = [r.orphan for r in found.values()]
    tracks.keep([k for k in range(len(items)) if k not in gone])
    return notices


def reclaim(tracks: Tracks, time_ns: int, p: EventsParameters) -> list[Notice]:
    """A young target that turns out to be one who was lost in a shared blob: he is it.

    The colours of a new track are known only some looks after its confirmation, and those of who
    left the blob with it too, so that `confirm` may have come too early.
    """
    items = tracks.items
    lost = [k for k, t in enumerate(items) if t.told and t.lost]
    young = [
        k
        for k, t in enumerate(items)
        if t.told
        and t.observed
        and (time_ns - t.born_ns) / NANOS <= p.exchange_s
        and t.colours is not None
        and t.colours.updates >= YOUNG_LOOKS
    ]
    if not lost or not young:
        return []
    found = [
        r
        for r in recover(tracks, lost, young, time_ns, p)
        if r.appearance is not None
        and r.appearance <= SAME
        and items[r.track].born_ns > items[r.orphan].seen_ns
    ]
    notices = []
    for r in found:
        orphan, track = items[r.orphan], items[r.track]
        evidence = {
            "cost": r.cost,
            "cost_at_most": p.recover_cost,
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
    tracks.keep([k for k in range(len(items)) if k not in [r.orphan for r in found]])
    return notices


def _change_places(tracks: Tracks, ripe: list[int], p: EventsParameters) -> list[Notice]:
    """Exchange an orphan with whom it was in one blob, where a new track makes it plain that they
    had been taken for one another.
    """
    items = tracks.items
    notices: list[Notice] = []
    for new in ripe:
        orphans = [t for t in items if t.id != TENTATIVE and not t.observed]
        seen = [t for t in items if t.id != TENTATIVE and t.observed]
        tried = (crossed(a, b, items[new], p) for a in orphans for b in seen)
        notices += [n for n in (next((n for n in tried if n is not None), None),) if n]
    return notices


def _take_over(tracks: Tracks, r: Recovery, frame: Frame, p: EventsParameters) -> Notice:
    """The new track lives on under the orphan's id, with the orphan's past."""
    orphan, track = tracks.items[r.orphan], tracks.items[r.track]
    track.id, track.split, track.mode = orphan.id, orphan.split, orphan.mode
    track.born, track.born_ns = orphan.born, orphan.born_ns
    track.hits += orphan.hits
    if orphan.colours is not None:
        track.colours = orphan.colours
    evidence: dict[str, Any] = {
        "unseen_s": orphan.unseen_s(frame.time_ns),
        "cost": r.cost,
        "cost_at_most": p.recover_cost,
        "motion": r.motion,
        "size": r.size,
    }
    if r.appearance is not None:
        evidence["appearance"] = r.appearance
    earlier, track.sightings = track.sightings[:-1], []
    rule = "EVENTS 2, matching case 2: an orphan and a new track look alike"
    return Notice(
        "track_recovered", [track.id], rule, evidence, sightings=sightings_of(earlier)
    )
