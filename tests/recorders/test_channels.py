"""Channels: schemas that viewers can read, strict decoding, limits before trust."""

from __future__ import annotations

import json
from pathlib import Path

import msgspec
import pytest
from google.protobuf import descriptor_pool
from google.protobuf.descriptor_pb2 import FileDescriptorSet

from recorders import channels
from recorders.errors import RecordingError, UsageError
from recorders.limits import Limits
from recorders.log import LogReader
from recorders.messages import (
    Blob,
    Detections,
    Ellipse,
    Event,
    Regions,
    Track,
    Tracks,
    Zone,
)


def test_topics() -> None:
    assert channels.topic("north", "tracks") == "/north/tracks"
    assert channels.split("/north/tracks") == ("north", "tracks")
    assert channels.split("/north/imu") == ("", "/north/imu")
    with pytest.raises(UsageError, match="camera name"):
        channels.topic("a//b", "tracks")


PLAIN = {"boolean", "integer", "number", "string"}


def fields_of(schema: dict) -> dict[str, str]:
    """Fields and types as viewers' parsers take them: one type each, arrays of values or objects.

    Raises:
        ValueError: what makes such a parser give a topic up.
    """
    if schema.get("type") != "object":
        raise ValueError("not an object")
    found = {}
    for name, field in schema["properties"].items():
        kind = field.get("type")
        if kind == "array":
            kind = field["items"].get("type")
            if kind == "object":
                fields_of(field["items"])
            elif kind not in PLAIN:
                raise ValueError(f"{name}: an array of {kind}")
        elif kind == "object":
            fields_of(field)
        elif kind not in PLAIN:
            raise ValueError(f"{name}: of type {kind}")
        found[name] = kind
    return found


@pytest.mark.parametrize("name", sorted(channels.JSON_CHANNELS))
def test_json_schemas_are_those_that_viewers_parse(name: str) -> None:
    schema = channels.schema(name)
    assert schema.encoding == "jsonschema"
    assert "frame" in fields_of(json.loads(schema.data)) or name == "regions"
    for word in ("$ref", "$defs", "anyOf", "oneOf", "allOf", "prefixItems", "null"):
        assert f'"{word}"' not in schema.data.decode()


def holds(schema: dict, value: object) -> bool:
    """Whether a value is what a schema of that part says; further fields are allowed."""
    kind = schema["type"]
    if kind == "object":
        return (
            isinstance(value, dict)
            and set(schema.get("required", [])) <= set(value)
            and all(
                holds(field, value[name])
                for name, field in schema.get("properties", {}).items()
                if name in value
            )
        )
    if kind == "array":
        least, most = schema.get("minItems", 0), schema.get("maxItems", 1 << 30)
        return (
            isinstance(value, list)
            and least <= len(value) <= most
            and all(holds(schema["items"], item) for item in value)
        )
    if kind == "boolean":
        return isinstance(value, bool)
    if kind == "string":
        return isinstance(value, str) and value in schema.get("enum", [value])
    numbers = int if kind == "integer" else int | float
    return isinstance(value, numbers) and not isinstance(value, bool)


def test_payloads_hold_to_their_schemas(golden_logs: list[Path]) -> None:
    seen = set()
    for path in golden_logs:
        with LogReader(path) as log:
            for message in log.messages():
                name = channels.split(message.topic)[1]
                schema = json.loads(channels.schema(name).data)
                assert holds(schema, json.loads(message.data)), (name, message.data)
                seen.add(name)
    assert seen == {"tracks", "relations", "groups", "events"}


def test_detections_with_ellipses_that_are_missing_hold_to_their_schema() -> None:
    sent = Detections(3, 640, 480, [(1.5, 2, 3, 4)], [0.5], [""], [None], [-1])
    schema = json.loads(channels.schema("detections").data)
    assert holds(schema, json.loads(channels.encode("detections", sent)))
    assert "boxes" in schema["$comment"]
    assert "ellipses" in schema["$comment"]


