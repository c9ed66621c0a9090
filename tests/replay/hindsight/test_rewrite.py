"""Hindsight over made-up forward passes: joined, filled, smoothed, back-dated, dropped."""

from __future__ import annotations

import gc
import math
import random
import tracemalloc
from collections.abc import Iterable
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from recorders.messages import GroupTrack, Notice, Target, Targets, TrackSighting
from recorders.parameters import Config, configure
from recorders.scene import SceneInfo
from replay.hindsight import SECTIONS, rewrite
from replay.hindsight.parameters import HindsightParameters

FRAME_NS = 100_000_000
SCENE = SceneInfo(640, 480, FRAME_NS, False, False)
COLOURS_A, COLOURS_B = [100, 0, 0, 50], [0, 80, 70, 0]


def _config(*words: str) -> Config:
    return configure(SECTIONS, None, words)


def _target(identity: int, frame: int, x: float, y: float = 200.0, **facts: Any) -> Target:
    plain = Target(identity, (x, y, 20.0, 40.0), (0.0, 0.0), measured=(x, y, 20.0, 40.0))
    fields = {f: getattr(plain, f) for f in plain.__struct_fields__}
    return Target(**{**fields, **facts})


def _run(frames: list[Targets], *words: str) -> list[Targets]:
    readings = []

    def read() -> Iterable[Targets]:
        readings.append(1)
        return iter(frames)

    out = list(
        rewrite(read, SCENE, [k * FRAME_NS for k in range(len(frames))], _config(*words))
    )
    assert len(readings) == 2
    assert [t.frame for t in out] == [t.frame for t in frames]
    return out


def _walk(frames: int, hidden: range, second: int = 2, **facts: Any) -> list[Targets]:
    """Target 1 walks at 50 px/s; unseen during ``hidden``, afterwards it has the second id."""
    out = []
    for k in range(frames):
        here = (
            []
            if k in hidden
            else [_target(1 if k < hidden.start else second, k, 50 + 5.0 * k, **facts)]
        )
        out.append(Targets(k, here))
    return out


def _notices(out: list[Targets], kind: str) -> list[tuple[int, Notice]]:
    return [(t.frame, n) for t in out for n in t.notices if n.kind == kind]


def test_fragments_are_joined_and_the_gap_is_filled_on_the_path() -> None:
    out = _run(_walk(60, range(20, 32)))
    assert all([t.id for t in frame.targets] == [1] for frame in out)
    for k in range(20, 32):
        target = out[k].targets[0]
        assert target.box[0] == pytest.approx(50 + 5.0 * k, abs=1.0)
        assert target.mode == "predicted"
        assert not target.observed
    [(frame, notice)] = _notices(out, "track_recovered")
    assert frame == 32
    assert notice.rule.startswith("EVENTS hindsight")
    assert notice.evidence["fragment"] == 2
    assert notice.evidence["after"] == 1
    assert notice.evidence["gap_s"] == pytest.approx(1.3)
    assert notice.evidence["cost"] >= notice.evidence["motion"]
    # What it was held against stands beside it.
    p = HindsightParameters()
    assert notice.evidence["cost"] < notice.evidence["cost_under"] == p.join_cost
    assert notice.evidence["gap_s"] <= notice.evidence["gap_s_at_most"] == p.join_s
    [(_, first)] = _notices(out, "track_confirmed")
    assert (
        first.evidence["life_s"] >= first.evidence["life_s_at_least"] == p.min_life_s / 2
    ), "there from the start"
    assert first.evidence["support"] == pytest.approx(48 / 48)
    assert first.evidence["support_at_least"] == p.min_support


@pytest.mark.parametrize(
    ("aside", "overlap", "ids"),
    [(4.0, 3, {1}), (4.0, 9, {1}), (4.0, 14, {1, 2}), (14.0, 3, {1, 2})],
)
def test_a_second_box_on_somebody_takes_his_track_over(
    aside: float, overlap: int, ids: set[int]
) -> None:
    """Where it stands on him, and the first one ends within a second."""
    frames = []
    for k in range(60):
        here = [_target(1, k, 50 + 5.0 * k)] if k < 30 else []
        here += [_target(2, k, 50 + 5.0 * k, 200 + aside * 2)] if k >= 30 - overlap else []
        frames.append(Targets(k, here))
    out = _run(frames)
    assert {t.id for frame in out for t in frame.targets} == ids
    if ids == {1}:
        assert all(len(frame.targets) == 1 for frame in out)
        [(frame, notice)] = _notices(out, "track_recovered")
        assert (frame, notice.evidence["gap_s"]) == (30 - overlap, 0.0)


