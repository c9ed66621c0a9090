"""A frame's results as payloads of the annotated channels, in one fixed order."""

from __future__ import annotations

from msgspec import UNSET, UnsetType

from reasoning.reasoner import SceneAnnotation
from recorders import channels
from recorders.messages import EVENT_LEVELS, HeldBack, Regions, Targets, Withheld
from replay.image_annotations import drawing


def payloads(
    forward: Targets,
    scene: SceneAnnotation,
    regions: Regions,
    time_ns: int,
    stamp_ns: int,
    extra: tuple[tuple[str, bytes], ...],
    held_back: list[Withheld] | UnsetType = UNSET,
) -> list[tuple[str, bytes]]:
    """Channel names and payloads of one frame.

    Args:
        forward: what the tracker said in this frame, before hindsight.
        scene: what the reasoning made of it.
        regions: in force; drawn into the picture where they were recorded, said in the log where
            they are a default.
        time_ns: the frame's log time.
        stamp_ns: of the picture that the drawings belong to.
        extra: further payloads of the tracker (a membership image).
        held_back: what was followed and is not told.
    """
    drawn = None if regions.source == "default" else regions
    out = [
        ("targets", channels.encode("targets", forward)),
        ("tracks", channels.encode("tracks", scene.tracks)),
        ("relations", channels.encode("relations", scene.relations)),
        ("groups", channels.encode("groups", scene.groups)),
    ]
    if held_back:
        told = HeldBack(forward.frame, held_back)
        out.append(("held_back", channels.encode("held_back", told)))
    out += [("events", channels.encode("events", event)) for event in scene.events]
    if scene.graph is not None:
        out.append(("graph", channels.encode("graph", scene.graph)))
    out += extra
    size = regions.width, regions.height
    shown = drawing(scene.tracks, scene.relations, drawn, stamp_ns, size)
    out.append(("annotations", shown))
    if forward.frame == 0 and regions.source == "default":
        out.append(
            ("log", channels.log_line(_default_regions(regions), time_ns, "regions"))
        )
    out += [
        (
            "log",
            channels.log_line(
                event.text, time_ns, event.kind, EVENT_LEVELS.get(event.kind, "INFO")
            ),
        )
        for event in scene.events
    ]
    return out


def _default_regions(regions: Regions) -> str:
    corners = [
        f"({min(x)}, {min(y)}) to ({max(x)}, {max(y)})"
        for x, y in map(_axes, (regions.roi, regions.border))
    ]
    return (
        f"No regions were recorded: region of interest {corners[0]} px and security border"
        f" {corners[1]} px are derived from the picture's size (record --regions FILE sets"
        " them)"
    )


def _axes(polygons: list[list[tuple[float, float]]]) -> tuple[list[float], list[float]]:
    return [x for polygon in polygons for x, _ in polygon], [
        y for polygon in polygons for _, y in polygon
    ]
