"""Parameters of the EVENTS tracker. Lengths are in units of the target's size (the root of its
box's area), times in seconds, so that they hold at other resolutions, frame rates and kinds of
targets.
"""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param
from replay.trackers import common_parameters as common


@dataclass(frozen=True)
class EventsParameters(Parameters):
    """How low-level tracks are held, confirmed, lost and removed (EVENTS 2)."""

    hindsight: bool = common.hindsight(True)
    place_noise: float = param(
        0.1, "standard deviation of a measured centre", unit="sizes", low=0.001, high=10.0
    )
    size_noise: float = param(
        0.12,
        "standard deviation of a measured width or height",
        unit="sizes",
        low=0.001,
        high=10,
    )
    agility: float = param(
        1.0,
        "standard deviation of a target's acceleration",
        unit="sizes/s^2",
        low=0.0,
        high=1e3,
    )
    size_drift: float = param(
        0.05,
        "standard deviation of the change of width and height in a second",
        unit="sizes",
        low=0.0,
        high=1e3,
    )
    body_spread: float = common.body_spread(0.12)
    lean_s: float = param(
        1.0,
        "the usual size counts as one measurement in this time",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    speed: float = param(
        1.5, "standard deviation of a new target's speed", unit="sizes/s", low=0.0, high=1e3
    )
    looseness: float = param(
        1.4,
        "a place that was searched for is so many times less exact than a measured one",
        low=0.1,
        high=100.0,
    )
    surprise: float = param(
        1.5,
        "from this innovation on a manoeuvre is assumed",
        unit="standard deviations",
        low=0.1,
        high=1e6,
    )
    gate: float = param(
        4.0,
        "furthest innovation that is associated",
        unit="standard deviations",
        low=0.1,
        high=100.0,
    )
    min_overlap: float = param(
        0.3, "least IoU of a detection with the predicted box", low=0.0, high=1.0
    )
    confirm_s: float = common.confirm_s(0.25, but="; one of detections alone need not wait")
    confirm_hits: int = common.confirm_hits(3)
    tentative_s: float = common.tentative_s(0.3)
    coast_s: float = common.coast_s(0.3)
    keep_s: float = common.keep_s(4.0)
    size_tolerance: float = param(
        0.3,
        "a blob this much higher or lower than its target is not the target alone",
        low=0.01,
        high=10.0,
    )
    patience_s: float = param(
        0.7,
        "a lone target's blob is believed after differing in size for this time",
        unit="s",
        low=0.0,
        high=60.0,
    )
    ring_weight: float = param(
        0.6, "cost of foreground around a placed box", low=0.0, high=10.0
    )
    colour_weight: float = param(
        0.5, "worth of pixels with the target's own colours", low=0.0, high=10.0
    )
    prior_weight: float = param(
        0.02,
        "cost of a place one standard deviation off the prediction",
        low=0.0,
        high=10.0,
    )
    sweeps: int = param(
        2, "rounds in which merged targets are placed against one another", low=1, high=10
    )
    min_own: float = param(
        0.2, "least share of a placed box that is foreground of its own", low=0.0, high=1.0
    )
    min_unexplained: float = param(
        0.5, "a detection with less foreground of its own is explained", low=0.0, high=1.0
    )
    learn_s: float = param(
        0.25, "a lone target's colours are learnt this often", unit="s", low=0.0, high=60.0
    )
    drift: float = param(
        0.5,
        "how far a lost target may be off its path at once",
        unit="sizes",
        low=0.01,
        high=100.0,
    )
    drift_rate: float = param(
        0.5, "and its growth while it is lost", unit="sizes/s", low=0.0, high=100.0
    )
    recover_cost: float = param(
        0.9, "dearest match of a lost target with a new track", low=0.0, high=100.0
    )
    min_likeness: float = param(
        0.25, "least likeness of colours that holds a target", low=-1.0, high=1.0
    )
    top_down_s: float = param(
        2.5,
        "a target without a detection or blob is looked for by its colours for so long"
        " (matching case 3)",
        unit="s",
        low=0.0,
        high=3600.0,
        source="EVENTS 2 (value ours)",
    )
    min_shared: float = param(
        0.5,
        "a detection that covers this share of a second target may be merged",
        low=0.0,
        high=1.0,
    )
    hidden_patience: float = common.hidden_patience(3.0)
    hold_s: float = param(
        0.0,
        "targets whose blob came apart count as being in one blob for this long still (damps"
        " flicker; 0 is the paper's rule)",
        unit="s",
        low=0.0,
        high=60.0,
        source="EVENTS 3.1",
    )
    min_alike: float = param(
        0.3,
        "a target in a shared blob of whose own colours less is seen where it was placed is"
        " hidden",
        low=0.0,
        high=1.0,
    )
    min_part: float = param(
        0.5,
        "a blob of this share of a body's height may be its lower part",
        unit="heights",
        low=0.0,
        high=10.0,
    )
    exchange_ratio: float = param(
        0.6,
        "targets leaving a blob were taken for one another if their colours differ by less"
        " than this share then",
        low=0.0,
        high=1.0,
    )
    exchange_s: float = param(
        3.0,
        "whoever left a blob for this long is who it is",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    recover_colour_cost: float = param(
        2.0,
        "cost of entirely different colours when a lost target is looked for",
        low=0.0,
        high=100.0,
    )
