"""EVENTS: motion, appearance, and reasoning over tracking events."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reasoning.regions import RegionParameters
from recorders.lazy import lazily
from recorders.parameters import Config, Parameters
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.pace import paced
from replay.trackers.tracker import SceneInfo, Tracker

if TYPE_CHECKING:
    from replay.trackers.events.tracker import EventsTracker

SECTIONS: dict[str, type[Parameters]] = {"events": EventsParameters}


def make(scene: SceneInfo, config: Config) -> Tracker:
    """Build the tracker for a scene from its configuration's section ``events`` (and ``regions``,
    EVENTS 3.2).
    """
    parameters = config["events"]
    assert isinstance(parameters, EventsParameters)
    regions = config.get("regions", RegionParameters())
    assert isinstance(regions, RegionParameters)
    from replay.trackers.events.tracker import EventsTracker

    return EventsTracker(scene, paced(parameters, scene.frame_ns), regions)


__all__ = ["SECTIONS", "EventsParameters", "EventsTracker", "make"]

# The tracker itself is loaded when it is made: the others only name their parameters.
__getattr__ = lazily({"replay.trackers.events.tracker": "EventsTracker"})