def test_who_left_the_scene_does_not_go_on_as_who_comes_in() -> None:
    frames = _walk(60, range(20, 32))
    for left, ids in ((False, {1}), (True, {1, 2})):
        gone = Notice("track_removed", [1], "EVENTS 3.2", left_scene=left)
        told = [
            Targets(t.frame, t.targets, notices=[gone] if t.frame == 24 else [])
            for t in frames
        ]
        assert {t.id for frame in _run(told) for t in frame.targets} == ids


def test_colours_decide_who_goes_on() -> None:
    frames = []
    for k in range(80):
        here = []
        if k < 30:
            here = [
                _target(1, k, 100.0, 200.0, signature=COLOURS_A),
                _target(2, k, 100.0, 230.0, signature=COLOURS_B),
            ]
        if k >= 40:
            here = [
                _target(3, k, 104.0, 200.0, signature=COLOURS_B),
                _target(4, k, 104.0, 230.0, signature=COLOURS_A),
            ]
        frames.append(Targets(k, here))
    out = _run(frames)
    last = {t.id: t.box[1] for t in out[-1].targets}
    assert last[1] == pytest.approx(230.0, abs=1.0)
    assert last[2] == pytest.approx(200.0, abs=1.0)


def test_what_is_too_far_or_too_late_stays_apart() -> None:
    far = [
        Targets(k, [_target(1 if k < 30 else 2, k, 50.0 if k < 30 else 500.0)])
        for k in range(60)
    ]
    assert {t.id for frame in _run(far) for t in frame.targets} == {1, 2}
    late = _walk(120, range(20, 90))
    out = _run(late)
    assert {t.id for frame in out for t in frame.targets} == {1, 2}
    assert not any(frame.targets for frame in out[21:90])
    assert [(f, n.subjects) for f, n in _notices(out, "track_removed")] == [(20, [1])]


def test_births_are_back_dated_to_the_first_sighting() -> None:
    frames = _walk(40, range(0))
    frames = [Targets(t.frame, []) if t.frame < 5 else t for t in frames]
    sightings = [TrackSighting(k, (50 + 5.0 * k, 200.0, 20.0, 40.0)) for k in range(2, 5)]
    confirmed = Notice("track_confirmed", [2], "rule", sightings=sightings)
    frames[5] = Targets(5, frames[5].targets, None, [confirmed])
    out = _run(frames)
    assert [len(t.targets) for t in out[:6]] == [0, 0, 1, 1, 1, 1]
    assert out[2].targets[0].newborn
    assert [f for f, _ in _notices(out, "track_confirmed")] == [2]


def test_a_short_path_is_held_back_with_the_reason_and_a_tiny_one_is_told() -> None:
    frames = _walk(60, range(0))
    frames = [
        Targets(
            t.frame,
            [
                *t.targets,
                *([_target(9, t.frame, 400.0)] if 10 <= t.frame < 14 else []),
                Target(10, (300.0, 50.0, 4.0, 8.0), measured=(300.0, 50.0, 4.0, 8.0)),
            ],
        )
        for t in frames
    ]
    out = _run(frames)
    assert {t.id for f in out for t in f.targets} == {2, 10}
    held = {f.frame: f.held_back for f in out if f.held_back}
    assert sorted(held) == [10, 11, 12, 13]
    assert [w.box for w in held[10]] == [(400.0, 200.0, 20.0, 40.0)]
    assert held[10][0].reason == "short: 0.40 s, under 0.80 s"
    out = _run(frames, "hindsight.min_life_s=0")
    assert {t.id for f in out for t in f.targets} == {2, 9, 10}
    assert not any(f.held_back for f in out)


def _seen_as_pixels(frames: list[Targets], pieces: float = 1.0) -> list[Targets]:
    scene = SceneInfo(640, 480, FRAME_NS, True, True, pieces)
    times = [k * FRAME_NS for k in range(len(frames))]
    return list(rewrite(lambda: iter(frames), scene, times, _config()))


def test_masks_in_pieces_and_shared_regions_make_less_sure() -> None:
    def frame(k: int) -> Targets:
        one = _target(1, k, 50 + 5.0 * k)
        return Targets(k, [replace(one, mode="appearance") if k >= 30 else one])

    def told(pieces: float) -> tuple[float, float]:
        out = _seen_as_pixels([frame(k) for k in range(60)], pieces)
        return out[10].targets[0].confidence, out[50].targets[0].confidence

    whole, broken, hopeless = told(1.0), told(4.0), told(1e6)
    assert whole == pytest.approx((0.961, 0.881), abs=0.001)
    assert broken == pytest.approx((0.890, 0.709), abs=0.001)
    assert hopeless[0] > 0.5


