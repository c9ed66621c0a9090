"""The drawings that Foxglove and Lichtblick lay over the picture: boxes, labels, shells, edges,
regions.

A foxglove.ImageAnnotations is written in protobuf's wire format directly: the tree of message
objects that would be built otherwise, only to be serialised at once, costs six times as much. The
bytes are those that protobuf's own deterministic serialisation gives, which a test holds them
against.

Every circle, line and text has the picture's stamp, and no frame is without an item: viewers that
match annotations to pictures by time look for the stamps of the items, and stop at a frame that
has none. Lines and letters have the picture's height as their measure.
"""

from __future__ import annotations

import struct
from collections.abc import Iterable
from functools import lru_cache

from msgspec import UNSET

from recorders.channels import NANOS
from recorders.messages import Box, Regions, Relations, Track, Tracks
from replay.draw import part_box
from replay.palette import COLOUR_COUNT, letter_colour, track_colour

# Tags: field number times 8 plus wire type (0 number, 1 double, 2 length and bytes).
# ImageAnnotations 1, 2, 3, 5; every item of the first three has its timestamp as field 1.
_CIRCLES, _POINTS, _TEXTS, _TIMESTAMP = b"\x0a", b"\x12", b"\x1a", b"\x2a"
_ITEM_TIMESTAMP = b"\x0a"
_POINT = struct.Struct("<3sdBd")
_TWO_POINTS = struct.Struct("<" + "3sdBd" * 2)
_FOUR_POINTS = struct.Struct("<" + "3sdBd" * 4)
_DISC = struct.Struct("<3sdBdBd")
_DOUBLE = struct.Struct("<Bd")
_CORNER = (
    b"\x1a\x12\x09"  # PointsAnnotation.points: a Point2 of 18 bytes, x; y has the tag 0x11
)
_PLACE = b"\x12\x12\x09"  # CircleAnnotation.position, TextAnnotation.position: the same
# PointsAnnotation.type: POINTS, LINE_LOOP, LINE_LIST
_DOTS, _LOOP, _LINES = b"\x10\x01", b"\x10\x02", b"\x10\x04"


def _varint(value: int) -> bytes:
    out = bytearray()
    value &= (1 << 64) - 1
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


_READY = 1024
_LENGTHS = tuple(_varint(index) for index in range(_READY))


def _framed(tag: bytes, body: bytes) -> bytes:
    size = len(body)
    return tag + (_LENGTHS[size] if size < _READY else _varint(size)) + body


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
        _double(tag, value)
        for tag, value in ((0x09, red), (0x11, green), (0x19, blue), (0x21, alpha))
    )


def _line(colour: bytes, thickness: float) -> bytes:
    """The end of a PointsAnnotation: its colour and thickness."""
    return _framed(b"\x22", colour) + _double(0x39, thickness)


_YELLOW = _colour(1.0, 0.85, 0.2, 0.9)
_RED = _colour(1.0, 0.25, 0.2, 1.0)
_ROI = _colour(0.3, 0.9, 0.4, 0.8)
_BORDER = _colour(0.95, 0.6, 0.2, 0.8)
_ZONE = _colour(0.3, 0.7, 1.0, 0.8)
_CLEAR = _colour(0.0, 0.0, 0.0, 0.0)
_COLOURS = tuple(_colour(*track_colour(index), 1.0) for index in range(COLOUR_COUNT))
_LETTERS = tuple(_colour(*letter_colour(index), 1.0) for index in range(COLOUR_COUNT))

# In heights of the picture: of 480 rows, letters of 14, boxes with lines of 2.
_FONT = 14 / 480
_BOX, _THIN, _FINE, _MEDIUM, _THICK = 2 / 480, 1 / 480, 0.5 / 480, 1.5 / 480, 4 / 480
_LETTER_WIDTH = 0.6
"""Of a letter's height: about what the viewers' font takes."""


