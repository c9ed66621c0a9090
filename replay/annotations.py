"""The drawings that Foxglove and Lichtblick lay over the picture: boxes, labels, shells, edges, regions."""

from __future__ import annotations

from typing import Any

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation

from recorders.channels import NANOS
from recorders.messages import Box, Regions, Relations, Track, Tracks
from replay.draw import part_box

_PALETTE = (
    (0.12, 0.47, 0.71),
    (1.00, 0.50, 0.05),
    (0.17, 0.63, 0.17),
    (0.84, 0.15, 0.16),
    (0.58, 0.40, 0.74),
    (0.09, 0.75, 0.81),
    (0.89, 0.47, 0.76),
    (0.74, 0.74, 0.13),
)
_INTERACTION = Color(r=1.0, g=0.85, b=0.2, a=0.9)
_JOINT = Color(r=1.0, g=0.25, b=0.2, a=1.0)
_ROI = Color(r=0.3, g=0.9, b=0.4, a=0.8)
_BORDER = Color(r=0.95, g=0.6, b=0.2, a=0.8)
_ZONE = Color(r=0.3, g=0.7, b=1.0, a=0.8)
_BLACK = Color(a=0.6)
_COLORS = tuple(Color(r=r, g=g, b=b, a=1.0) for r, g, b in _PALETTE)
_LOOP, _LINES = PointsAnnotation.LINE_LOOP, PointsAnnotation.LINE_LIST


def _corners(box: Box) -> list[Point2]:
    x, y, w, h = box
    return [Point2(x=x, y=y), Point2(x=x + w, y=y), Point2(x=x + w, y=y + h), Point2(x=x, y=y + h)]


def label(track: Track) -> str:
    """A track's label: id, and how it is held where that is not plain motion."""
    words = [f"{track.id}"]
    if track.mode != "motion":
        words.append(f"{track.mode} {track.confidence:.2f}")
    words += [bit for bit in ("grouping", "grouped", "splitting") if getattr(track, bit)]
    return " ".join(words)


def drawing(tracks: Tracks, relations: Relations, regions: Regions | None, time_ns: int) -> Any:
    """A foxglove.ImageAnnotations of one frame.

    Shells are circles around the boxes' centres (SHELLS 2.2); edges are thin for INTERACTION and thick for JOINT, as
    in SHELLS Figure 1d.
    """
    out = ImageAnnotations()
    seconds, nanos = divmod(time_ns, NANOS)
    out.timestamp.seconds, out.timestamp.nanos = seconds, nanos
    centres: dict[int, tuple[float, float]] = {}
    for track in tracks.tracks:
        x, y, w, h = track.box
        centres[track.id] = (x + w / 2, y + h / 2)
        color = _COLORS[track.id % len(_COLORS)]
        out.points.add(type=_LOOP, points=_corners(track.box), outline_color=color, thickness=2.0)
        circle = out.circles.add(diameter=2 * track.shell_radius, thickness=1.0, outline_color=color)
        circle.position.x, circle.position.y = centres[track.id]
        for name in track.hidden_parts:
            # The format knows no dashes; a cross says that nothing is to be seen there (PARTS, Figure 7).
            part = _corners(part_box(track.box, name))
            out.points.add(type=_LINES, points=[part[0], part[2], part[1], part[3]], outline_color=color, thickness=0.5)
        text = out.texts.add(text=label(track), font_size=12.0, text_color=color, background_color=_BLACK)
        text.position.x, text.position.y = x, y
    for edge in relations.relations:
        if edge.a in centres and edge.b in centres:
            ends = [Point2(x=px, y=py) for px, py in (centres[edge.a], centres[edge.b])]
            joint = edge.state == "JOINT"
            color = _JOINT if joint else _INTERACTION
            out.points.add(type=_LINES, points=ends, outline_color=color, thickness=4.0 if joint else 1.5)
    if regions is not None:
        _draw_regions(out, regions)
    return out


def _draw_regions(out: Any, regions: Regions) -> None:
    polygons = [(_BORDER, p) for p in regions.border] + [(_ROI, p) for p in regions.roi]
    for color, polygon in polygons + [(_ZONE, z.polygon) for z in regions.zones]:
        points = [Point2(x=x, y=y) for x, y in polygon]
        out.points.add(type=_LOOP, points=points, outline_color=color, thickness=1.0)
