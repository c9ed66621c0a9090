"""What the events' evidence holds: one table, by kind, for who writes it and for who reads it.

A value that decided stands beside the limit that it was held against: ``unseen_s`` beside
``unseen_s_over``. `limit_of` finds the limit, so that `explain` can say by how much it was met.
A tracker's notices follow the same table; what hindsight reads of them are `Notice`'s own fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

LIMITS: Mapping[str, str] = {
    "_at_most": "<=",
    "_at_least": ">=",
    "_over": ">",
    "_under": "<",
}
"""Endings of the names of limits, and how the value is held against them."""


@dataclass(frozen=True)
class EvidenceShape:
    """One way in which a kind's evidence looks.

    Attributes:
        held: values each of which has its limit beside it.
        plain: other values that are always there.
        maybe: values that may be there, with or without a limit.
    """

    held: tuple[str, ...] = ()
    plain: tuple[str, ...] = ()
    maybe: tuple[str, ...] = ()


_TRACK = ("box", "mode", "confidence", "observed")
"""What is told of a track whose tracker says nothing of its life."""
_UNTOLD = EvidenceShape((), _TRACK, ("born_of_split", "blob", "mode_before"))
_PLACE = ("in_roi", "in_roi_and_border", "box", "regions")
_STATUS = ("status_before", "time_in_status_s")
_RELATION = (
    "case", "before", "after", "distance_px", "shell_radii_px", "shell_overlap",
    "same_blob", "time_in_state_s", "since_frame", "enter_margin", "leave_margin",
    "enter_duration_s", "leave_duration_s", "blob_duration_s",
)  # fmt: skip
_PAIR = EvidenceShape(
    ("safety_distance",),
    ("before", "after", "region", "time_in_state_s", "safety_margin"),
    ("inferred",),
)
_GROUP = (
    "observed", "source", "source_id", "ended", "began", "members_before", "joined", "left"
)  # fmt: skip
_RELATED = EvidenceShape(("shell_gap_px",), _RELATION, ("gone",))
_SEEN = EvidenceShape(
    ("within_roi_px",),
    (*_STATUS, *_PLACE),
)
_CROSSED = (
    "with", "price_as_themselves", "price_exchanged", "identity", "alternative",
    "alternative_probability",
)  # fmt: skip
_GONE = EvidenceShape((), (*_STATUS, "reason", "box", "regions"))

EVIDENCE: Mapping[str, tuple[EvidenceShape, ...]] = {
    "track_confirmed": (
        EvidenceShape(("hits", "age_s"), ("first_frame",)),
        EvidenceShape(("life_s", "support"), ("sightings", "fragments")),
        EvidenceShape((), ("hits", "age_s", "first_frame")),  # by hand
        EvidenceShape(("appearance",), ("hits", "first_frame")),  # a stranger
        _UNTOLD,
    ),
    "track_lost": (
        EvidenceShape(("unseen_s",), ("confidence",)),
        EvidenceShape((), ("fill_s",)),
        _UNTOLD,
    ),
    "track_recovered": (
        EvidenceShape(("unseen_s",), ("confidence",)),
        EvidenceShape(("cost",), ("unseen_s", "motion", "size"), ("appearance",)),
        EvidenceShape(("colour_distance",), ("unseen_s",)),
        EvidenceShape(("path_cost",), ("unseen_s",)),
        EvidenceShape(("exchanged",), ("as_they_were", "since_frame")),
        EvidenceShape(("appearance",), ("since_frame",)),
        EvidenceShape(("log_likelihood",), ("frames", "since_frame")),
        EvidenceShape(
            ("gap_s", "cost"), ("fragment", "after", "motion", "size"), ("appearance",)
        ),
        EvidenceShape(  # in part of the gap nobody could be seen
            ("watched_s", "cost"),
            ("fragment", "after", "gap_s", "motion", "size"),
            ("appearance",),
        ),
        EvidenceShape(("gap_s",)),
        EvidenceShape((), ("gap_s",)),  # its place was not known meanwhile
        _UNTOLD,
    ),
    "track_removed": (
        EvidenceShape(("unseen_s",), ("confidence", "box", "left_scene")),
        EvidenceShape(("confidence",), ("unseen_s", "box", "left_scene")),
        EvidenceShape((), ("unseen_s", "confidence", "box", "left_scene")),  # by its place
        EvidenceShape((), ("last_frame",)),
        _UNTOLD,
    ),
    "mode_changed": (
        EvidenceShape(("unseen_s",), ("from", "to", "confidence")),
        EvidenceShape((), ("from", "to", "unseen_s", "confidence")),
        EvidenceShape((), ("from", "to")),
        _UNTOLD,
    ),
    "entering": (_SEEN, EvidenceShape((), (*_STATUS, *_PLACE))),
    "entered": (_SEEN, EvidenceShape((), (*_STATUS, *_PLACE))),
    "returned": (_SEEN, EvidenceShape((), (*_STATUS, *_PLACE))),
    "exiting": (
        EvidenceShape(("beyond_border_px",), (*_STATUS, *_PLACE)),
        EvidenceShape((), (*_STATUS, *_PLACE)),
    ),
    "exited": (
        EvidenceShape(("beyond_border_px",), (*_STATUS, *_PLACE)),
        EvidenceShape((), (*_STATUS, *_PLACE)),
        _GONE,
    ),
    "interaction_started": (_RELATED,),
    "joined": (_RELATED,),
    "separated": (_RELATED,),
    "interaction_ended": (
        _RELATED,
        EvidenceShape((), (*_RELATION, "shell_gap_px", "gone")),
    ),
    "grouping": (_PAIR,),
    "grouped": (_PAIR,),
    "splitting": (_PAIR,),
    "single": (
        EvidenceShape(
            ("safety_distance",),
            ("state_before", "state_before_name", "partners_before", "safety_margin"),
            ("partners_gone", "safety_distances"),
        ),
        EvidenceShape(
            (),
            ("state_before", "state_before_name", "partners_before", "partners_gone"),
            ("safety_margin", "safety_distances"),
        ),
    ),
    "group_formed": (EvidenceShape(("count",), ("members",), _GROUP),),
    "group_changed": (EvidenceShape(("count",), ("members",), _GROUP),),
    "group_entered_scene": (EvidenceShape(("count",), ("members",), _GROUP),),
    "group_ended": (
        EvidenceShape(
            ("splitting_pairs",),
            ("members", "lasted_s", "since_frame", "gone"),
            _GROUP,
        ),
    ),
    "disagreement": (
        EvidenceShape(
            ("safety_distance",),
            (
                "interaction",
                "relation",
                "relation_expected",
                "blobs",
                "interaction_since_frame",
            ),
            ("shell_gap_px", "relation_since_frame"),
        ),
        EvidenceShape(("score",), ("gave_way",)),
    ),
    "anomaly": (
        EvidenceShape(("shell_gap_px",), ("distance_px", "shell_radii_px", "same_blob")),
        EvidenceShape(("safety_distance",), ("before", "safety_margin")),
        EvidenceShape((), ("from", "to", "why")),
    ),
    "zone_entered": (EvidenceShape(("inside_px",), ("zone", *_PLACE)),),
    "zone_left": (
        EvidenceShape(("inside_px",), ("zone", "time_in_zone_s", *_PLACE)),
        EvidenceShape((), ("zone", "time_in_zone_s", *_PLACE)),  # the zone is gone
        EvidenceShape((), ("zone", "time_in_zone_s", "reason", "box", "regions")),
    ),
    "occluded": (EvidenceShape(("evidence",), ("confidence",)),),
    "identity": (
        EvidenceShape(
            ("same",),
            ("gap_s", "identity", "alternative", "alternative_probability"),
            ("fragment", "after"),
        ),
        EvidenceShape(  # went by others
            ("same",),
            ("together_s", "way_sizes", "with", "alternative", "alternative_probability"),
        ),
        EvidenceShape(("same",), _CROSSED),
        EvidenceShape(("price_exchanged",), ("same", *_CROSSED)),
    ),
    "scene_changed": (
        EvidenceShape(("gap_s",), ("kind", "usual_s")),
        EvidenceShape(("light_change",), ("kind", "light", "light_before", "since_frame")),
        EvidenceShape(("tint_change",), ("kind", "red", "blue", "since_frame")),
        EvidenceShape(("coloured_share",), ("kind", "since_frame")),
        EvidenceShape(("moved_px",), ("kind", "right_px", "down_px", "since_frame")),
        EvidenceShape(("landmarks_share",), ("kind", "view", "view_before", "since_frame")),
        EvidenceShape(("one_colour_share",), ("kind", "colour", "since_frame")),
        EvidenceShape(("still_s",), ("kind", "since_frame")),
        EvidenceShape((), ("kind", "lost_s", "since_frame")),
    ),
}
"""Every kind's evidence, in all the ways in which it is found."""


