"""A frame's results as payloads of the annotated channels, in one fixed order."""

from __future__ import annotations

import math

from reasoning.reasoner import SceneAnnotation

from recorders import channels
from recorders.errors import SceneTraceError
from recorders.messages import Regions, Targets
from replay.annotations import drawing


def payloads(
    forward: Targets,
    scene: SceneAnnotation,
    regions: Regions | None,
    time_ns: int,
    extra: tuple[tuple[str, bytes], ...],
) -> list[tuple[str, bytes]]:
    """Channel names and payloads of one frame.

    Args:
        forward: what the tracker said in this frame, before hindsight.
        scene: what the reasoning made of it.
        regions: drawn into the picture, if given.
        time_ns: the frame's log time.
        extra: further payloads of the tracker (a membership image).
    """
    out = [
        ("targets", channels.encode("targets", forward)),
        ("tracks", channels.encode("tracks", scene.tracks)),
        ("relations", channels.encode("relations", scene.relations)),
        ("groups", channels.encode("groups", scene.groups)),
    ]
    out += [("events", channels.encode("events", event)) for event in scene.events]
    if scene.graph is not None:
        out.append(("graph", channels.encode("graph", scene.graph)))
    out += extra
    out.append(
        ("annotations", channels.encode("annotations", drawing(scene.tracks, scene.relations, regions, time_ns)))
    )
    out += [("log", channels.log_line(event.text, time_ns, event.kind)) for event in scene.events]
    return out


def check_targets(answer: Targets, frame: int) -> None:
    """Hold a tracker to its protocol: finite boxes of positive size, ids that rise within the frame.

    Raises:
        SceneTraceError: the answer breaks it; names frame, target and value.
    """
    if answer.frame != frame:
        raise SceneTraceError(f"the tracker answered for frame {answer.frame} when asked for frame {frame}")
    previous = -1
    for target in answer.targets:
        if target.id <= previous:
            raise SceneTraceError(f"frame {frame}: target {target.id} after {previous}; ids must rise within a frame")
        previous = target.id
        x, y, w, h = target.box
        if not (math.isfinite(x + y + w + h) and w > 0 and h > 0):
            raise SceneTraceError(f"frame {frame}: target {target.id} has the box {target.box}")
        if not all(map(math.isfinite, (*target.velocity, target.confidence))):
            raise SceneTraceError(f"frame {frame}: target {target.id}: velocity or confidence is not finite")