def test_what_comes_up_within_the_picture_and_stays_is_a_thing() -> None:
    def frame(k: int) -> Targets:
        here = [_target(1, k, 50 + 5.0 * k), _target(2, k, 200.0 + 0.3 * (k % 5))]
        if k >= 20:
            here.append(_target(3, k, 400.0 + 0.3 * (k % 5)))
        if k >= 50:
            here.append(_target(4, k, 500.0))
        return Targets(k, here)

    out = _seen_as_pixels([frame(k) for k in range(60)])
    told = {t.id: t.confidence for f in out for t in f.targets}
    # Who was there from the start, or came a second before the end, had no time to go anywhere.
    assert sorted(told) == [1, 2, 4]
    assert list(told.values()) == pytest.approx([0.96] * 3, abs=0.01)
    (reason,) = {w.reason for f in out for w in f.held_back}
    assert reason.startswith("unlikely: it went by 0.04 of its size at most: somebody with")
    assert sum(bool(f.held_back) for f in out) == 40


@given(reach=st.lists(st.floats(0.0, 3.0), min_size=2, max_size=2))
def test_who_goes_further_is_not_less_likely_somebody(reach: list[float]) -> None:
    def frame(k: int) -> Targets:
        size = math.sqrt(800.0)
        way = [
            _target(i + 1, k, 80.0 + r * size * (k - 5) / 34, 50.0 + 200.0 * i)
            for i, r in enumerate(reach)
        ]
        return Targets(k, way if k >= 5 else [])

    out = _seen_as_pixels([frame(k) for k in range(50)])
    sure = {t.id: t.confidence for f in out for t in f.targets}
    told = [sure.get(k + 1, 0.0) for k in range(2)]
    assert told == sorted(told, reverse=reach[0] > reach[1])


def test_a_middling_score_at_one_place_is_not_better_for_being_repeated() -> None:
    def frame(k: int) -> Targets:
        shake = 2.0 * math.sin(1.7 * k)
        here = [
            _target(1, k, 20 + 3.0 * k, likely=0.65),
            _target(2, k, 400.0 + shake, likely=0.65),
            _target(3, k, 500.0 + shake, likely=0.95),
        ]
        return Targets(k, here)

    out = _run([frame(k) for k in range(160)])
    assert {t.id for f in out for t in f.targets} == {1, 3}
    (reason,) = {w.reason for f in out for w in f.held_back}
    assert "of its size at most" in reason
    out = _run([frame(k) for k in range(40)])
    assert {t.id for f in out for t in f.targets} == {1, 2, 3}, "who waits for a while"


def test_who_is_seen_in_unlikely_detections_alone_is_held_back() -> None:
    def frame(k: int) -> Targets:
        return Targets(
            k,
            [
                _target(1, k, 50 + 5.0 * k, likely=0.9),
                _target(2, k, 400.0, likely=0.2),
                _target(3, k, 500.0, likely=0.95 if k % 2 else 0.3),
            ],
        )

    out = _run([frame(k) for k in range(30)])
    assert {t.id for f in out for t in f.targets} == {1, 3}
    assert {w.reason for f in out for w in f.held_back or ()} == {
        "unlikely: its detections are somebody with 0.20, under 0.50"
    }
    sure = {t.id: t.confidence for t in out[15].targets}
    doubtful = {t.id: t.confidence for t in out[16].targets}
    assert sure[1] == doubtful[1] > 0.9
    assert sure[3] > doubtful[3], "a frame's own detection counts, too"


@given(gaps=st.lists(st.integers(3, 25), min_size=1, max_size=4))
def test_an_identity_never_grows_surer_and_every_long_gap_is_told(gaps: list[int]) -> None:
    seen, k = list[int](), 0
    for gap in gaps:
        seen += range(k, k + 10)
        k += 10 + gap
    seen += range(k, k + 10)
    frames = [
        Targets(f, [_target(1, f, 100.0)] if f in seen else []) for f in range(k + 10)
    ]
    out = _run(frames, "hindsight.min_support=0")
    left = [t.identity for f in out for t in f.targets]
    assert left == sorted(left, reverse=True)
    assert left[0] == 1.0
    same = [math.exp(-((0.1 * (gap + 1) / 6.0) ** 1.5)) for gap in gaps]
    against = math.fsum(1.0 / p - 1.0 for p in same)
    assert left[-1] == pytest.approx(1.0 / (1.0 + against))
    doubtful = [(p, 0.1 * (gap + 1)) for p, gap in zip(same, gaps, strict=True) if p < 0.9]
    told = [n.evidence for _, n in _notices(out, "identity")]
    assert [(e["same"], e["gap_s"]) for e in told] == [pytest.approx(d) for d in doubtful]


