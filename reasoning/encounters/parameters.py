"""Thresholds of the encounters, in body sizes and seconds."""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param


@dataclass(frozen=True)
class EncounterParameters(Parameters):
    """Thresholds of the encounters. A body size is the mean diagonal of the two boxes."""

    near_sizes: float = param(
        1.0,
        "together for sure where they stand within this distance",
        unit="body sizes",
        low=0.1,
        high=10,
    )
    far_gap_sizes: float = param(
        0.7,
        "approach begins and parting ends with this room between their boxes",
        unit="body sizes",
        low=0.0,
        high=20,
    )
    pace_sizes_per_s: float = param(
        0.6,
        "together for sure up to this relative speed",
        unit="body sizes/s",
        low=0.05,
        high=20,
    )
    drift_sizes_per_s: float = param(
        0.3,
        "mean relative velocity from the first to the last moment together for sure, at"
        " most",
        unit="body sizes/s",
        low=0.01,
        high=20,
    )
    moved_sizes: float = param(
        0.5,
        "one of the two gets at least this far from where it was, from first to last moment",
        unit="body sizes",
        low=0.0,
        high=20,
    )
    least_s: float = param(1.5, "least time together for sure", unit="s", low=0.0, high=60)
    live_s: float = param(
        0.4, "live, an encounter is announced after this time", unit="s", low=0.0, high=60
    )
    gap_s: float = param(1.0, "gaps up to this long are closed", unit="s", low=0.0, high=60)
    window_s: float = param(
        0.5, "distances are median filtered over this time", unit="s", low=0.0, high=10
    )
    walk_sizes_per_s: float = param(
        0.15,
        "who walks is at least this fast; two who approach or part do it at this speed",
        unit="body sizes/s",
        low=0.0,
        high=10,
    )
    touch_sizes: float = param(
        0.6, "touching distance", unit="body sizes", low=0.05, high=5
    )
    abrupt_sizes_per_s: float = param(
        0.4,
        "abrupt: relative speed over half a second of two who touch, from here",
        unit="body sizes/s",
        low=0.05,
        high=20,
    )
    through_share: float = param(
        0.85,
        "who is abrupt goes through, and does not fight, where the way from the first to"
        " the last moment of it is over this share of what a straight line at that speed"
        " would be",
        unit="share",
        low=0.0,
        high=10,
    )