def limit_of(name: str, evidence: Mapping[str, Any]) -> tuple[str, float | None]:
    """How a value is held against which limit, ("", None) where none stands beside it.

    >>> limit_of("unseen_s", {"unseen_s": 0.5, "unseen_s_over": 0.3})
    ('>', 0.3)
    """
    for ending, compare in LIMITS.items():
        limit = evidence.get(name + ending)
        if isinstance(limit, int | float) and not isinstance(limit, bool):
            return compare, float(limit)
    return "", None


def is_limit(name: str, evidence: Mapping[str, Any]) -> bool:
    """Whether a value is the limit of another one."""
    return any(name.endswith(e) and name.removesuffix(e) in evidence for e in LIMITS)


def unlike(kind: str, evidence: Mapping[str, Any]) -> str:
    """What is wrong with an event's evidence: "" where it has one of its kind's shapes."""
    shapes = EVIDENCE.get(kind)
    if shapes is None:
        return f"{kind}: no such kind"
    wrong = [_unlike(shape, evidence) for shape in shapes]
    return "" if "" in wrong else f"{kind}: " + "; or ".join(wrong)


def _unlike(shape: EvidenceShape, evidence: Mapping[str, Any]) -> str:
    names = [n for n in evidence if not is_limit(n, evidence)]
    known = (*shape.held, *shape.plain, *shape.maybe)
    wrong = [f"{n} is missing" for n in (*shape.held, *shape.plain) if n not in evidence]
    wrong += [f"{name} is unknown" for name in names if name not in known]
    wrong += [
        f"{n} has no limit"
        for n in shape.held
        if n in evidence and limit_of(n, evidence)[1] is None
    ]
    return ", ".join(wrong)
