"""Draw a frame's scene into its picture: boxes with identities, shells, edges, groups, regions,
events.

Lines have a dark edge and labels their own ground, so that both can be read on dark and on light
pictures. Small pictures are enlarged first, because letters need pixels. Edges are thin for
INTERACTION and thick for JOINT, as in SHELLS, Figure 1d; hidden parts are dashed, as in PARTS,
Figure 7.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from msgspec import UNSET
from numpy.typing import NDArray

from recorders.annotated.membership import Labels, value_of
from recorders.messages import Box, Event, Group, Regions, Relation, Track
from recorders.pictures import Image
from recorders.vision import cv2
from replay.palette import Colour, track_bgr

Point = tuple[float, float]

_SHIFT = 4
_FONT = cv2.FONT_HERSHEY_SIMPLEX
_BLACK: Colour = (0, 0, 0)
_WHITE: Colour = (255, 255, 255)
_INTERACTION: Colour = (60, 220, 255)
_JOINT: Colour = (60, 60, 255)
_GROUP: Colour = (235, 235, 235)
_ROI: Colour = (110, 225, 110)
_BORDER: Colour = (60, 160, 240)
_ZONE: Colour = (255, 190, 90)
PART_NAMES = ("head", "left_torso", "right_torso", "left_legs", "right_legs")
_UPRIGHT = (0.5, 0.5)
"""Alpha and beta of somebody whose tracker has no part model: the torso ends at four sevenths of
the height.
"""
_BITS = ("grouping", "grouped", "splitting")


@dataclass(frozen=True)
class DrawOptions:
    """What is drawn, and how large.

    Attributes:
        scale: enlargement of the picture, 0: as much as makes it about 960 pixels wide, never
            less than 1.
        boxes, labels, shells, edges, groups, regions, parts: whether these are drawn.
        only: track ids to draw, None: all.
        model: draw the five rectangles of the part model into every box (PARTS, Figure 2).
        gates: draw where a target's centre was looked for, where the tracker has gates (PARTS,
            Figure 5).
        membership: tint the pixels that are a target's own, where the tracker says so (SHELLS,
            Figure 3c).
        details: labels say more than who it is.
    """

    scale: float = 0.0
    boxes: bool = True
    labels: bool = True
    shells: bool = True
    edges: bool = True
    groups: bool = True
    regions: bool = True
    parts: bool = True
    only: frozenset[int] | None = None
    model: bool = False
    gates: bool = True
    membership: bool = True
    details: bool = True

    def tells(self, event: Event) -> bool:
        """Whether an event concerns a track that is drawn."""
        return self.only is None or not self.only.isdisjoint(event.subjects)

    def factor(self, width: int) -> float:
        """The enlargement of a picture of this width."""
        return (
            self.scale
            if self.scale > 0
            else max(1.0, math.ceil(2 * 960 / max(width, 1)) / 2 if width < 720 else 1)
        )


@dataclass(frozen=True)
class Overlay:
    """What one frame shows; events are those still to be read, `title` stands at the top.

    ``membership`` is a (height, width) uint16 image of the frame's size that says which pixels
    belong to whom, 0 for nobody, else `recorders.annotated.membership.value_of` the track's identity.
    """

    tracks: Sequence[Track] = ()
    relations: Sequence[Relation] = ()
    groups: Sequence[Group] = ()
    events: Sequence[Event] = ()
    regions: Regions | None = None
    membership: Labels | None = None
    title: str = ""
    marks: Sequence[tuple[Box, str]] = field(default_factory=tuple)


def draw_frame(image: Image, overlay: Overlay, options: DrawOptions | None = None) -> Image:
    """Draw an overlay over a picture.

    Args:
        image: (height, width, 3) uint8 BGR, left as it is.
        overlay: what to draw, in the picture's pixels.
        options: what to leave out, how large.

    Returns:
        a new (height x scale, width x scale, 3) uint8 BGR picture.
    """
    options = options or DrawOptions()
    canvas = _Canvas(image, options.factor(image.shape[1]))
    only = options.only
    shown = [
        track
        for track in overlay.tracks
        if track.present and (only is None or track.id in only)
    ]
    places = {t.id: t for t in shown}
    if overlay.membership is not None and options.membership:
        canvas.tint(
            overlay.membership, None if only is None else [value_of(t.id) for t in shown]
        )
    _draw_ground(canvas, overlay, options, places)
    for track in shown:
        if options.boxes:
            _draw_box(canvas, track, options)
    for box, _ in overlay.marks:
        canvas.rectangle(box, _WHITE, 1, dash=4)
    for track in overlay.tracks if options.labels else ():
        if track.present:
            canvas.keep_off(_head(track.box))
    # Before the labels, which keep off them.
    canvas.lines([overlay.title] if overlay.title else [], top=True)
    canvas.lines(
        [event.text or event.kind for event in overlay.events if options.tells(event)],
        top=False,
    )
    _write(canvas, overlay, options, places)
    return canvas.image


def title_card(image: Image, text: str) -> Image:
    """The picture, darkened, with a line of text in its middle."""
    card = np.ascontiguousarray(image // 4)
    height, width = card.shape[:2]
    size = 1.3 * max(0.4, min(1.0, width / 1900))
    shown = _fitted(text, width - 8, size)
    (w, h), _ = cv2.getTextSize(shown, _FONT, size, 1)
    place = max(4, (width - w) // 2), (height + h) // 2
    cv2.putText(card, shown, place, _FONT, size, _WHITE, 1, cv2.LINE_AA)
    return card


def _draw_ground(
    canvas: _Canvas, overlay: Overlay, options: DrawOptions, places: dict[int, Track]
) -> None:
    """What lies under the boxes: regions, groups, shells, edges."""
    if options.regions and overlay.regions is not None:
        _draw_regions(canvas, overlay.regions)
    for group in overlay.groups if options.groups else ():
        box = _group_box(group, places)
        if box is not None:
            canvas.rectangle(box, _GROUP, 1, dash=0 if group.observed else 6)
    for track in places.values() if options.shells else ():
        canvas.circle(_centre(track.box), track.shell_radius, track_bgr(track.id), 1)
    for edge in overlay.relations if options.edges else ():
        if edge.a in places and edge.b in places:
            _draw_edge(canvas, edge, places)


def _write(
    canvas: _Canvas, overlay: Overlay, options: DrawOptions, places: dict[int, Track]
) -> None:
    """The labels, last, so that nothing lies over them."""
    for track in places.values() if options.labels else ():
        text = label(track) if options.details else str(track.id)
        canvas.label((track.box[0], track.box[1]), text, track_bgr(track.id))
    for group in overlay.groups if options.groups and options.labels else ():
        box = _group_box(group, places)
        if box is not None:
            text = f"group {group.label}: {' '.join(map(str, group.members))}"
            canvas.label((box[0], box[1] + box[3]), text, _GROUP, below=True)
    for zone in (
        overlay.regions.zones if options.regions and overlay.regions is not None else ()
    ):
        if zone.polygon:
            canvas.label(
                min(zone.polygon, key=lambda point: (point[1], point[0])),
                zone.name,
                _ZONE,
                below=True,
            )
    for box, text in overlay.marks:
        canvas.label((box[0], box[1] + box[3]), text, _WHITE, below=True)


def label(track: Track) -> str:
    """A track's label: identity, how it is held where that is not plain motion, interaction bits."""
    words = [str(track.id)]
    if track.mode != "motion":
        words.append(f"{track.mode} {track.confidence:.2f}")
    words += [bit for bit in _BITS if getattr(track, bit)]
    return " ".join(words)


