"""Two tracks on one body: the second is held back; who passes behind somebody is not."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from fixtures.logs import write_scene_log
from fixtures.scenes import generate
from recorders.annotated.reader import AnnotatedLog
from recorders.messages import Box, Mode, Target, Targets
from recorders.parameters import configure
from recorders.scene import SceneInfo
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.hindsight import SECTIONS, rewrite
from replay.run import ReplayOptions

FRAME_NS = 100_000_000
SCENE = SceneInfo(640, 480, FRAME_NS, False, False)


def told(*paths: Callable[[int], Box | None], frames: int = 40) -> list[Targets]:
    """What hindsight says of targets 1, 2, ... on these paths."""
    forward = []
    for k in range(frames):
        boxes = [(i, path(k)) for i, path in enumerate(paths, 1)]
        forward.append(Targets(k, [Target(i, b, measured=b) for i, b in boxes if b]))
    times = [k * FRAME_NS for k in range(frames)]
    return list(rewrite(lambda: iter(forward), SCENE, times, configure(SECTIONS)))


def ids(out: list[Targets]) -> set[int]:
    """Everybody that is told."""
    return {t.id for f in out for t in f.targets}


def walker(k: int) -> Box:
    """Somebody on the way to the right."""
    return (50.0 + 5 * k, 100.0, 30.0, 90.0)


def test_a_part_that_goes_with_its_body_is_none_of_its_own() -> None:
    out = told(lambda k: (55.0 + 5 * k, 100.0, 20.0, 50.0), walker)
    assert ids(out) == {2}
    assert {w.reason for f in out for w in f.held_back or ()} == {
        "at one place with track 2 for 1.00 of its life: one body"
    }
    assert sum(len(f.held_back or ()) for f in out) == 40


def test_a_larger_box_that_lives_shortly_is_no_body_either() -> None:
    def around(k: int) -> Box | None:
        return (40.0 + 5 * k, 80.0, 50.0, 130.0) if 10 <= k < 20 else None

    assert ids(told(walker, around)) == {1}


@pytest.mark.parametrize(
    ("alone", "apart", "kept"), [(3, 12, False), (20, 12, True), (3, 26, True)]
)
def test_who_is_lost_in_a_crowd_goes_on_with_those_who_were_there(
    alone: int, apart: int, kept: bool
) -> None:
    """A third comes by, is seen alone for a while, and is then placed between two."""
    forward = []
    for k in range(40):
        x = 100.0 + 5 * k
        two = [(x, 100.0, 20.0, 50.0), (x + 2 * apart, 100.0, 20.0, 50.0)]
        here = [Target(i, b, measured=b) for i, b in enumerate(two, 1)]
        if k >= 8:
            by_himself = k < 8 + alone
            third = (
                (x + 90.0, 100.0, 20.0, 50.0)
                if by_himself
                else (x + apart, 100.0, 20.0, 50.0)
            )
            mode: Mode = "motion" if by_himself else "appearance"
            here.append(Target(3, third, measured=third, mode=mode))
        forward.append(Targets(k, here))
    times = [k * FRAME_NS for k in range(40)]
    out = list(rewrite(lambda: iter(forward), SCENE, times, configure(SECTIONS)))
    assert ids(out) == ({1, 2, 3} if kept else {1, 2})


def test_pieces_of_a_body_that_comes_apart_are_one() -> None:
    def upper(k: int) -> Box:
        x, y, w, h = walker(k)
        return (x, y, w, h if k < 15 else 50.0)

    def lower(k: int) -> Box | None:
        x, y, w, h = walker(k)
        return (x + 2, y + 52, w - 4, h - 52) if k >= 15 else None

    out = told(upper, lower)
    assert ids(out) == {1}
    assert sum(len(f.held_back or ()) for f in out) == 25


def test_somebody_far_away_behind_who_is_seen_whole_is_somebody() -> None:
    def far(k: int) -> Box | None:
        return (75.0 + 5 * k, 95.0, 12.0, 30.0) if k >= 15 else None

    assert ids(told(walker, far)) == {1, 2}


def test_who_comes_out_of_a_body_s_place_and_is_as_large_is_somebody() -> None:
    def other(k: int) -> Box | None:
        return (125.0 - 2 * (k - 15), 102.0, 30.0, 90.0) if k >= 15 else None

    assert ids(told(walker, other)) == {1, 2}


def test_who_passes_behind_somebody_is_told() -> None:
    def other(k: int) -> Box:
        return (250.0 - 5 * k, 105.0, 28.0, 80.0)

    assert ids(told(walker, other)) == {1, 2}


def test_two_who_walk_side_by_side_are_two() -> None:
    assert ids(told(walker, lambda k: (70.0 + 5 * k, 102.0, 30.0, 90.0))) == {1, 2}


def test_what_is_held_back_lies_in_the_log(tmp_path: Path) -> None:
    scene = generate("full_occlusion", size=(160, 120), frames=80)
    path = write_scene_log(scene, tmp_path / "scene.mcap", pictures="none", masks=False)
    config = replay_config("events", assignments=["hindsight.min_life_s=60"])
    out = tmp_path / "out.mcap"
    replay(path, out, ReplayOptions(tracker="events", config=config))
    with AnnotatedLog(out) as log:
        frames = list(log.frames())
    assert not any(f.tracks for f in frames)
    reasons = {w.reason for f in frames for w in f.held_back or ()}
    assert reasons
    assert all(r.startswith("short: ") for r in reasons)
