"""What detections alone say of how the camera moved."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest
from numpy.typing import NDArray

from replay.trackers.camera import CameraMotion
from replay.trackers.life import Living

Floats = NDArray[np.float64]
PEOPLE = np.array(
    [[50.0, 80, 20, 60], [150.0, 90, 22, 64], [260.0, 70, 18, 56], [400.0, 85, 24, 66]]
)
"""Where four people are expected, (4, 4)."""


def seen(moved: tuple[float, float], seed: int, steps: float = 0.03) -> Floats:
    """The same people after the camera moved, each with a step of their own."""
    own = np.random.default_rng(seed).normal(0.0, steps * 36.0, (len(PEOPLE), 2))
    found = PEOPLE.copy()
    found[:, :2] += own + np.array(moved)
    return found[::-1]


def most_of(moved: tuple[float, float], found: Floats) -> bool:
    """Whether a restless camera is believed for the greater part of a motion."""
    rest = restless().shift(PEOPLE, found) - np.array(moved)
    return bool(np.hypot(*rest) < 0.5 * np.hypot(*moved))


def restless(frames: int = 30) -> CameraMotion:
    """A camera that has been carried about."""
    camera = CameraMotion()
    way = np.random.default_rng(1).normal(0.0, 6.0, (frames, 2)).tolist()
    for k, (x, y) in enumerate(way):
        camera.shift(PEOPLE, seen((x, y), k))
    return camera


def test_a_camera_at_rest_does_not_move_whatever_people_do() -> None:
    camera = CameraMotion()
    for k in range(60):
        assert np.abs(camera.shift(PEOPLE, seen((0.0, 0.0), k))).max() < 0.05


@pytest.mark.parametrize("moved", [(8.0, 3.0), (-7.0, 5.0), (0.0, -9.0)])
def test_a_restless_camera_s_motion_is_everybody_s(moved: tuple[float, float]) -> None:
    assert most_of(moved, seen(moved, 99))


def test_one_who_runs_and_a_false_detection_do_not_move_the_camera() -> None:
    found = seen((8.0, 3.0), 99)
    found[0, :2] += 20.0
    found = np.concatenate([found, [[300.0, 300.0, 20.0, 60.0]]])
    assert most_of((8.0, 3.0), found)


def test_one_alone_or_nobody_tells_nothing() -> None:
    camera = restless()
    assert camera.shift(PEOPLE[:1], seen((8.0, 3.0), 5)).tolist() == [0.0, 0.0]
    assert camera.shift(PEOPLE, np.zeros((0, 4))).tolist() == [0.0, 0.0]
    assert camera.shift(np.zeros((0, 4)), PEOPLE).tolist() == [0.0, 0.0]


def test_it_goes_on_from_its_state() -> None:
    camera, again = restless(), CameraMotion()
    again.restore(camera.state())
    assert camera.shift(PEOPLE, seen((4.0, 4.0), 7)).tolist() == (
        again.shift(PEOPLE, seen((4.0, 4.0), 7)).tolist()
    )


def test_only_who_was_seen_in_the_last_frame_and_what_is_likely_tells_of_it() -> None:
    items = [Living(k + 1, 0, 0, 10, hits=5) for k in range(3)]
    items.append(Living(4, 0, 0, 9, hits=5))
    found = seen((8.0, 3.0), 99)
    likely = np.array([0.9, 0.9, 0.9, 0.2])
    told, plain = restless(), restless()
    moved = told.follow(items, PEOPLE, found, likely)
    assert moved.tolist() == plain.shift(PEOPLE[:3], found[:3]).tolist()


def test_a_crowd_votes_by_pairs_that_are_near() -> None:
    rng = np.random.default_rng(0)
    crowd = np.concatenate(
        [rng.uniform(0, 1400, (200, 2)), np.full((200, 2), 40.0)], axis=1
    )
    found = crowd + np.array([3.0, 1.0, 0.0, 0.0])
    camera = restless()
    tracemalloc.start()
    try:
        moved = camera.shift(crowd, found)
        assert tracemalloc.get_traced_memory()[1] < 50e6  # of all pairs it would be 250 MB
    finally:
        tracemalloc.stop()
    assert moved == pytest.approx([3.0, 1.0], abs=0.3)
