"""Trackers held to their protocol: whatever breaks it is told in words, not by what goes wrong
behind it.
"""

from __future__ import annotations

import math
from typing import Any

from recorders.errors import SceneTraceError
from recorders.messages import Targets
from recorders.parameters import Config
from recorders.scene import SceneInfo
from replay.configuration import tracker_name
from replay.trackers.tracker import Tracker, TrackerFactory


def made(factory: TrackerFactory, scene: SceneInfo, config: Config) -> Tracker:
    """Make a tracker that has what a tracker needs.

    Raises:
        SceneTraceError: it asks for parameters that its factory does not name, or lacks a method.
    """
    name = tracker_name(factory)
    try:
        tracker = factory(scene, config)
    except KeyError as e:
        section = e.args[0] if e.args else None
        if not isinstance(section, str) or section in config:
            raise
        raise SceneTraceError(
            f"the tracker {name} asks for the parameters {section!r}, which its factory"
            " does not name: give the class or function an attribute SECTIONS ="
            f" {{{section!r}: ...}} (a lambda has none; functools.partial keeps it)"
        ) from e
    missing = [
        method
        for method in ("step", "state", "restore")
        if not callable(getattr(tracker, method, None))
    ]
    if missing:
        words = " and ".join(f"{method}()" for method in missing)
        raise SceneTraceError(
            f"the tracker {name} lacks {words}: see replay.trackers.tracker.Tracker"
        )
    return tracker


def check_targets(answer: Any, frame: int) -> None:
    """Hold a tracker to its protocol: finite boxes of positive size, ids that rise within the
    frame.

    Raises:
        SceneTraceError: the answer breaks it; names frame, target and value.
    """
    if not isinstance(answer, Targets):
        raise SceneTraceError(
            f"frame {frame}: the tracker's step() answered {type(answer).__name__}, must be"
            " recorders.messages.Targets"
        )
    if answer.frame != frame:
        raise SceneTraceError(
            f"the tracker answered for frame {answer.frame} when asked for frame {frame}"
        )
    previous = -1
    for target in answer.targets:
        if target.id <= previous:
            raise SceneTraceError(
                f"frame {frame}: target {target.id} after {previous}; ids must rise within"
                " a frame"
            )
        previous = target.id
        x, y, w, h = target.box
        if not (math.isfinite(x + y + w + h) and w > 0 and h > 0):
            raise SceneTraceError(
                f"frame {frame}: target {target.id} has the box {target.box}"
            )
        if not all(map(math.isfinite, (*target.velocity, target.confidence))):
            raise SceneTraceError(
                f"frame {frame}: target {target.id}: velocity or confidence is not finite"
            )
