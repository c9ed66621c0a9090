"""Parameters of the hindsight step: lengths in units of the target's size, times in seconds."""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param


@dataclass(frozen=True)
class HindsightParameters(Parameters):
    """What may be joined, filled, smoothed and dropped once the whole recording is known."""

    join_s: float = param(
        5.0,
        "longest gap that is joined; time in which nobody could be seen does not count",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    join_cost: float = param(
        1.0, "dearest join; a join costs less than two loose ends", low=0.0, high=100.0
    )
    drift: float = param(
        0.5,
        "standard deviation of a straight path at once",
        unit="sizes",
        low=0.01,
        high=100.0,
    )
    drift_rate: float = param(
        0.8, "and its growth over a gap", unit="sizes/s", low=0.0, high=100.0
    )
    appearance_weight: float = param(
        2.0, "cost of entirely different colours", low=0.0, high=100.0
    )
    gap_weight: float = param(
        0.1, "cost of a second without any sighting", unit="1/s", low=0.0, high=100.0
    )
    fill_s: float = param(
        3.0, "longest gap that is filled with a path", unit="s", low=0.0, high=60.0
    )
    blur: float = param(
        0.15,
        "a gap is filled where the path through it is known at least so well",
        unit="sizes",
        low=0.0,
        high=100.0,
    )
    min_life_s: float = param(
        0.8,
        "a path shorter than this (half of it where the recording cuts it off) is dropped",
        unit="s",
        low=0.0,
        high=60.0,
    )
    min_support: float = param(
        0.3, "least share of frames with an observation", low=0.0, high=1.0
    )
    things: bool = param(
        False,
        "of what is seen as pixels also what never goes anywhere is told, not only what"
        " somebody left",
    )
    place_noise: float = param(
        0.10, "standard deviation of an observed centre", unit="sizes", low=0.001, high=10.0
    )
    size_noise: float = param(
        0.15, "standard deviation of an observed extent", unit="sizes", low=0.001, high=10
    )
    agility: float = param(
        1.0, "standard deviation of acceleration", unit="sizes/s^2", low=0.001, high=1000.0
    )
    size_agility: float = param(
        0.1,
        "standard deviation of the acceleration of width and height",
        unit="sizes/s^2",
        low=0.001,
        high=1000.0,
    )