@pytest.mark.parametrize(
    ("steps", "told"), [(0, False), (10, False), (60, True), (100, True)]
)
def test_who_goes_by_may_have_been_exchanged(steps: int, told: bool) -> None:
    """Two stand beside one another; the second walks over to the first one's other side, back, and
    so on. What counts is how far he goes, not for how long they stand. (Of boxes alone each crossing
    is asked about by itself.)
    """
    walk = [30.0 - 6.0 * abs((k + 10) % 20 - 10) for k in range(steps + 1)]
    ways = [30.0] * 10 + walk + [walk[-1]] * 10
    frames = [
        Targets(k, [_target(1, k, 200.0), _target(2, k, 200.0 + way)])
        for k, way in enumerate(ways)
    ]
    scene = SceneInfo(640, 480, FRAME_NS, True, False)
    times = [k * FRAME_NS for k in range(len(ways))]
    out = list(rewrite(lambda: iter(frames), scene, times, _config()))
    left = {t.id: t.identity for t in out[-1].targets}
    size = math.sqrt(20.0 * 40.0)
    assert left[1] == left[2]
    assert left[1] == pytest.approx(1.0 / (1.0 + 0.056 / 5 * 6.0 * steps / size), abs=0.03)
    assert all(t.identity > 0.99 for f in out[:6] for t in f.targets)
    notices = [n for _, n in _notices(out, "identity")]
    assert [(n.subjects, n.evidence["with"]) for n in notices] == (
        [([1], [2]), ([2], [1])] if told else []
    )


def test_a_size_that_changes_may_be_another_one() -> None:
    frames = [
        Targets(k, [_target(1, k, 100.0, measured=(100.0, 100.0, 20.0, high))])
        for k, high in enumerate(
            [40.0] * 10 + [40.0 + 2 * k for k in range(21)] + [80.0] * 10
        )
    ]
    left = [t.identity for f in _run(frames) for t in f.targets]
    assert left[0] == 1.0
    assert left[-1] == pytest.approx(1.0 / (1.0 + 0.3 * math.log(2.0)), abs=0.02)


@pytest.mark.parametrize(
    ("frames", "kept"), [(range(55, 60), True), (range(5), True), (range(54, 59), False)]
)
def test_a_path_that_the_recording_cuts_off_is_dropped_at_half_the_length(
    frames: range, kept: bool
) -> None:
    scene = [
        Targets(
            t.frame,
            [*t.targets, _target(9, t.frame, 400.0)] if t.frame in frames else t.targets,
        )
        for t in _walk(60, range(0))
    ]
    assert {t.id for f in _run(scene) for t in f.targets} == ({2, 9} if kept else {2})
    cut = frames[:3] if frames.start == 0 else frames[-3:]
    shorter = [
        Targets(t.frame, [x for x in t.targets if x.id != 9 or t.frame in cut])
        for t in scene
    ]
    assert {t.id for f in _run(shorter) for t in f.targets} == {2}


def test_noise_is_smoothed_and_speed_comes_with_it() -> None:
    frames = []
    for k in range(100):
        x = 50 + 5.0 * k + 3 * math.sin(12.9898 * k)
        frames.append(Targets(k, [_target(1, k, x)]))
    out = _run(frames)
    rough = [abs(f.targets[0].box[0] - (50 + 5.0 * k)) for k, f in enumerate(frames)]
    smooth = [abs(f.targets[0].box[0] - (50 + 5.0 * k)) for k, f in enumerate(out)]
    assert sum(smooth) < 0.6 * sum(rough)
    assert out[50].targets[0].velocity[0] == pytest.approx(50.0, abs=8.0)


def _dash(k: int) -> float:
    """There and back at 120 px/s, turning about every 0.8 s."""
    return 100 + 12 * abs(k % 16 - 8)


