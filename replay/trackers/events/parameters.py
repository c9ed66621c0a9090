"""Parameters of the EVENTS tracker. Lengths are in units of the target's size (the root of its box's area), times in
seconds, so that they hold at other resolutions, frame rates and kinds of targets.
"""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param


@dataclass(frozen=True)
class EventsParameters(Parameters):
    """How low-level tracks are held, confirmed, lost and removed (EVENTS 2)."""

    hindsight: bool = param(True, "join, fill and smooth the tracks after the forward pass")
    place_noise: float = param(0.10, "standard deviation of a measured centre", unit="sizes", low=0.001, high=10.0)
    size_noise: float = param(
        0.12, "standard deviation of a measured width or height", unit="sizes", low=0.001, high=10
    )
    agility: float = param(1.0, "standard deviation of a target's acceleration", unit="sizes/s^2", low=0.0, high=1e3)
    size_agility: float = param(
        0.2, "standard deviation of the acceleration of width and height", unit="sizes/s^2", low=0.0, high=1e3
    )
    speed: float = param(1.5, "standard deviation of a new target's speed", unit="sizes/s", low=0.0, high=1e3)
    gate: float = param(3.0, "furthest innovation that is associated", unit="standard deviations", low=0.1, high=100.0)
    min_overlap: float = param(0.15, "least IoU of a detection with the predicted box", low=0.0, high=1.0)
    high_score: float = param(0.7, "detections from this score on may start tracks", low=0.0, high=1.0)
    confirm_s: float = param(0.4, "a tentative track is confirmed after this time", unit="s", low=0.0, high=60.0)
    confirm_hits: int = param(3, "and after this many sightings", unit="frames", low=1, high=1000)
    tentative_s: float = param(0.3, "a tentative track unseen for longer is dropped", unit="s", low=0.0, high=60.0)
    coast_s: float = param(0.3, "an unseen target is held present for this time", unit="s", low=0.0, high=60.0)
    keep_s: float = param(4.0, "an unseen target may come back within this time", unit="s", low=0.0, high=3600.0)
    half_life_s: float = param(0.5, "an unseen target's confidence halves in this time", unit="s", low=0.001, high=3600)
