"""Fused detections are looked for as far as a target may be off by now."""

from __future__ import annotations

import numpy as np
import pytest

from replay.trackers.events.associate import SeenDetections, match
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracks import EventsTrack, EventsTracks

P = EventsParameters()


def _unseen_for(frames: int) -> EventsTracks:
    tracks = EventsTracks(P)
    tracks.start((100.0, 100.0, 20.0, 50.0), None, EventsTrack(1, 0, 0, 0))
    for _ in range(frames):
        tracks.predict(1 / 7)
    return tracks


def _matched(tracks: EventsTracks, off: float, fused: bool) -> bool:
    box = np.array([[100.0 + off, 100.0, 20.0, 50.0]])
    seen = SeenDetections(box, np.ones(1), np.full(1, -1), [None], None, fused)
    one = np.zeros(1, np.intp)
    return bool(match(tracks, one, seen, one, P))


def test_who_was_unseen_is_found_in_a_fused_box_beside_the_path() -> None:
    tracks = _unseen_for(3)
    assert _matched(tracks, 12.0, fused=True)
    assert not _matched(tracks, 12.0, fused=False)


@pytest.mark.parametrize("fused", [False, True])
def test_the_gate_on_the_centre_holds_for_all(fused: bool) -> None:
    assert not _matched(_unseen_for(1), 60.0, fused)


def test_doubt_is_what_goes_beyond_a_measurement_and_grows() -> None:
    rows = np.zeros(1, np.intp)
    doubts = [float(_unseen_for(k).doubt(rows)[0, 0]) for k in range(4)]
    assert doubts[0] == 0.0
    assert doubts == sorted(doubts)
    assert doubts[3] > 1.0
