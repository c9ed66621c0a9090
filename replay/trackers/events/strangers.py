"""Motion agrees, but it is somebody else: one goes through a door, another comes out of it.

A target that is alone in its blob is known by its colours. If they are entirely others from one
look to the next, and stay so, then the blob is somebody else's since the first of these looks: a
new target, who is told apart in hindsight from then on. The old one was last seen before, and may
come back.
"""

from __future__ import annotations

from dataclasses import replace

from recorders.messages import NO_BLOB, Box, Notice
from replay.trackers.appearance import Colours, distance
from replay.trackers.events.tracks import EventsTrack, EventsTracks, Floats
from replay.trackers.life import NANOS

LOOKS = 3
"""So often must a target have been looked at before its colours are known."""
OTHER = 0.5
"""Hellinger distance of somebody else's colours; one's own are nearer than 0.42 in 99 of 100
looks (PETS S2.L1).
"""
STILL = 0.42
"""At the second look, which has to be more like the first strange one than like the target, this
is enough.
"""
WHOLE = 0.5
"""Share of the area that was seen before; in less, colours are those of a part."""


def estranged(
    track: EventsTrack, seen: Floats, box: Box, frame: int, time_ns: int
) -> bool | None:
    """Whether a lone target's blob is somebody else's.

    Returns:
        None: no, these are its own colours. False: it is too early to tell, and nothing is to be
            learnt. True: yes.
    """
    total = float(seen[0].sum())
    if (
        track.colours is None
        or track.colours.updates < LOOKS
        or track.company
        or total <= 0
        or not track.known
    ):
        track.known = [float(frame), float(time_ns), *box]
        return None
    away = distance(track.colours.table, seen / total)
    whole = box[2] * box[3] >= WHOLE * track.known[4] * track.known[5]
    if track.stranger is None:
        if away <= OTHER or not whole:
            track.known = [float(frame), float(time_ns), *box]
            return None
        track.since = frame
        track.stranger = Colours()
        track.stranger.learn(seen)
        return False
    if whole and away > STILL and distance(track.stranger.table, seen / total) < away:
        track.stranger.learn(seen)
        return True
    track.stranger = None
    track.known = [float(frame), float(time_ns), *box]
    return None


def part(
    tracks: EventsTracks, row: int, identity: int, frame: int, doubt_s: float
) -> list[Notice]:
    """The row is a new target with the given id since the first strange look; the old one is lost
    where it was.

    Who left a shared blob less than ``doubt_s`` before may have been taken for another one from
    then on: that is when it was last seen for sure.
    """
    track = tracks.items[row]
    if track.colours is None or track.stranger is None:
        return []
    _, ns, x, y, w, h = track.known
    evidence = {
        "since_frame": track.since,
        "appearance": distance(track.colours.table, track.stranger.table),
        "appearance_over": STILL,
    }
    doubted = 0 < ns - track.apart_ns < doubt_s * NANOS and track.apart_ns > 0
    seen = track.apart_ns if doubted else round(ns)
    since = track.apart if doubted else track.since
    past = replace(
        track, seen_ns=seen, observed=False, measured=None, blob=NO_BLOB, column=-1, alone=False, signed=False,
        hidden=False, sized=False, stranger=None, known=[], regions=[], fresh=None,
    )  # fmt: skip
    old = track.id
    track.id, track.newborn, track.split = identity, True, False
    track.born, track.born_ns = since if doubted else frame, round(ns) + 1
    evidence["since_frame"] = since
    track.colours, track.stranger, track.known, track.fresh = track.stranger, None, [], None
    track.company, track.sightings = [], []
    tracks.start((x, y, w, h), None, past)
    rule = "EVENTS 2: the motion agrees, the colours are somebody else's"
    told = [
        Notice(
            "track_confirmed",
            [identity],
            rule,
            {
                "hits": track.hits,
                "first_frame": frame,
                "appearance": evidence["appearance"],
                "appearance_over": STILL,
            },
        )
    ]
    return [
        *told,
        Notice(
            "track_recovered",
            sorted([old, identity]),
            rule,
            evidence,
            since_frame=since,
        ),
    ]
