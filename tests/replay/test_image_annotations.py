"""The drawings' bytes are those that protobuf itself writes of the same messages."""

from __future__ import annotations

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from recorders.messages import Regions, Relation, Relations, Track, Tracks, Zone
from replay.draw import part_box
from replay.image_annotations import drawing

PALETTE = [
    (0.12, 0.47, 0.71), (1.00, 0.50, 0.05), (0.17, 0.63, 0.17), (0.84, 0.15, 0.16),
    (0.58, 0.40, 0.74), (0.09, 0.75, 0.81), (0.89, 0.47, 0.76), (0.74, 0.74, 0.13),
]  # fmt: skip


def by_protobuf(tracks, relations, regions, time_ns):
    out = ImageAnnotations()
    out.timestamp.seconds, out.timestamp.nanos = divmod(time_ns, 1_000_000_000)
    lines = PointsAnnotation.LINE_LIST
    centres = {}
    for track in tracks.tracks:
        x, y, w, h = track.box
        centres[track.id] = x + w / 2, y + h / 2
        red, green, blue = PALETTE[track.id % 8]
        color = Color(r=red, g=green, b=blue, a=1.0)
        loop(out, corners(track.box), color, 2.0)
        circle = out.circles.add(
            diameter=2 * track.shell_radius, thickness=1.0, outline_color=color
        )
        circle.position.x, circle.position.y = centres[track.id]
        if track.gate is not UNSET:
            loop(out, corners(track.gate), color, 0.5)
        for name in track.hidden_parts:
            a, b, c, d = corners(part_box(track, name))
            out.points.add(
                type=lines, points=points([a, c, b, d]), outline_color=color, thickness=0.5
            )
        words = [str(track.id)]
        words += [f"{track.mode} {track.confidence:.2f}"] if track.mode != "motion" else []
        words += [
            bit for bit in ("grouping", "grouped", "splitting") if getattr(track, bit)
        ]
        text = out.texts.add(
            text=" ".join(words),
            font_size=12.0,
            text_color=color,
            background_color=Color(a=0.6),
        )
        text.position.x, text.position.y = x, y
    for e in relations.relations:
        if e.a in centres and e.b in centres:
            color = (
                Color(r=1.0, g=0.25, b=0.2, a=1.0)
                if e.state == "JOINT"
                else Color(r=1.0, g=0.85, b=0.2, a=0.9)
            )
            thickness = 4.0 if e.state == "JOINT" else 1.5
            ends = points([centres[e.a], centres[e.b]])
            out.points.add(
                type=lines, points=ends, outline_color=color, thickness=thickness
            )
    if regions is not None:
        for polygon in regions.border:
            loop(out, polygon, Color(r=0.95, g=0.6, b=0.2, a=0.8), 1.0)
        for polygon in regions.roi:
            loop(out, polygon, Color(r=0.3, g=0.9, b=0.4, a=0.8), 1.0)
        for zone in regions.zones:
            loop(out, zone.polygon, Color(r=0.3, g=0.7, b=1.0, a=0.8), 1.0)
    return out.SerializeToString(deterministic=True)


def corners(box):
    x, y, w, h = box
    return [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]


def points(places):
    return [Point2(x=x, y=y) for x, y in places]


def loop(out, places, color, thickness):
    kind = PointsAnnotation.LINE_LOOP
    out.points.add(
        type=kind, points=points(places), outline_color=color, thickness=thickness
    )


numbers = st.sampled_from([0.0, -0.0, 1.0, -3.0, 0.1, 1e-308, 4096.5]) | st.floats(
    allow_nan=False, width=32
)
boxes = st.tuples(numbers, numbers, numbers, numbers)
polygons = st.lists(st.tuples(numbers, numbers), max_size=6)


@st.composite
def scenes(draw):
    ids = sorted(draw(st.sets(st.integers(0, 300) | st.integers(0, 2**40), max_size=4)))
    tracks = [
        Track(
            i, draw(boxes), None, (0.0, 0.0), draw(numbers), draw(st.sampled_from(["motion", "appearance"])),
            draw(st.floats(0, 1)), True, True, -1, *draw(st.tuples(*[st.booleans()] * 3)), [], [], [], None, "inside",
            [], draw(st.lists(st.sampled_from(["head", "left leg", "torso"]), max_size=2)),
            draw(st.one_of(st.just(UNSET), boxes)),
        )
        for i in ids
    ]  # fmt: skip
    pairs = [(a, b) for a in [*ids, 301] for b in [*ids, 301] if a < b]
    states = st.sampled_from(["JOINT", "INTERACTION"])
    relations = [
        Relation(a, b, draw(states), 0, 0, False, False, False, 0.0, "") for a, b in pairs
    ]
    zones = [Zone("door", p) for p in draw(st.lists(polygons, max_size=1))]
    made = Regions(
        100,
        100,
        draw(st.lists(polygons, max_size=2)),
        draw(st.lists(polygons, max_size=2)),
        zones,
    )
    return Tracks(0, tracks), Relations(0, relations), draw(st.sampled_from([None, made]))


@settings(deadline=None, max_examples=300, database=None)
@given(scenes(), st.sampled_from([0, 1, 10**9, 1_700_000_000_123_456_789, 2**63 - 1]))
def test_bytes_are_those_of_protobuf(scene, time_ns):
    assert drawing(*scene, time_ns) == by_protobuf(*scene, time_ns)


def test_long_lines_and_labels_have_lengths_of_several_bytes():
    polygon = [(float(k) + 0.5, 2.0 * k + 1) for k in range(2000)]
    regions = Regions(100, 100, [polygon], [[]], [])
    made = drawing(Tracks(0), Relations(0), regions, 5)
    assert made == by_protobuf(Tracks(0), Relations(0), regions, 5)
    assert len(ImageAnnotations.FromString(made).points[1].points) == 2000
