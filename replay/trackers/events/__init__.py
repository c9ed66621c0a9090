"""EVENTS: motion, appearance, and reasoning over tracking events."""

from __future__ import annotations

from recorders.parameters import Config, Parameters
from replay.trackers.events.parameters import EventsParameters
from replay.trackers.events.tracker import EventsTracker
from replay.trackers.tracker import SceneInfo, Tracker

SECTIONS: dict[str, type[Parameters]] = {"events": EventsParameters}


def make(scene: SceneInfo, config: Config) -> Tracker:
    """Build the tracker for a scene from its configuration's section ``events``."""
    parameters = config["events"]
    assert isinstance(parameters, EventsParameters)
    return EventsTracker(scene, parameters)


__all__ = ["SECTIONS", "EventsParameters", "EventsTracker", "make"]
