"""SHELLS: virtual shells, event resolution and pixel membership, straight through occlusions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from reasoning.regions import RegionParameters
from reasoning.relations import RelationParameters
from reasoning.shells import ShellParameters
from recorders.errors import UsageError
from recorders.lazy import lazily
from recorders.parameters import Config, Parameters
from replay.trackers.pace import paced
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.tracker import SceneInfo, Tracker

if TYPE_CHECKING:
    from replay.trackers.shells.tracker import ShellsTracker

SECTIONS: dict[str, type[Parameters]] = {"shells": ShellsParameters}


def make(scene: SceneInfo, config: Config) -> Tracker:
    """Build the tracker for a scene from its configuration's section ``shells`` and three of the
    reasoning.
    """
    parameters = config["shells"]
    shell, relation = (
        config.get("shell_model", ShellParameters()),
        config.get("relations", RelationParameters()),
    )
    assert isinstance(parameters, ShellsParameters)
    assert isinstance(shell, ShellParameters)
    if shell.outline == "ellipse":
        raise UsageError(
            "shell_model.outline = ellipse: the shells tracker's own shells enclose boxes,"
            " as pixels that are shared have no ellipse yet; leave it at smallest, or"
            " use box"
        )
    regions = config.get("regions", RegionParameters())
    assert isinstance(relation, RelationParameters)
    assert isinstance(regions, RegionParameters)
    from replay.trackers.shells.tracker import ShellsTracker

    return ShellsTracker(scene, paced(parameters, scene.frame_ns), shell, relation, regions)


__all__ = ["SECTIONS", "ShellsParameters", "ShellsTracker", "make"]

# The tracker itself is loaded when it is made: the others only name their parameters.
__getattr__ = lazily({"replay.trackers.shells.tracker": "ShellsTracker"})
