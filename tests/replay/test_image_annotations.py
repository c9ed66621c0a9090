"""The drawings' bytes are those that protobuf itself writes of the same messages."""

from __future__ import annotations

from typing import Any

from foxglove_schemas_protobuf.Color_pb2 import Color
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Point2_pb2 import Point2
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import UNSET

from recorders.messages import (
    Mode,
    Regions,
    Relation,
    Relations,
    RelationState,
    Track,
    Tracks,
    Zone,
)
from replay.draw import part_box
from replay.image_annotations import drawing, label
from replay.palette import COLOUR_COUNT, letter_colour, luminance, track_colour
from tests.examples import examples

WIDTH, HEIGHT = 640, 480
LETTERS = "WKKWKKKK"
"""White or black on each of the eight colours: which has the higher contrast."""


def by_protobuf(
    tracks: Tracks, relations: Relations, regions: Regions | None, time_ns: int
) -> bytes:
    """The same with protobuf's own objects; labels stand where the drawing put them."""
    out = ImageAnnotations()
    lines = PointsAnnotation.LINE_LIST
    centres = {}
    placed = iter(
        ImageAnnotations.FromString(
            drawing(tracks, relations, regions, time_ns, (WIDTH, HEIGHT))
        ).texts
    )
    for track in tracks.tracks:
        x, y, w, h = track.box
        centres[track.id] = x + w / 2, y + h / 2
        color = color_of(track.id)
        loop(out, corners(track.box), color, 2 / 480 * HEIGHT)
        circle = out.circles.add(
            diameter=2 * track.shell_radius,
            thickness=1 / 480 * HEIGHT,
            outline_color=color,
        )
        circle.position.x, circle.position.y = centres[track.id]
        if track.gate is not UNSET:
            loop(out, corners(track.gate), color, 0.5 / 480 * HEIGHT)
        for name in track.hidden_parts:
            a, b, c, d = corners(part_box(track, name))
            out.points.add(
                type=lines,
                points=points([a, c, b, d]),
                outline_color=color,
                thickness=0.5 / 480 * HEIGHT,
            )
        white = LETTERS[track.id % 8] == "W"
        text = out.texts.add(
            text=label(track),
            font_size=14 / 480 * HEIGHT,
            text_color=Color(r=white, g=white, b=white, a=1.0),
            background_color=color,
        )
        text.position.CopyFrom(next(placed).position)
    for e in relations.relations:
        if e.a in centres and e.b in centres:
            color = (
                Color(r=1.0, g=0.25, b=0.2, a=1.0)
                if e.state == "JOINT"
                else Color(r=1.0, g=0.85, b=0.2, a=0.9)
            )
            thickness = (4.0 if e.state == "JOINT" else 1.5) / 480 * HEIGHT
            ends = points([centres[e.a], centres[e.b]])
            out.points.add(
                type=lines, points=ends, outline_color=color, thickness=thickness
            )
    if regions is not None:
        for polygon in regions.border:
            loop(out, polygon, Color(r=0.95, g=0.6, b=0.2, a=0.8), 1 / 480 * HEIGHT)
        for polygon in regions.roi:
            loop(out, polygon, Color(r=0.3, g=0.9, b=0.4, a=0.8), 1 / 480 * HEIGHT)
        for zone in regions.zones:
            loop(out, zone.polygon, Color(r=0.3, g=0.7, b=1.0, a=0.8), 1 / 480 * HEIGHT)
    if not out.circles and not out.points:
        out.points.add(
            type=PointsAnnotation.POINTS,
            points=[Point2()],
            outline_color=Color(),
            thickness=1 / 480 * HEIGHT,
        )
    for item in (out, *out.circles, *out.points, *out.texts):
        item.timestamp.seconds, item.timestamp.nanos = divmod(time_ns, 1_000_000_000)
    return out.SerializeToString(deterministic=True)


def color_of(identity: int) -> Any:
    red, green, blue = track_colour(identity)
    return Color(r=red, g=green, b=blue, a=1.0)


def corners(box: tuple[float, float, float, float]) -> list[tuple[float, float]]:
    x, y, w, h = box
    return [(x, y), (x + w, y), (x + w, y + h), (x, y + h)]


def points(places: list[tuple[float, float]]) -> list[Any]:
    return [Point2(x=x, y=y) for x, y in places]


def loop(out: Any, places: list[tuple[float, float]], color: Any, thickness: float) -> None:
    kind = PointsAnnotation.LINE_LOOP
    out.points.add(
        type=kind, points=points(places), outline_color=color, thickness=thickness
    )


numbers = st.sampled_from([0.0, -0.0, 1.0, -3.0, 0.1, 1e-308, 4096.5]) | st.floats(
    allow_nan=False, width=32
)
boxes = st.tuples(numbers, numbers, numbers, numbers)
polygons = st.lists(st.tuples(numbers, numbers), max_size=6)