def _head(box: Box) -> Box:
    """Where a head is to be seen in a box: the middle of its top seventh, and a little around."""
    x, y, w, h = box
    return x + 0.2 * w, y, 0.6 * w, h / 6


def _centre(box: Box) -> Point:
    return box[0] + box[2] / 2, box[1] + box[3] / 2


def _draw_box(canvas: _Canvas, track: Track, options: DrawOptions) -> None:
    colour = track_bgr(track.id)
    canvas.rectangle(
        track.box,
        colour,
        2,
        dash={"motion": 0, "appearance": 9, "predicted": 4}[track.mode],
    )
    if options.gates and track.gate is not UNSET:
        canvas.rectangle(track.gate, colour, 1, dash=6)
    for name in PART_NAMES if options.model else ():
        if name not in track.hidden_parts:
            canvas.rectangle(part_box(track, name), colour, 1)
    if options.parts:
        for name in track.hidden_parts:
            canvas.rectangle(part_box(track, name), colour, 1, dash=3)


def part_box(track: Track, name: str) -> Box:
    """Where a named part lies in a track's box (PARTS 2.1, Figure 2).

    The head is the top seventh; below it the centroid, whose place in the box the track tells,
    parts torso from legs and what has ``left`` in its name from what has ``right``.
    """
    x, y, w, h = track.box
    alpha, beta = _UPRIGHT if track.centroid is UNSET else track.centroid
    shoulders = y + h / 7
    middle, foot = shoulders + beta * (y + h - shoulders), y + h
    kind = name.lower()
    spans = {"head": (y, shoulders), "torso": (shoulders, middle), "leg": (middle, foot)}
    top, bottom = next((span for key, span in spans.items() if key in kind), (y, foot))
    left = x + alpha * w if "right" in kind else x
    right = x + alpha * w if "left" in kind else x + w
    return left, top, right - left, bottom - top


