"""What a tracker is: a frame in, its targets out. A plug-in is a class with this shape and a line
in a dict.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Protocol, runtime_checkable

from recorders.messages import Targets
from recorders.parameters import Config
from recorders.pictures import Image
from recorders.scene import Frame, SceneInfo

__all__ = [
    "Frame",
    "Image",
    "PayloadTracker",
    "Payloads",
    "SceneInfo",
    "State",
    "Tracker",
    "TrackerFactory",
]

State = Mapping[str, Any]


@runtime_checkable
class Tracker(Protocol):
    """A multi-object tracker. Its answers are a function of the frames so far and its
    configuration, alone.

    Ids come from a counter of the instance. No clock, no randomness, no iteration over sets; the
    instance keeps its whole state in itself, so that `state` and `restore` make it continue
    exactly where it was.
    """

    def step(self, frame: Frame) -> Targets:
        """Take the next frame, answer with all targets, by id."""
        ...

    def state(self) -> State:
        """The whole state after the last frame as plain data: dict, list, str, int, float, bool,
        None, bytes, ndarray.

        Dict keys are strings. A canonical encoding of it is the checkpoint.
        """
        ...

    def restore(self, state: State) -> None:
        """Continue from what `state` gave, on a fresh instance of the same scene and
        configuration.
        """
        ...


Payloads = tuple[tuple[str, bytes], ...]
"""Channels of a tracker's own in one frame: (name, payload) of each."""


@runtime_checkable
class PayloadTracker(Tracker, Protocol):
    """A tracker that writes channels of its own beside its targets, such as each target's pixels."""

    def extra_payloads(self, *, finished: bool) -> Payloads:
        """The channels' payloads for the last frame.

        Args:
            finished: True: as they are written. False: hindsight follows, which may give targets
                other ids; in a form that can still be renamed.
        """
        ...


TrackerFactory = Callable[[SceneInfo, Config], Tracker]