def test_turns_of_who_dashes_about_are_not_smoothed_away() -> None:
    rng = random.Random(5)
    seen = [_dash(k) + rng.uniform(-0.5, 0.5) for k in range(120)]
    out = _run([Targets(k, [_target(1, k, x)]) for k, x in enumerate(seen)])
    off = sorted(abs(t.targets[0].box[0] - _dash(t.frame)) for t in out)
    assert off[60] < 0.8
    assert off[-1] < 5


def test_where_there_are_pixels_who_dashes_about_is_where_they_were_seen() -> None:
    frames = [Targets(k, [_target(1, k, _dash(k))] if k % 7 else []) for k in range(118)]
    scene = SceneInfo(640, 480, FRAME_NS, True, True)
    out = list(
        rewrite(lambda: iter(frames), scene, [k * FRAME_NS for k in range(118)], _config())
    )
    for t in out[1:]:
        assert t.targets[0].box[0] == pytest.approx(
            _dash(t.frame), abs=1e-9 if t.frame % 7 else 12
        )
    calm = _walk(60, range(20, 20))
    calm = [
        replace(
            t,
            targets=[
                replace(x, measured=(x.box[0] + t.frame % 2, *x.box[1:])) for x in t.targets
            ],
        )
        for t in calm
    ]
    out = list(
        rewrite(lambda: iter(calm), scene, [k * FRAME_NS for k in range(60)], _config())
    )
    assert max(abs(t.targets[0].box[0] - 50.5 - 5 * t.frame) for t in out[10:50]) < 0.3, (
        "noise is smoothed as ever"
    )


def test_blocks_do_not_show() -> None:
    frames = _walk(400, range(120, 135))
    out = _run(frames)
    steps = [b.targets[0].box[0] - a.targets[0].box[0] for a, b in pairwise(out)]
    assert steps == pytest.approx([5.0] * 399, abs=0.2)


def test_unfilled_gap_of_one_target_is_lost_and_found() -> None:
    frames = [
        Targets(k, [_target(1, k, 50.0)] if not 30 <= k < 75 else []) for k in range(120)
    ]
    out = _run(frames)
    assert not any(f.targets for f in out[30:75])
    assert [f for f, _ in _notices(out, "track_lost")] == [30]
    assert [f for f, _ in _notices(out, "track_recovered")] == [75]


def test_groups_and_other_notices_follow_the_final_ids() -> None:
    frames = []
    for k in range(60):
        other = _target(7, k, 300.0, blob=3)
        mine = _target(1 if k < 20 else 2, k, 280.0, blob=3)
        here = [other] if 20 <= k < 25 else [mine, other]
        group = GroupTrack(
            4, (280.0, 200.0, 40.0, 40.0), True, False, [2, 7] if k >= 25 else [1, 7]
        )
        lone = GroupTrack(5, (0.0, 0.0, 5.0, 5.0), True, False, [7, 99])
        frames.append(
            Targets(
                k, here, [group, lone], [Notice("anomaly", [2], "r")] if k == 40 else []
            )
        )
    out = _run(frames)
    assert [(g.id, g.members) for g in out[40].group_tracks or []] == [(4, [1, 7])]
    assert [(f, n.subjects) for f, n in _notices(out, "anomaly")] == [(40, [1])]


def test_nothing_at_all() -> None:
    assert _run([]) == []
    out = _run([Targets(k) for k in range(5)])
    assert all(not f.targets and not f.notices for f in out)


def test_exchanged_identities_are_put_right_from_when_it_happened() -> None:
    frames = []
    for k in range(80):
        left, right = (1, 2) if not 30 <= k < 40 else (2, 1)
        here = [_target(left, k, 100.0), _target(right, k, 300.0)]
        told = (
            [Notice("track_recovered", [1, 2], "colours", since_frame=30)]
            if k == 40
            else []
        )
        group = GroupTrack(1, (100.0, 200.0, 220.0, 40.0), True, False, [1, 2])
        frames.append(Targets(k, sorted(here, key=lambda t: t.id), [group], told))
    out = list(
        rewrite(lambda: iter(frames), SCENE, [k * FRAME_NS for k in range(80)], _config())
    )
    assert all(
        [t.box[0] for t in f.targets] == pytest.approx([100.0, 300.0], abs=1.0) for f in out
    )
    assert all(t.observed for f in out for t in f.targets)


