"""Parameters of the SHELLS tracker. Lengths are in units of the target's size (the root of its
box's area), areas in units of the target's own, times in seconds, so that they hold at other
resolutions, frame rates and kinds of targets.

The shells' growth with speed and the damping of the relations are the reasoning's own parameters
(sections ``shell_model`` and ``relations``): the tracker resolves the very relations that the
reasoning tells.
"""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param
from replay.trackers import common_parameters as common


@dataclass(frozen=True)
class ShellsParameters(Parameters):
    """Shells, pixel membership, position update and life of the objects (SHELLS 2.2 to 2.5)."""

    hindsight: bool = common.hindsight(True)
    membership: bool = param(True, "write each object's pixels to the membership channel")
    blend: float = param(
        0.8,
        "a of equation 9: weight of the pixels against the prediction, blend_s after the last"
        " frame and later",
        low=0.01,
        high=1.0,
        source="SHELLS eq. 9",
    )
    blend_s: float = param(
        0.04,
        "frames that come sooner weigh less: all of those in this time together weigh blend",
        unit="s",
        low=0.0001,
        high=10.0,
    )
    yielding: float = param(
        1.0,
        "how far E[P] yields to the placed mask, and a to the prediction, where an object"
        " is half seen; 0: equation 9",
        low=0.0,
        high=1.0,
    )
    placing: bool = param(
        True,
        "objects in shared blobs are placed before pixels are assigned; false: the paper's"
        " rule",
    )
    size_blend: float = param(
        0.5,
        "weight of the pixels against the prediction in the width and height of a lone object,"
        " in blend_s",
        low=0.01,
        high=1.0,
    )
    prior: float = param(
        1.0,
        "weight of the shell's Epanechnikov kernel in the membership",
        low=0.0,
        high=10.0,
    )
    colour: float = param(
        1.0, "weight of the colours in the membership", low=0.0, high=10.0
    )
    shape: float = param(
        1.0,
        "weight of the last mask in the membership; 0 is the paper's rule",
        low=0.0,
        high=10.0,
    )
    soft: bool = param(
        False, "positions and visible areas from shares of pixels in place of whole pixels"
    )
    disputed: float = param(
        0.0,
        "pixels whose two best owners differ by less (log) belong to nobody",
        low=0.0,
        high=10.0,
    )
    box_noise: float = param(
        0.15,
        "standard deviation of a detected box's centre, where there are no pixels",
        unit="sizes",
        low=0.01,
        high=10,
    )
    box_agility: float = param(
        1.0,
        "standard deviation of the acceleration of such boxes, at least",
        unit="sizes/s^2",
        low=0.0,
        high=1e3,
    )
    box_lively: bool = param(
        True, "and up to 16 times as much, as the recording's own targets turn out to be"
    )
    box_colour: float = param(
        1.0,
        "cost of entirely different colours, where detections compete and there are"
        " pictures",
        low=0.0,
        high=10.0,
    )
    hidden_cover: float = param(
        0.3,
        "an unseen object under another's box by this share is behind it",
        low=0.0,
        high=1.0,
    )
    agility: float = param(
        2.0,
        "standard deviation of an object's acceleration",
        unit="sizes/s^2",
        low=0.0,
        high=1e3,
    )
    speed: float = param(
        1.5, "standard deviation of a new object's speed", unit="sizes/s", low=0.0, high=1e3
    )
    larger: float = param(
        1.5,
        "a blob of more than this many areas is not one object alone",
        low=1.0,
        high=100.0,
    )
    smaller: float = param(
        0.5,
        "a blob of less than this share of the area is not the whole object",
        low=0.0,
        high=1.0,
    )
    patience_s: float = param(
        0.6,
        "a lone object's blob is believed after differing in size for this time",
        unit="s",
        low=0.0,
        high=60.0,
    )
    min_own: float = param(
        0.15, "an object with a smaller share of its area is hidden", low=0.0, high=1.0
    )
    twin_overlap: float = param(
        0.6, "boxes of this IoU claim one and the same body", low=0.0, high=1.0
    )
    twin_s: float = param(
        1.0,
        "of two that claim one body for longer, the worse seen one is hidden",
        unit="s",
        low=0.0,
        high=3600.0,
    )
    min_back: float = param(
        0.3, "one that was hidden comes back with this share of its area", low=0.0, high=1.0
    )
    agreement: float = param(
        0.3,
        "detected bodies, as many as objects, are their boxes from this IoU on; 1 never",
        low=0.0,
        high=1.0,
    )
    gap_cost: float = param(
        0.6, "cost of background within a placed object's mask", low=0.0, high=10.0
    )
    prior_cost: float = param(
        0.02,
        "cost of a place one standard deviation off the prediction",
        low=0.0,
        high=10.0,
    )
    depth_s: float = param(
        0.4,
        "who is in front is a running mean of the evidence over this time",
        unit="s",
        low=0.0,
        high=60.0,
    )
    depth_limit: float = param(
        0.15,
        "who is in front is told from this much evidence on",
        unit="areas",
        low=0.0,
        high=2.0,
    )
    learn_s: float = param(
        0.12,
        "a lone object's colours and mask are learnt this often",
        unit="s",
        low=0.0,
        high=60.0,
    )
    probation_s: float = param(
        0.6,
        "after a JOINT, time over which identities are compared before learning goes on",
        unit="s",
        low=0,
        high=60,
    )
    exchange: float = param(
        0.5,
        "identities are exchanged when colours say so by this much (log)",
        low=0.0,
        high=100.0,
    )
    confirm_s: float = common.confirm_s(0.25)
    confirm_hits: int = common.confirm_hits(3)
    tentative_s: float = common.tentative_s(0.3)
    min_unexplained: float = param(
        0.5, "a detection with less foreground of its own is explained", low=0.0, high=1.0
    )
    coast_s: float = common.coast_s(0.4)
    hidden_patience: float = common.hidden_patience(3.0)
    keep_s: float = common.keep_s(4.0)
    recover: float = param(
        0.55,
        "largest colour distance (Hellinger) of an object that comes back",
        low=0.0,
        high=1.0,
    )
    recover_path: float = param(
        0.4,
        "largest miss of an object without colours that comes back: half the squared miss of its"
        " path, and of its size",
        low=0.0,
        high=100.0,
    )
    body_spread: float = common.body_spread(0.12)
