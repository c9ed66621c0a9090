"""The trackers by name: the one place that knows them all. A plug-in is a line here."""

from __future__ import annotations

from collections.abc import Mapping

from recorders.parameters import Parameters
from replay.trackers import events, parts, shells
from replay.trackers.tracker import TrackerFactory

TRACKERS: Mapping[str, TrackerFactory] = {
    "events": events.make,
    "parts": parts.make,
    "shells": shells.make,
}
TRACKER_SECTIONS: Mapping[str, Mapping[str, type[Parameters]]] = {
    "events": events.SECTIONS,
    "parts": parts.SECTIONS,
    "shells": shells.SECTIONS,
}
