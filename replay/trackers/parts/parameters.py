"""Parameters of the PARTS tracker. Lengths are in units of the target's width or height, times in
seconds.
"""

from __future__ import annotations

from dataclasses import dataclass

from recorders.parameters import Parameters, param
from replay.trackers import common_parameters as common


@dataclass(frozen=True)
class PartsParameters(Parameters):
    """Global and parts model, dynamical model, layered data association (PARTS 2 to 4)."""

    hindsight: bool = common.hindsight(True)
    init: str = param(
        "",
        "targets that are started by hand: frame:N:x,y,w,h, several parted by ';'. With"
        " any, nothing else starts one",
        source="PARTS 3",
    )
    use_parts: bool = param(
        True, "off: candidates are scored by place and size alone (for comparison)"
    )
    use_heads: bool = param(
        True,
        "off: no head detection, merged blobs give no candidates of their own (for"
        " comparison)",
    )
    use_pruning: bool = param(
        True,
        "off: near-equal candidates are not told apart by the head's image (for"
        " comparison)",
    )
    gate_speeds: float = param(
        2.0,
        "half side of the gate over the way at the present speed",
        low=0.0,
        high=100.0,
        source="PARTS 3",
    )
    gate_sigmas: float = param(
        4.0,
        "and so many standard deviations of what the filter's place is off",
        low=0.0,
        high=100.0,
    )
    gate_most: float = param(
        2.0, "largest half side of the gate", unit="target heights", low=0.1, high=100.0
    )
    occlusion: float = param(
        0.5,
        "a candidate that much wider, higher or smaller is occluded",
        low=0.05,
        high=5.0,
        source="PARTS 3.1",
    )
    size_step: float = param(
        0.05,
        "step of the five sizes under a head",
        low=0.0,
        high=0.2,
        source="PARTS eq. 9, 10",
    )
    centroid_frames: int = param(
        4,
        "window of the running means of alpha and beta",
        unit="frames",
        low=1,
        high=100,
        source="PARTS 2.1: 3 to 5",
    )
    match_score: float = param(
        0.55, "least global score of a match", low=0.0, high=1.0, source="PARTS 4"
    )
    ratio: float = param(
        1.06, "the best candidate's score over its runner-up's, else the head's image decides", low=1.0, high=10.0,
        source="PARTS 4",
    )  # fmt: skip
    weak: float = param(
        0.8, "candidates that are all weak, down to this share of match_score, are told apart by the head's image, too",
        low=0.0, high=1.0, source="PARTS 4.1",
    )  # fmt: skip
    head_levels: float = param(
        45.0,
        "a head's image that differs more than this everywhere fits nowhere",
        unit="of 255 levels",
        low=0,
        high=255,
    )
    whole: float = param(
        0.75,
        "share of match_score that suffices for a whole blob that can be nobody else",
        low=0.0,
        high=1.0,
    )
    colours: float = param(
        0.2,
        "but not where the colours by themselves score less than this",
        low=0.0,
        high=1.0,
    )
    coincide: float = param(
        0.75, "IoU of two targets' boxes from which on one gives way", low=0.05, high=1.0
    )
    alone_change: float = param(
        0.35,
        "a blob that much wider or higher than its lone target is compared part by part"
        " first",
        low=0.0,
        high=5.0,
    )
    crowd_change: float = param(
        0.25,
        "a blob of several detections that much larger than a target is not the target"
        " alone",
        low=0.0,
        high=5.0,
    )
    empty: float = param(
        1 / 3,
        "a part with less than this share of the foreground that it used to have is hidden",
        low=0.0,
        high=1.0,
    )
    stands: float = param(
        0.2,
        "a target up to this speed may stand behind something that nobody tracks",
        unit="heights/s",
        low=0,
        high=10,
    )
    pieces_near: float = param(
        0.5,
        "the pieces of a target behind something lie within its box grown by this",
        unit="widths",
        low=0,
        high=5,
    )
    pieces_least: float = param(
        0.03,
        "a target behind something has at least this share of its box in foreground",
        low=0.0,
        high=1.0,
    )
    pieces_s: float = param(
        20.0, "and hold it for so long after its last match", unit="s", low=0.0, high=3600.0
    )
    part_score: float = param(
        0.35, "least score of a part that matches", low=0.0, high=1.0, source="PARTS 4.2"
    )
    hidden_score: float = param(
        0.4, "what a part that others cover counts for", low=0.0, high=1.0
    )
    hidden_cover: float = param(
        0.5, "a part is hidden if nearer targets cover this much of it", low=0.05, high=1.0
    )
    min_fill: float = param(
        0.3, "least share of foreground in the parts that nobody covers", low=0.0, high=1.0
    )
    min_visible: float = param(
        0.3, "least visible share of an observed target, by gamma", low=0.0, high=1.0
    )
    learn_most: float = param(
        0.3, "largest weight of a new observation in a part's model", low=0.0, high=1.0
    )
    learn_s: float = param(
        0.2,
        "a lone target's parts are compared and learnt this often",
        unit="s",
        low=0.0,
        high=60,
    )
    place_noise: float = param(
        0.06,
        "standard deviation of a measured centroid",
        unit="heights",
        low=0.001,
        high=10,
    )
    size_noise: float = param(
        0.08, "standard deviation of a measured size", unit="heights", low=0.001, high=10
    )
    agility: float = param(
        0.7,
        "standard deviation of a target's acceleration",
        unit="heights/s^2",
        low=0,
        high=1e3,
    )
    size_agility: float = param(
        0.05,
        "standard deviation of the acceleration of a target's width and height",
        unit="heights/s^2",
        low=0,
        high=1e3,
    )
    confirm_s: float = common.confirm_s(0.25)
    confirm_hits: int = common.confirm_hits(3)
    tentative_s: float = common.tentative_s(0.3)
    coast_s: float = common.coast_s(0.5)
    keep_s: float = common.keep_s(2.0)
    min_unexplained: float = param(
        0.5, "a detection with less foreground of its own starts nothing", low=0, high=1
    )
    trunk: float = param(
        0.6, "a body hides what is behind this share of its box's width", low=0.0, high=1.0
    )
    nearer: float = param(
        0.03,
        "a foot that much lower is nearer to the camera",
        unit="heights",
        low=0.0,
        high=10,
    )
    linked: float = param(
        0.08,
        "a blob with this share of a target's box in foreground concerns the target",
        low=0.0,
        high=1.0,
    )
    far: float = param(
        0.8,
        "boxes alone match up to this mean of the way in gates and the overlap that is missing",
        low=0.01,
        high=10.0,
    )
    pieces_inside: float = param(
        0.9, "least share of a piece's box that lies in the target's", low=0.0, high=1.0
    )
    pieces_most: float = param(
        0.5,
        "more foreground than this share of the target's box is a body",
        low=0.0,
        high=1.0,
    )
    same_place: float = param(
        0.4,
        "IoU from which on a target drawn by hand is whom the tracker knew",
        low=0,
        high=1,
    )
    split_share: float = param(
        0.3,
        "a new target that covers this much of another's last box was born of a split",
        low=0.0,
        high=1.0,
    )
    nearby: float = param(
        0.6,
        "candidates within this of the best one are told apart by the head's image",
        unit="target heights",
        low=0.0,
        high=10.0,
        source='PARTS 4.1: "nearby"',
    )
    taken: float = param(
        0.6,
        "IoU with the box of who is placed from which on a candidate is no candidate",
        low=0.05,
        high=1.0,
    )
    learn_alone: float = param(
        0.3,
        "least score with which parts of a target alone in its blob are learnt",
        low=0.0,
        high=1.0,
    )
    sure_score: float = param(
        0.7, "a match of this score or more is as sure as can be", low=0.01, high=1.0
    )
    body_spread: float = common.body_spread(0.12)