def test_two_exchanges_one_after_the_other() -> None:
    where = {1: 100.0, 2: 300.0, 3: 500.0}
    frames = []
    for k in range(60):
        name = {1: 1, 2: 2, 3: 3}
        if 10 <= k < 40:
            name = {1: 2, 2: 1, 3: 3}
        if 20 <= k < 30:
            name = {1: 3, 2: 1, 3: 2}
        told = []
        if k == 30:
            told = [Notice("track_recovered", [2, 3], "colours", since_frame=20)]
        if k == 40:
            told = [Notice("track_recovered", [1, 2], "colours", since_frame=10)]
        here = [_target(name[i], k, x) for i, x in where.items()]
        frames.append(Targets(k, sorted(here, key=lambda t: t.id), None, told))
    out = list(
        rewrite(lambda: iter(frames), SCENE, [k * FRAME_NS for k in range(60)], _config())
    )
    assert all(
        [t.box[0] for t in f.targets] == pytest.approx([100.0, 300.0, 500.0], abs=1.0)
        for f in out
    )


def test_who_is_followed_aside_goes_on_with_a_life_that_is_told_and_is_none_by_itself() -> (
    None
):
    aside = [
        Targets(f.frame, [replace(t, present=t.id == 1) for t in f.targets])
        for f in _walk(60, range(20, 32))
    ]
    out = _run(aside)
    assert [[t.id for t in frame.targets] for frame in out] == [[1]] * 60
    assert all(t.present for frame in out for t in frame.targets)
    before = [
        Targets(f.frame, [replace(t, present=t.id == 2) for t in f.targets])
        for f in _walk(60, range(20, 32))
    ]
    assert [t.id for frame in _run(before) for t in frame.targets] == [2] * 28, (
        "a life begins where it is told to"
    )


def _passers_by(count: int) -> Iterable[Targets]:
    """One after the other crosses the picture, each for two seconds."""
    for k in range(count):
        for step in range(20):
            sighted = [TrackSighting(20 * k, (50.0, 200.0, 20.0, 40.0))]
            notices = (
                [Notice("track_confirmed", [k + 1], "", sightings=sighted)]
                if step == 3
                else []
            )
            here = (
                [_target(k + 1, step, 50 + 20.0 * step, signature=[step, 1] * 16)]
                if step >= 3
                else []
            )
            yield Targets(20 * k + step, here, None, notices)


def _rewritten(count: int) -> int:
    times = [k * FRAME_NS for k in range(20 * count)]
    return sum(
        len(answer.targets)
        for answer in rewrite(lambda: _passers_by(count), SCENE, times, _config())
    )


def _most_memory(count: int) -> int:
    tracemalloc.start()
    try:
        assert _rewritten(count) >= 17 * count
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def test_a_life_that_is_over_takes_little_memory() -> None:
    # msgspec keeps up to 2,000 messages of a size that were let go, and empties that store now and
    # then in a collection: memory would be counted in whichever run fills it anew.
    gc.disable()
    try:
        _rewritten(400)  # what is loaded and kept once
        assert _most_memory(150) - _most_memory(50) < 100 * 4_000
    finally:
        gc.enable()


def _apart(frames: list[Targets], *pairs: tuple[int, int]) -> list[Targets]:
    times = [k * FRAME_NS for k in range(len(frames))]
    return list(rewrite(lambda: iter(frames), SCENE, times, _config(), None, pairs))


def test_who_is_said_to_be_two_is_not_joined() -> None:
    frames = _walk(60, range(25, 30))
    joined = {t.id for answer in _apart(frames) for t in answer.targets}
    assert joined == {1}
    for pair in ((1, 2), (2, 1)):
        told = _apart(frames, pair)
        assert {t.id for answer in told for t in answer.targets} == {1, 2}
        # Nobody is drawn through the gap between them.
        assert not any(t.present for answer in told[25:30] for t in answer.targets)


def test_of_a_chain_the_dearest_join_between_the_two_goes() -> None:
    frames = _walk(90, range(20, 22))
    third = []
    for answer in frames:
        hidden = answer.frame in range(50, 60)
        later = [
            replace(t, id=3) if t.id == 2 and answer.frame >= 60 else t
            for t in answer.targets
            if not hidden
        ]
        third.append(replace(answer, targets=later))
    assert {t.id for a in _apart(third) for t in a.targets} == {1}
    told = _apart(third, (3, 1))
    # From 1 to 2 is a short gap, from 2 to 3 a long one.
    assert {t.id for t in told[70].targets} == {3}
    assert {t.id for a in told[:50] for t in a.targets} == {1}
    assert [a.targets for a in _apart(third, (1, 9))] == [a.targets for a in _apart(third)]