def label(track: Track) -> str:
    """A track's label: its id and the one thing to know of its state, nothing where it is plain.

    Splitting comes before grouped and grouping, these before how it is held.
    """
    if track.splitting:
        return f"{track.id} splitting"
    if track.grouped:
        return f"{track.id} grouped"
    if track.grouping:
        return f"{track.id} grouping"
    return str(track.id) if track.mode == "motion" else f"{track.id} {track.mode}"


class _Pen:
    """What draws the items of one frame: their stamp, and lines and letters for the picture's
    size.
    """

    def __init__(self, width: int, height: int, time_ns: int) -> None:
        self._width, self._height = width, height
        self._font = _FONT * height
        stamp = self._stamp = _timestamp(_ITEM_TIMESTAMP, time_ns)
        self._styles = _styles(height)
        self._labels: dict[int, list[tuple[float, float, float]]] = {}
        self._loop, self._lines = stamp + _LOOP, stamp + _LINES

    def polyline(
        self, kind: bytes, places: Iterable[tuple[float, float]], style: bytes
    ) -> bytes:
        points = b"".join([_point(_CORNER, x, y) for x, y in places])
        return _framed(_POINTS, self._stamp + kind + points + style)

    def loop(
        self, places: Iterable[tuple[float, float]], colour: bytes, thickness: float
    ) -> bytes:
        return self.polyline(_LOOP, places, _line(colour, thickness * self._height))

    def box(self, box: Box, k: int) -> bytes:
        """A box, from its top left corner clockwise."""
        x, y, w, h = box
        right, bottom, c = x + w, y + h, _CORNER
        style = self._styles.outlines[k]
        if x and y and right and bottom:
            points = _FOUR_POINTS.pack(
                c, x, 0x11, y, c, right, 0x11, y, c, right, 0x11, bottom, c, x, 0x11, bottom
            )
            return _framed(_POINTS, self._loop + points + style)
        corners = ((x, y), (right, y), (right, bottom), (x, bottom))
        return self.polyline(_LOOP, corners, style)

    def disc(self, x: float, y: float, diameter: float, k: int) -> bytes:
        ring = self._styles.rings[k]
        if x and y and diameter:
            place = _DISC.pack(_PLACE, x, 0x11, y, 0x19, diameter)
        else:
            place = _point(_PLACE, x, y) + _double(0x19, diameter)
        return _framed(_CIRCLES, self._stamp + place + ring)

    def edge(
        self, start: tuple[float, float], end: tuple[float, float], *, joint: bool
    ) -> bytes:
        style = self._styles.joint if joint else self._styles.interaction
        if all(start) and all(end):
            (x1, y1), (x2, y2) = start, end
            points = _TWO_POINTS.pack(_CORNER, x1, 0x11, y1, _CORNER, x2, 0x11, y2)
            return _framed(_POINTS, self._lines + points + style)
        return self.polyline(_LINES, (start, end), style)

    def gate(self, gate: Box, k: int) -> bytes:
        x, y, w, h = gate
        corners = (x, y), (x + w, y), (x + w, y + h), (x, y + h)
        return self.polyline(_LOOP, corners, self._styles.crosses[k])

    def cross(self, box: Box, k: int) -> bytes:
        x, y, w, h = box
        lines = (x, y), (x + w, y + h), (x + w, y), (x, y + h)
        return self.polyline(_LINES, lines, self._styles.crosses[k])

    def text(self, words: str, x: float, y: float, k: int) -> bytes:
        """A label whose lower left corner is there, moved so that it lies inside the picture and
        hides no label before it, where there is room above.
        """
        place = _point(_PLACE, *self._room(x, y, len(words)))
        said = _framed(b"\x1a", words.encode())
        return _framed(_TEXTS, self._stamp + place + said + self._styles.letters[k])

    def _room(self, x: float, y: float, letters: int) -> tuple[float, float]:
        font, labels = self._font, self._labels
        width = _LETTER_WIDTH * font * letters
        x = max(min(x, self._width - width), 0.0)
        y = first = max(min(y, float(self._height)), font)
        while labels and self._is_taken(x, x + width, y):
            y -= font
            if y < font:
                y = first
                break
        labels.setdefault(int(y // font), []).append((x, x + width, y))
        return x, y

    def _is_taken(self, left: float, right: float, bottom: float) -> bool:
        """Whether a label would hide one before it, which then ends in the same row or the next."""
        font, labels = self._font, self._labels
        row = int(bottom // font)
        for near in (row - 1, row, row + 1):
            if near in labels:
                for a, b, low in labels[near]:
                    if left < b and a < right and abs(bottom - low) < font:
                        return True
        return False

    def nothing(self) -> bytes:
        """An item that is not seen."""
        style = _line(_CLEAR, _THIN * self._height)
        return self.polyline(_DOTS, [(0.0, 0.0)], style)


class _Styles:
    """How items end: colours, thickness, letters, for pictures of one height."""

    def __init__(self, height: int) -> None:
        self.outlines = tuple(_line(colour, _BOX * height) for colour in _COLOURS)
        self.crosses = tuple(_line(colour, _FINE * height) for colour in _COLOURS)
        self.interaction = _line(_YELLOW, _MEDIUM * height)
        self.joint = _line(_RED, _THICK * height)
        thin, font = _double(0x21, _THIN * height), _double(0x21, _FONT * height)
        self.rings = tuple(thin + _framed(b"\x32", colour) for colour in _COLOURS)
        self.letters = tuple(
            font + _framed(b"\x2a", letters) + _framed(b"\x32", ground)
            for letters, ground in zip(_LETTERS, _COLOURS, strict=True)
        )


@lru_cache(maxsize=16)
def _styles(height: int) -> _Styles:
    return _Styles(height)


def drawing(
    tracks: Tracks,
    relations: Relations,
    regions: Regions | None,
    time_ns: int,
    size: tuple[int, int],
) -> bytes:
    """The payload of a foxglove.ImageAnnotations of one frame.

    Shells are circles around the boxes' centres (SHELLS 2.2); edges are thin for INTERACTION and
    thick for JOINT, as in SHELLS Figure 1d.

    Args:
        tracks: of the frame.
        relations: of the frame.
        regions: to be drawn as well, None: none.
        time_ns: the picture's stamp, which every item gets.
        size: the picture's width and height in pixels.
    """
    pen = _Pen(*size, time_ns)
    circles: list[bytes] = []
    lines: list[bytes] = []
    texts: list[bytes] = []
    centres: dict[int, tuple[float, float]] = {}
    for track in tracks.tracks:
        x, y, w, h = track.box
        cx, cy = centres[track.id] = (x + w / 2, y + h / 2)
        k = track.id % COLOUR_COUNT
        lines.append(pen.box(track.box, k))
        circles.append(pen.disc(cx, cy, 2 * track.shell_radius, k))
        if track.gate is not UNSET:
            lines.append(pen.gate(track.gate, k))
        # The format knows no dashes; a cross says that nothing is to be seen there (PARTS,
        # Figure 7).
        lines += [pen.cross(part_box(track, name), k) for name in track.hidden_parts]
        texts.append(pen.text(label(track), x, y, k))
    for edge in relations.relations:
        if edge.a in centres and edge.b in centres:
            joint = edge.state == "JOINT"
            lines.append(pen.edge(centres[edge.a], centres[edge.b], joint=joint))
    if regions is not None:
        lines += _region_lines(pen, regions)
    if not circles and not lines:
        lines.append(pen.nothing())
    return b"".join((*circles, *lines, *texts, _timestamp(_TIMESTAMP, time_ns)))


def _region_lines(pen: _Pen, regions: Regions) -> list[bytes]:
    polygons = [(_BORDER, polygon) for polygon in regions.border] + [
        (_ROI, polygon) for polygon in regions.roi
    ]
    polygons += [(_ZONE, zone.polygon) for zone in regions.zones]
    return [pen.loop(polygon, colour, _THIN) for colour, polygon in polygons]


def _timestamp(tag: bytes, time_ns: int) -> bytes:
    seconds, nanos = divmod(time_ns, NANOS)
    body = b"\x08" + _varint(seconds) if seconds else b""
    return _framed(tag, body + (b"\x10" + _varint(nanos) if nanos else b""))