def _draw_edge(canvas: _Canvas, edge: Relation, places: dict[int, Track]) -> None:
    joint = edge.state == "JOINT"
    ends = [_centre(places[identity].box) for identity in (edge.a, edge.b)]
    canvas.polyline(ends, _JOINT if joint else _INTERACTION, 4 if joint else 1)
    for end in ends:
        canvas.dot(end, _JOINT if joint else _INTERACTION, 4 if joint else 3)


def _group_box(group: Group, places: dict[int, Track]) -> Box | None:
    members = [places[member].box for member in group.members if member in places]
    if len(members) < 2:
        return None
    x, y = min(member[0] for member in members), min(member[1] for member in members)
    right, bottom = (
        max(member[0] + member[2] for member in members),
        max(member[1] + member[3] for member in members),
    )
    margin = 4.0
    return x - margin, y - margin, right - x + 2 * margin, bottom - y + 2 * margin


def _draw_regions(canvas: _Canvas, regions: Regions) -> None:
    outlines = [(_BORDER, point) for point in regions.border] + [
        (_ROI, point) for point in regions.roi
    ]
    for colour, polygon in outlines + [(_ZONE, zone.polygon) for zone in regions.zones]:
        if len(polygon) >= 3:
            canvas.polyline(polygon, colour, 1, closed=True)