@pytest.fixture
def golden_logs() -> list[Path]:
    return sorted((Path(__file__).parents[1] / "golden").glob("*.mcap"))


@pytest.mark.parametrize("name", sorted(channels.PROTOBUF_CHANNELS))
def test_protobuf_schemas_are_complete(name: str) -> None:
    schema = channels.schema(name)
    pool = descriptor_pool.DescriptorPool()
    for file in FileDescriptorSet.FromString(schema.data).file:
        pool.Add(file)
    assert pool.FindMessageTypeByName(schema.name).full_name == schema.name


def test_detections_round_trip() -> None:
    sent = Detections(
        3,
        640,
        480,
        [(1.5, 2.0, 3.0, 4.0)],
        [0.5],
        ["person"],
        [Ellipse(1, 2, 3, 4, 0.1)],
        [1],
    )
    assert channels.decode("detections", channels.encode("detections", sent)) == sent


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('{"frame":0,"width":9,"height":9,"boxes":[[0,0,-1,2]]}', "box 0 is"),
        ('{"frame":0,"width":9,"height":9,"boxes":[[0,0,1,0]]}', "box 0 is"),
        ('{"frame":0,"width":9,"height":9,"boxes":[[1e300,0,1,1]]}', "box 0 is"),
        (
            '{"frame":0,"width":9,"height":9,"boxes":[[NaN,0,1,1]]}',
            "not a detections message",
        ),
        ('{"frame":-1,"width":9,"height":9}', "not a detections message"),
        (
            '{"frame":0,"width":9,"height":9,"boxes":[[0,0,1,1]],"scores":[1,2]}',
            "2 scores for 1 boxes",
        ),
        (
            '{"frame":0,"width":9,"height":9,"boxes":[[0,0,1,1]],"scores":[1e300]}',
            "a score of 1e+300",
        ),
        (
            '{"frame":0,"width":9,"height":9,"boxes":[[0,0,1,1]],"blobs":[-2]}',
            "a detection of blob -2",
        ),
        (
            '{"frame":0,"width":9,"height":9,"boxes":[[0,0,1,1]],"blobs":[1152921504606846976]}',
            "a detection of blob",
        ),
        ('{"frame":0,"width":0,"height":9}', "made for a picture of 0x9"),
        (
            '{"frame":0,"width":20000,"height":9}',
            "over the limit of 16384 a side (max_picture_side)",
        ),
        (
            '{"frame":0,"width":16000,"height":16000}',
            "over the limit of 64000000 pixels (max_picture_pixels)",
        ),
        (
            '{"frame":0,"width":9,"height":9,"boxes":[[0,0,1,1]],"ellipses":[{"x":0,"y":0,"h":1e99,"w":1,"theta":0}]}',
            "an ellipse is",
        ),
        (
            '{"frame":0,"width":9,"height":9,"size_model":[1,2]}',
            "the size model [1.0, 2.0] is of no body",
        ),
        ('{"frame":0,"width":9,"height":9,"size_model":[0,1,0.5,1,1e9]}', "is of no body"),
        ('{"frame":0,"width":9,"height":9,"size_model":[0,1,0.5,0,1]}', "is of no body"),
        ("[]", "not a detections message"),
        ('{"frame":0', "not a detections message"),
    ],
)
def test_bad_detections_are_refused_with_the_reason(text: str, reason: str) -> None:
    with pytest.raises(RecordingError) as caught:
        channels.decode("detections", text.encode(), path="x.mcap")
    assert reason in str(caught.value)
    assert "x.mcap (detections)" in str(caught.value)


ELLIPSE = Ellipse(1.0, 1.0, 1.0, 1.0, 0.0)


