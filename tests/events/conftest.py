"""Scenes and their truth are made once for all tests of this room."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import pytest

from fixtures.scenes import GeneratedScene, generate
from fixtures.targets import truth_targets
from recorders.messages import Targets

Play = tuple[GeneratedScene, list[Targets]]


@cache
def _play(name: str, seed: int = 0) -> Play:
    scene = generate(name, seed, frames=125 if name == "crowd" else None)
    return scene, list(truth_targets(scene))


@pytest.fixture(scope="session")
def play() -> Callable[..., Play]:
    """``play(name, seed=0)``: a scene and the answers of a tracker without a fault; of the crowd
    the first 5 s.
    """
    return _play
