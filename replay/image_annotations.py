"""The drawings that Foxglove and Lichtblick lay over the picture: boxes, labels, shells, edges,
regions.

A foxglove.ImageAnnotations is written in protobuf's wire format directly: the tree of message
objects that would be built otherwise, only to be serialised at once, costs six times as much. The
bytes are those that protobuf's own deterministic serialisation gives, which a test holds them
against.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable

from msgspec import UNSET

from recorders.channels import NANOS
from recorders.messages import Box, Regions, Relations, Track, Tracks
from replay.draw import part_box
from replay.palette import COLOUR_COUNT, track_colour

# Tags: field number times 8 plus wire type (0 number, 1 double, 2 length and bytes).
_CIRCLES, _POINTS, _TEXTS, _TIMESTAMP = (
    b"\x0a",
    b"\x12",
    b"\x1a",
    b"\x2a",
)  # ImageAnnotations 1, 2, 3, 5
_POINT = struct.Struct("<3sdBd")
_TWO_POINTS = struct.Struct("<" + "3sdBd" * 2)
_FOUR_POINTS = struct.Struct("<" + "3sdBd" * 4)
_DISC = struct.Struct("<3sdBdBd")
_DOUBLE = struct.Struct("<Bd")
_CORNER = (
    b"\x1a\x12\x09"  # PointsAnnotation.points: a Point2 of 18 bytes, x; y has the tag 0x11
)
_PLACE = b"\x12\x12\x09"  # CircleAnnotation.position, TextAnnotation.position: the same
_LOOP, _LINES = b"\x10\x02", b"\x10\x04"  # PointsAnnotation.type: LINE_LOOP, LINE_LIST


def _varint(value: int) -> bytes:
    out = bytearray()
    value &= (1 << 64) - 1
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


_LENGTHS = tuple(_varint(index) for index in range(1024))


def _framed(tag: bytes, body: bytes) -> bytes:
    size = len(body)
    return tag + (_LENGTHS[size] if size < len(_LENGTHS) else _varint(size)) + body


def _double(tag: int, value: float) -> bytes:
    """A field that is left out where it holds its default, +0.0."""
    packed = _DOUBLE.pack(tag, value)
    return packed if any(packed[1:]) else b""


def _point(head: bytes, x: float, y: float) -> bytes:
    if x and y:
        return _POINT.pack(head, x, 0x11, y)
    return _framed(head[:1], _double(0x09, x) + _double(0x11, y))


def _colour(red: float, green: float, blue: float, alpha: float) -> bytes:
    return b"".join(
        _double(tag, v)
        for tag, v in ((0x09, red), (0x11, green), (0x19, blue), (0x21, alpha))
    )


def _line(colour: bytes, thickness: float) -> bytes:
    """The end of a PointsAnnotation: its colour and thickness."""
    return _framed(b"\x22", colour) + _double(0x39, thickness)


_INTERACTION = _line(_colour(1.0, 0.85, 0.2, 0.9), 1.5)
_JOINT = _line(_colour(1.0, 0.25, 0.2, 1.0), 4.0)
_ROI = _line(_colour(0.3, 0.9, 0.4, 0.8), 1.0)
_BORDER = _line(_colour(0.95, 0.6, 0.2, 0.8), 1.0)
_ZONE = _line(_colour(0.3, 0.7, 1.0, 0.8), 1.0)
_BLACK = _framed(b"\x32", _colour(0.0, 0.0, 0.0, 0.6))
_COLOURS = tuple(_colour(*track_colour(index), 1.0) for index in range(COLOUR_COUNT))
_OUTLINES = tuple(_line(c, 2.0) for c in _COLOURS)
_CROSSES = tuple(_line(c, 0.5) for c in _COLOURS)
_RINGS = tuple(_double(0x21, 1.0) + _framed(b"\x32", c) for c in _COLOURS)
_LETTERS = tuple(_double(0x21, 12.0) + _framed(b"\x2a", c) + _BLACK for c in _COLOURS)


def _head(tag: bytes, *parts: int) -> bytes:
    """Tag and length of a message whose parts have these lengths."""
    return tag + _LENGTHS[sum(parts)]


# What every box, circle and edge begins with, unless a coordinate is 0 and so left out.
_BOX_HEADS = tuple(
    _head(_POINTS, 2, _FOUR_POINTS.size, len(style)) + _LOOP for style in _OUTLINES
)
_DISC_HEADS = tuple(_head(_CIRCLES, _DISC.size, len(ring)) for ring in _RINGS)
_EDGE_HEAD = _head(_POINTS, 2, _TWO_POINTS.size, len(_JOINT)) + _LINES
assert len(_JOINT) == len(_INTERACTION)


def _polyline(kind: bytes, places: Iterable[tuple[float, float]], style: bytes) -> bytes:
    points = b"".join([_point(_CORNER, x, y) for x, y in places])
    return _framed(_POINTS, kind + points + style)


def _box(box: Box, k: int) -> bytes:
    """A box, from its top left corner clockwise."""
    x, y, w, h = box
    right, bottom, c = x + w, y + h, _CORNER
    if x and y and right and bottom:
        points = _FOUR_POINTS.pack(
            c, x, 0x11, y, c, right, 0x11, y, c, right, 0x11, bottom, c, x, 0x11, bottom
        )
        return _BOX_HEADS[k] + points + _OUTLINES[k]
    return _polyline(
        _LOOP, ((x, y), (right, y), (right, bottom), (x, bottom)), _OUTLINES[k]
    )


def _disc(x: float, y: float, diameter: float, k: int) -> bytes:
    if x and y and diameter:
        return _DISC_HEADS[k] + _DISC.pack(_PLACE, x, 0x11, y, 0x19, diameter) + _RINGS[k]
    return _framed(_CIRCLES, _point(_PLACE, x, y) + _double(0x19, diameter) + _RINGS[k])


def _edge(start: tuple[float, float], end: tuple[float, float], style: bytes) -> bytes:
    if all(start) and all(end):
        return (
            _EDGE_HEAD
            + _TWO_POINTS.pack(
                _CORNER, start[0], 0x11, start[1], _CORNER, end[0], 0x11, end[1]
            )
            + style
        )
    return _polyline(_LINES, (start, end), style)


def label(track: Track) -> str:
    """A track's label: id, and how it is held where that is not plain motion."""
    words = f"{track.id}"
    if track.mode != "motion":
        words += f" {track.mode} {track.confidence:.2f}"
    words += " grouping" if track.grouping else ""
    words += " grouped" if track.grouped else ""
    return words + (" splitting" if track.splitting else "")