@pytest.mark.parametrize(
    ("components", "blobs", "reason"),
    [
        (
            [Blob(2, (0, 0, 2, 2), 4, ELLIPSE)],
            [1],
            "component 1 has the id 2; ids count from 1 in order",
        ),
        ([Blob(1, (0, 0, 2, 2), 5, ELLIPSE)], [1], "area 5 is not in the picture"),
        ([Blob(1, (8, 0, 2, 2), 4, ELLIPSE)], [1], "is not in the picture of 9x9"),
        ([Blob(1, (-1, 0, 2, 2), 4, ELLIPSE)], [1], "is not in the picture"),
        ([Blob(1, (0, 0, 2, 2), 0, ELLIPSE)], [1], "area 0 is not in the picture"),
        (
            [Blob(1, (0, 0, 2, 2), 4, Ellipse(1.0, 1.0, -1.0, 1.0, 0.0))],
            [1],
            "an ellipse is",
        ),
        (
            [Blob(1, (0, 0, 2, 2), 4, ELLIPSE)],
            [2],
            "a detection of blob 2; the blobs are 1 to 1, -1 for none",
        ),
    ],
)
def test_blobs_that_cannot_be_are_refused(
    components: list[Blob], blobs: list[int], reason: str
) -> None:
    sent = Detections(0, 9, 9, [(0.0, 0.0, 2.0, 2.0)], blobs=blobs, components=components)
    with pytest.raises(RecordingError) as caught:
        channels.decode("detections", channels.encode("detections", sent))
    assert reason in str(caught.value)


@pytest.mark.parametrize(
    ("regions", "reason"),
    [
        (Regions(9, 9, [[(0, 0), (1, 1)]], []), "roi has 2 vertices, wanted 3 to 500"),
        (Regions(9, 9, [], [[(0, 0), (1, 0), (0, 1)] * 200]), "border has 600 vertices"),
        (
            Regions(9, 9, [], [], [Zone("door", [(0, 0), (1e300, 0), (0, 1)])]),
            "zone 'door' has a vertex beyond",
        ),
        (Regions(9, 9, [[(0, 0), (1, 0), (0, 1)]] * 601, []), "601 polygons, at most 600"),
    ],
)
def test_regions_that_cannot_be_are_refused(regions: Regions, reason: str) -> None:
    with pytest.raises(RecordingError) as caught:
        channels.decode("regions", channels.encode("regions", regions))
    assert reason in str(caught.value)


def test_an_unterminated_string_full_of_quotes_takes_no_time() -> None:
    text = b'{"id":1,"evidence":{"a":' + b"[" * 40 + b'"' + b'\\"' * 200_000
    with pytest.raises(RecordingError, match="events"):
        channels.decode("events", text)


def test_limits_on_depth_and_number() -> None:
    deep = Event(
        1, "joined", [1], 0, 0, "rule", {"a": msgspec.json.decode(b"[" * 40 + b"]" * 40)}
    )
    with pytest.raises(RecordingError, match=r"nested 42 deep, over the limit of 32"):
        channels.decode("events", channels.encode("events", deep))
    wordy = Event(1, "joined", [1], 0, 0, "rule", {"a": "[" * 1000})
    assert channels.decode("events", channels.encode("events", wordy)) == wordy
    many = Detections(0, 9, 9, [(0.0, 0.0, 1.0, 1.0)] * 3)
    with pytest.raises(RecordingError, match="over the limit of 2"):
        channels.decode(
            "detections",
            channels.encode("detections", many),
            limits=Limits(max_detections_per_frame=2),
        )


def test_a_protobuf_that_is_none() -> None:
    with pytest.raises(RecordingError, match="not an image message"):
        channels.decode("image", b"\xff\xff\xff")


def test_encoding_is_canonical() -> None:
    track = Track(1, (0.1, 0.2, 3.0, 4.0), None, (0.0, 0.0), 2.5, "motion", 1.0, True, True, 1,
                  False, False, False, [], [], [], None, "inside")  # fmt: skip
    assert channels.encode("tracks", Tracks(0, [track])).startswith(
        b'{"frame":0,"tracks":[{"id":1,"box":[0.1,0.2,3.0,4.0],"ellipse":null'
    )
