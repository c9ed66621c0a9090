"""PARTS: tracking under heavy occlusion by a part-based model and layered data association."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reasoning.regions import RegionParameters
from recorders.lazy import lazily
from recorders.parameters import Config, Parameters
from replay.trackers.pace import paced
from replay.trackers.parts.parameters import PartsParameters
from replay.trackers.parts.scoring import PartFeatures
from replay.trackers.tracker import SceneInfo, Tracker

if TYPE_CHECKING:
    from replay.trackers.parts.tracker import PartsTracker

SECTIONS: dict[str, type[Parameters]] = {
    "parts": PartsParameters,
    "part_features": PartFeatures,
}


def make(scene: SceneInfo, config: Config) -> Tracker:
    """Build the tracker for a scene from its configuration's sections ``parts``,
    ``part_features`` and ``regions``.
    """
    parameters, features = config["parts"], config["part_features"]
    assert isinstance(parameters, PartsParameters)
    assert isinstance(features, PartFeatures)
    regions = config.get("regions", RegionParameters())
    assert isinstance(regions, RegionParameters)
    from replay.trackers.parts.tracker import PartsTracker

    return PartsTracker(
        scene, paced(parameters, scene.frame_ns), features, region_parameters=regions
    )


__all__ = ["SECTIONS", "PartFeatures", "PartsParameters", "PartsTracker", "make"]

# The tracker itself is loaded when it is made: the others only name their parameters.
__getattr__ = lazily({"replay.trackers.parts.tracker": "PartsTracker"})
