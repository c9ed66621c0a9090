"""Gaps in a recording: told once, by what is usual before."""

from __future__ import annotations

import pytest

from reasoning.events import EventLog
from reasoning.pauses import Pauses
from recorders.evidence import unlike

SECOND = 1_000_000_000


def gaps(times_s: list[float]) -> list[tuple[int, str]]:
    log, pauses = EventLog(), Pauses()
    told = []
    for frame, time_s in enumerate(times_s):
        log.open(frame, round(time_s * SECOND))
        # A checkpoint after every frame changes nothing.
        state, pauses = pauses.state(), Pauses()
        pauses.restore(state)
        pauses.step(log, round(time_s * SECOND))
        for event in log.events:
            assert event.kind == "scene_changed"
            assert not unlike(event.kind, event.evidence)
            told.append((frame, event.text))
    return told


def test_a_night_without_frames_is_told_once() -> None:
    evening = [k / 25 for k in range(50)]
    morning = [28_800 + k / 25 for k in range(50)]
    assert gaps(evening + morning) == [(50, "Nothing was recorded for 7 h 59 min.")]


@pytest.mark.parametrize("step", [1 / 25, 1.0, 60.0, 3600.0])
def test_a_steady_rate_has_no_gaps_however_slow(step: float) -> None:
    assert gaps([k * step for k in range(30)]) == []


def test_a_few_lost_frames_are_none() -> None:
    assert gaps([0.0, 0.04, 0.08, 0.5, 0.54, 2.3, 2.34]) == []


def test_the_second_frame_may_come_whenever_it_does() -> None:
    assert gaps([0.0, 100.0]) == []
    assert gaps([0.0, 0.04, 100.0]) == [(2, "Nothing was recorded for 1 min 39 s.")]