MODES: st.SearchStrategy[Mode] = st.sampled_from(["motion", "appearance"])
STATES: st.SearchStrategy[RelationState] = st.sampled_from(["JOINT", "INTERACTION"])
Drawn = tuple[Tracks, Relations, Regions | None]


@st.composite
def scenes(draw: st.DrawFn) -> Drawn:
    ids = sorted(draw(st.sets(st.integers(0, 300) | st.integers(0, 2**40), max_size=4)))
    tracks = [
        Track(
            i, draw(boxes), None, (0.0, 0.0), draw(numbers), draw(MODES),
            draw(st.floats(0, 1)), True, True, -1, draw(st.booleans()), draw(st.booleans()), draw(st.booleans()),
            [], [], [], None, "inside",
            [], draw(st.lists(st.sampled_from(["head", "left leg", "torso"]), max_size=2)),
            draw(st.one_of(st.just(UNSET), boxes)),
        )
        for i in ids
    ]  # fmt: skip
    pairs = [(a, b) for a in [*ids, 301] for b in [*ids, 301] if a < b]
    relations = [
        Relation(a, b, draw(STATES), 0, 0, False, False, False, 0.0, "") for a, b in pairs
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


@settings(deadline=None, max_examples=examples(300), database=None)
@given(scenes(), st.sampled_from([0, 1, 10**9, 1_700_000_000_123_456_789, 2**63 - 1]))
def test_bytes_are_those_of_protobuf(scene: Drawn, time_ns: int) -> None:
    tracks, relations, regions = scene
    found = drawing(tracks, relations, regions, time_ns, (WIDTH, HEIGHT))
    assert found == by_protobuf(tracks, relations, regions, time_ns)


def test_long_lines_and_labels_have_lengths_of_several_bytes() -> None:
    polygon = [(float(k) + 0.5, 2.0 * k + 1) for k in range(2000)]
    regions = Regions(100, 100, [polygon], [[]], [])
    made = drawing(Tracks(0), Relations(0), regions, 5, (WIDTH, HEIGHT))
    assert made == by_protobuf(Tracks(0), Relations(0), regions, 5)
    assert len(ImageAnnotations.FromString(made).points[1].points) == 2000


def drawn(*tracks: Track, size: tuple[int, int] = (WIDTH, HEIGHT), time_ns: int = 7) -> Any:
    made = drawing(Tracks(0, list(tracks)), Relations(0), None, time_ns, size)
    return ImageAnnotations.FromString(made)


@settings(deadline=None, max_examples=examples(50), database=None)
@given(scenes(), st.sampled_from([0, 1_700_000_000_123_456_789]))
def test_every_item_has_the_stamp_and_no_frame_is_without_one(
    scene: Drawn, time_ns: int
) -> None:
    tracks, relations, regions = scene
    made = ImageAnnotations.FromString(
        drawing(tracks, relations, regions, time_ns, (WIDTH, HEIGHT))
    )
    items = [*made.circles, *made.points, *made.texts]
    assert items
    for item in items:
        assert item.HasField("timestamp")
        assert item.timestamp.ToNanoseconds() == time_ns


def test_an_empty_frame_has_one_item_that_is_not_seen() -> None:
    (item,) = drawn().points
    assert item.outline_color.a == 0


def test_labels_are_short_and_lie_in_the_picture_side_by_side() -> None:
    plain = make_track(1, 630.0, 2.0)
    same = make_track(12345, 630.0, 100.0, mode="predicted", grouped=True)
    below = make_track(3, 600.0, 104.0, mode="predicted")
    made = drawn(plain, same, below)
    assert [t.text for t in made.texts] == ["1", "12345 grouped", "3 predicted"]
    for text in made.texts:
        assert text.position.x + 0.6 * text.font_size * len(text.text) <= WIDTH
        assert text.font_size <= text.position.y <= HEIGHT
    assert abs(made.texts[1].position.y - made.texts[2].position.y) >= 14


def test_sizes_follow_the_height_of_the_picture() -> None:
    small, large = (
        drawn(make_track(1, 9.0, 90.0), size=s) for s in ((320, 240), (2560, 1920))
    )
    assert (small.texts[0].font_size, large.texts[0].font_size) == (7, 56)
    assert (small.points[0].thickness, large.points[0].thickness) == (1, 8)


def test_letters_have_a_contrast_of_four_and_a_half() -> None:
    for identity in range(COLOUR_COUNT):
        a, b = sorted(
            luminance(*c) for c in (letter_colour(identity), track_colour(identity))
        )
        assert (b + 0.05) / (a + 0.05) >= 4.5


def make_track(
    identity: int, x: float, y: float, mode: Mode = "motion", grouped: bool = False
) -> Track:
    return Track(
        identity, (x, y, 20.0, 40.0), None, (0.0, 0.0), 9.0, mode, 1.0, True, True, -1,
        False, grouped, False, [], [], [], None, "inside",
    )  # fmt: skip
