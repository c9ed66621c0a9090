"""Trackers held to their protocol: whatever breaks it is told in words, not by what goes wrong
behind it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from traceback import extract_tb
from typing import Any

from recorders.errors import SceneTraceError
from recorders.messages import Targets
from recorders.parameters import Config
from recorders.scene import SceneInfo
from replay.trackers.choice import TrackerChoice
from replay.trackers.tracker import Tracker


def make_tracker(choice: TrackerChoice, scene: SceneInfo, config: Config) -> Tracker:
    """Make a tracker that has what a tracker needs.

    Raises:
        SceneTraceError: it asks for parameters that its factory does not name, or lacks a method.
    """
    name = choice.title
    with code_of(choice):
        try:
            tracker = choice.factory(scene, config)
        except KeyError as error:
            section = error.args[0] if error.args else None
            if not isinstance(section, str) or section in config:
                raise
            raise SceneTraceError(
                f"the tracker {name} asks for the parameters {section!r}, which its factory"
                " does not name: give the class or function an attribute SECTIONS ="
                f" {{{section!r}: ...}} (a lambda has none; functools.partial keeps it)"
            ) from error
    missing = _missing(tracker)
    if missing:
        words = " and ".join(f"{method}()" for method in missing)
        raise SceneTraceError(
            f"the tracker {name} lacks {words}: see replay.trackers.tracker.Tracker"
        )
    return tracker


def is_tracker(found: Any) -> bool:
    """Whether a tracker, or a class of trackers, has what a tracker needs."""
    return not _missing(found)


def _missing(found: Any) -> list[str]:
    methods = ("step", "state", "restore")
    return [name for name in methods if not callable(getattr(found, name, None))]


@contextmanager
def code_of(choice: TrackerChoice, where: str = "") -> Iterator[None]:
    """Whatever goes wrong in a foreign tracker is said to come from it, with the line.

    Raises:
        SceneTraceError: in place of any other exception of a foreign tracker.
    """
    try:
        yield
    except SceneTraceError:
        raise
    except Exception as error:
        if not choice.foreign:
            raise
        last = extract_tb(error.__traceback__)[-1]
        raise SceneTraceError(
            f"{where}the tracker {choice.title} fails: {type(error).__name__}: {error}"
            f" ({Path(last.filename).name}, line {last.lineno})"
        ) from error


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
