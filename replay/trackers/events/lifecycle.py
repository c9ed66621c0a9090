"""Who becomes a target: new ones, and orphans that come back (EVENTS 2, matching case 2).

The life itself is `replay.trackers.life`, as every tracker's.
"""

from __future__ import annotations

from typing import Any

from recorders.messages import Notice
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.recover import Recovery, recover
from replay.trackers.events.tracks import Tracks
from replay.trackers.life import TENTATIVE, Life, sightings_of
from replay.trackers.tracker import Frame


def confirm(tracks: Tracks, life: Life, frame: Frame, p: EventsParameters) -> list[Notice]:
    """Tentative tracks with enough support become targets, new ones or ones that had been lost."""
    items = tracks.items
    ripe = [k for k, t in enumerate(items) if life.is_ripe(t, frame.time_ns)]
    if not ripe:
        return []
    lost = [
        k for k, t in enumerate(items) if t.id != TENTATIVE and t.lost and not t.observed
    ]
    notices: list[Notice] = []
    found = {r.track: r for r in recover(tracks, lost, ripe, frame.time_ns, p)}
    for row in ripe:
        if row in found:
            notices.append(_take_over(tracks, found[row], frame, p))
        elif life.may_confirm(tracks.box(row)):
            notices.append(life.confirm(items[row], frame.time_ns))
    gone = [r.orphan for r in found.values()]
    tracks.keep([k for k in range(len(items)) if k not in gone])
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