def drawing(
    tracks: Tracks, relations: Relations, regions: Regions | None, time_ns: int
) -> bytes:
    """The payload of a foxglove.ImageAnnotations of one frame.

    Shells are circles around the boxes' centres (SHELLS 2.2); edges are thin for INTERACTION and
    thick for JOINT, as in SHELLS Figure 1d.
    """
    circles: list[bytes] = []
    lines: list[bytes] = []
    texts: list[bytes] = []
    centres: dict[int, tuple[float, float]] = {}
    for track in tracks.tracks:
        x, y, w, h = track.box
        cx, cy = centres[track.id] = (x + w / 2, y + h / 2)
        k = track.id % COLOUR_COUNT
        lines.append(_box(track.box, k))
        circles.append(_disc(cx, cy, 2 * track.shell_radius, k))
        if track.gate is not UNSET:
            x1, y1, gw, gh = track.gate
            corners = (x1, y1), (x1 + gw, y1), (x1 + gw, y1 + gh), (x1, y1 + gh)
            lines.append(_polyline(_LOOP, corners, _CROSSES[k]))
        for name in track.hidden_parts:
            # The format knows no dashes; a cross says that nothing is to be seen there (PARTS,
            # Figure 7).
            px, py, pw, ph = part_box(track, name)
            cross = (px, py), (px + pw, py + ph), (px + pw, py), (px, py + ph)
            lines.append(_polyline(_LINES, cross, _CROSSES[k]))
        text = _framed(b"\x1a", label(track).encode())
        texts.append(_framed(_TEXTS, _point(_PLACE, x, y) + text + _LETTERS[k]))
    for edge in relations.relations:
        if edge.a in centres and edge.b in centres:
            style = _JOINT if edge.state == "JOINT" else _INTERACTION
            lines.append(_edge(centres[edge.a], centres[edge.b], style))
    if regions is not None:
        lines += _region_lines(regions)
    return b"".join((*circles, *lines, *texts, _timestamp(time_ns)))


def _region_lines(regions: Regions) -> list[bytes]:
    polygons = [(_BORDER, p) for p in regions.border] + [(_ROI, p) for p in regions.roi]
    polygons += [(_ZONE, zone.polygon) for zone in regions.zones]
    return [_polyline(_LOOP, polygon, style) for style, polygon in polygons]


def _timestamp(time_ns: int) -> bytes:
    seconds, nanos = divmod(time_ns, NANOS)
    body = b"\x08" + _varint(seconds) if seconds else b""
    return _framed(_TIMESTAMP, body + (b"\x10" + _varint(nanos) if nanos else b""))