class _Canvas:
    """A picture with a scale: everything is given in the original's pixels, pixel centres at
    integers + 0.5.
    """

    def __init__(self, image: Image, scale: float) -> None:
        height, width = image.shape[:2]
        self.scale = scale
        size = (round(width * scale), round(height * scale))
        self.image: Image = (
            image.copy()
            if scale == 1
            else np.asarray(
                cv2.resize(image, size, interpolation=cv2.INTER_LINEAR), np.uint8
            )
        )
        self._letters = max(0.4, min(1.0, self.image.shape[1] / 1900))
        self._labels: list[tuple[int, int, int, int]] = []

    def _at(self, points: Sequence[Point]) -> NDArray[np.int32]:
        # Beyond 16 bits OpenCV's fixed point overflows; nothing out there is seen anyway.
        scaled = np.clip(
            np.array(points, np.float64).reshape(-1, 2) * self.scale - 0.5, -20000, 20000
        )
        return np.round(scaled * (1 << _SHIFT)).astype(np.int32)

    def polyline(
        self, points: Sequence[Point], colour: Colour, thickness: int, closed: bool = False
    ) -> None:
        at: Any = [self._at(points)]
        for c, t in (
            (_BLACK, thickness + (2 if thickness > 1 else 1)),
            (colour, thickness),
        ):
            cv2.polylines(self.image, at, closed, c, t, cv2.LINE_AA, _SHIFT)

    def rectangle(self, box: Box, colour: Colour, thickness: int, dash: int = 0) -> None:
        x, y, w, h = box
        corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]
        if not dash:
            self.polyline(corners, colour, thickness, closed=True)
            return
        for corner, b in zip(corners, corners[1:] + corners[:1], strict=True):
            self._dashed(corner, b, colour, thickness, dash)

    def _dashed(
        self, a: Point, b: Point, colour: Colour, thickness: int, dash: int
    ) -> None:
        length = math.hypot(b[0] - a[0], b[1] - a[1])
        pieces = min(max(1, round(length * self.scale / (2 * dash))), 400)
        for index in range(pieces):
            start, end = index / pieces, (index + 0.5) / pieces
            ends = [
                (a[0] + (b[0] - a[0]) * track, a[1] + (b[1] - a[1]) * track)
                for track in (start, end)
            ]
            if self._may_show(ends, thickness):
                self.polyline(ends, colour, thickness)

    def _may_show(self, ends: Sequence[Point], thickness: int) -> bool:
        """False only where both ends are beyond the same side of the picture."""
        rim = thickness + 4
        for axis, size in ((0, self.image.shape[1]), (1, self.image.shape[0])):
            places = [end[axis] * self.scale for end in ends]
            if max(places) < -rim or min(places) > size + rim:
                return False
        return True

    def circle(self, centre: Point, radius: float, colour: Colour, thickness: int) -> None:
        if not 0 < radius * self.scale < 10000:
            return
        x, y = self._at([centre])[0].tolist()
        r = round(radius * self.scale * (1 << _SHIFT))
        for c, t in ((_BLACK, thickness + 1), (colour, thickness)):
            cv2.circle(self.image, (x, y), r, c, t, cv2.LINE_AA, _SHIFT)

    def dot(self, centre: Point, colour: Colour, radius: int) -> None:
        x, y = self._at([centre])[0].tolist()
        for c, r in ((_BLACK, radius + 1), (colour, radius)):
            cv2.circle(self.image, (x, y), r << _SHIFT, c, cv2.FILLED, cv2.LINE_AA, _SHIFT)

    def keep_off(self, box: Box) -> None:
        """No label shall lie there, if there is room elsewhere."""
        x, y, w, h = (min(max(v, -20000.0), 20000.0) * self.scale for v in box)
        self._labels.append((round(x), round(y), round(x + w), round(y + h)))

    def label(self, corner: Point, text: str, colour: Colour, below: bool = False) -> None:
        """Text on a ground of the track's colour, above (or below) a point, pushed into the
        picture.
        """
        (w, h), base = cv2.getTextSize(text, _FONT, self._letters, 1)
        height, width = self.image.shape[:2]
        x, y = (min(max(value, -20000.0), 20000.0) * self.scale for value in corner)
        left = min(max(0, round(x)), max(0, width - w - 4))
        top = round(y) if below else round(y) - h - base - 2
        top = self._free(
            left, min(max(0, top), max(0, height - h - base - 2)), w + 4, h + base + 2
        )
        cv2.rectangle(
            self.image, (left, top), (left + w + 3, top + h + base + 1), colour, cv2.FILLED
        )
        light = 0.114 * colour[0] + 0.587 * colour[1] + 0.299 * colour[2] > 120
        ink = _BLACK if light else _WHITE
        cv2.putText(
            self.image,
            text,
            (left + 2, top + h + 1),
            _FONT,
            self._letters,
            ink,
            1,
            cv2.LINE_AA,
        )

    def _free(self, left: int, top: int, width: int, height: int) -> int:
        """The nearest height above (then below) where the label hides no other; the first one if
        there is none.
        """
        rows = range(self.image.shape[0] - height + 1)
        for move in (0, -1, -2, -3, 1, 2, 3):
            y = top + move * (height + 1)
            taken = any(
                a < left + width and left < colour and b < y + height and y < d
                for a, b, colour, d in self._labels
            )
            if y in rows and not taken:
                top = y
                break
        self._labels.append((left, top, left + width, top + height))
        return top

    def lines(self, texts: Sequence[str], top: bool) -> None:
        """Lines of text on a darkened strip at the top or bottom edge."""
        if not texts:
            return
        size = self._letters * 1.1
        (_, h), base = cv2.getTextSize("Ag", _FONT, size, 1)
        step = h + base + 3
        height, width = self.image.shape[:2]
        texts = texts[-max(1, height // (2 * step)) :]
        begin = 0 if top else max(0, height - step * len(texts) - 4)
        strip = self.image[begin : begin + step * len(texts) + 4]
        strip[:] = strip // 3
        self._labels.append((0, begin, width, begin + len(strip)))
        for index, text in enumerate(texts):
            shown = _fitted(text, width - 8, size)
            cv2.putText(
                self.image,
                shown,
                (5, begin + step * index + h + 3),
                _FONT,
                size,
                _WHITE,
                1,
                cv2.LINE_AA,
            )

    def tint(self, membership: Labels, owners: Sequence[int] | None) -> None:
        """Mix the owners' colours into the pixels that somebody (of some values) owns (SHELLS,
        Figure 3c).
        """
        height, width = self.image.shape[:2]
        whose = np.asarray(
            cv2.resize(membership, (width, height), interpolation=cv2.INTER_NEAREST),
            np.uint16,
        )
        present = np.flatnonzero(np.bincount(membership.ravel()))
        table = np.zeros((int(present.max(initial=0)) + 1, 3), np.uint8)
        for value in present.tolist():
            table[value] = track_bgr(value) if value else _BLACK
        mixed = cv2.addWeighted(self.image, 0.45, table[whose], 0.55, 0)
        owned = whose > 0 if owners is None else np.isin(whose, owners)
        self.image[owned] = mixed[owned]


def _fitted(text: str, width: int, size: float) -> str:
    """The text, or as much of it as goes into the width, in letters that the font has."""
    plain = text.encode("ascii", "replace").decode()
    if cv2.getTextSize(plain, _FONT, size, 1)[0][0] <= width:
        return plain
    while plain and cv2.getTextSize(plain + "...", _FONT, size, 1)[0][0] > width:
        plain = plain[:-1]
    return plain + "..."
