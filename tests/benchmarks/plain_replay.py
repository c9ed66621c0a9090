"""What a user would write who has detections in an MCAP file and wants tracks in another one: the
peer of a replay of detections.

Read with the ``mcap`` package (CRCs checked), tracked by SORT, drawn as `foxglove.ImageAnnotations`
(a rectangle and a number each), the tracks as JSON beside them, all written by the ``mcap`` package
(zstd, CRCs) with the recorded messages passed on. No relations, events, graph, hindsight, digests.
"""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.PointsAnnotation_pb2 import PointsAnnotation
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer
from sort import Boxes, Sort

COLOURS = ((0.9, 0.3, 0.2), (0.2, 0.6, 0.9), (0.3, 0.8, 0.3), (0.9, 0.7, 0.1))
TRACKS_SCHEMA = {
    "type": "object",
    "properties": {"frame": {"type": "integer"}, "tracks": {"type": "array"}},
}


def descriptors() -> bytes:
    """The schema of `ImageAnnotations` as MCAP wants it."""
    files = FileDescriptorSet()
    seen = set()

    def visit(descriptor: object) -> None:
        for dependency in descriptor.dependencies:  # type: ignore[attr-defined]
            visit(dependency)
        if descriptor.name not in seen:  # type: ignore[attr-defined]
            seen.add(descriptor.name)  # type: ignore[attr-defined]
            descriptor.CopyToProto(files.file.add())  # type: ignore[attr-defined]

    visit(ImageAnnotations.DESCRIPTOR.file)
    return bytes(files.SerializeToString())


def drawn(found: list[tuple[int, Boxes]], time_ns: int) -> bytes:
    """A rectangle and a number for every track."""
    message = ImageAnnotations()
    for identity, box in found:
        x, y, w, h = box.tolist()
        red, green, blue = COLOURS[identity % len(COLOURS)]
        shape = message.points.add(type=PointsAnnotation.LINE_LOOP, thickness=2.0)
        shape.timestamp.FromNanoseconds(time_ns)
        shape.outline_color.r, shape.outline_color.g = red, green
        shape.outline_color.b, shape.outline_color.a = blue, 1.0
        for px, py in ((x, y), (x + w, y), (x + w, y + h), (x, y + h)):
            shape.points.add(x=px, y=py)
        text = message.texts.add(text=str(identity), font_size=14.0)
        text.timestamp.FromNanoseconds(time_ns)
        text.position.x, text.position.y = x, y
        text.text_color.r, text.text_color.g = red, green
        text.text_color.b, text.text_color.a = blue, 1.0
    return bytes(message.SerializeToString())


def plain_replay(scene: Path, out: Path) -> int:
    """Detections in, tracks and drawings out; gives the number of frames."""
    sort, frames = Sort(), 0
    with scene.open("rb") as source, out.open("wb") as target:
        writer = Writer(target, compression=CompressionType.ZSTD, enable_data_crcs=True)
        writer.start()
        passed: dict[int, int] = {}
        plain = writer.register_schema(
            "tracks", "jsonschema", json.dumps(TRACKS_SCHEMA).encode()
        )
        tracks = writer.register_channel("/camera/tracks", "json", plain)
        shapes = writer.register_schema(
            "foxglove.ImageAnnotations", "protobuf", descriptors()
        )
        annotations = writer.register_channel("/camera/annotations", "protobuf", shapes)
        reader = make_reader(source, validate_crcs=True)
        for schema, channel, message in reader.iter_messages():
            if channel.id not in passed:
                kind = 0
                if schema is not None:
                    kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                passed[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, kind
                )
            now = message.log_time
            writer.add_message(
                passed[channel.id],
                now,
                message.data,
                message.publish_time,
                message.sequence,
            )
            if not channel.topic.endswith("/detections"):
                continue
            found = sort.step(np.array(json.loads(message.data)["boxes"]).reshape(-1, 4))
            rows = [{"id": identity, "box": box.tolist()} for identity, box in found]
            told = json.dumps({"frame": frames, "tracks": rows}).encode()
            writer.add_message(tracks, now, told, now, frames)
            writer.add_message(annotations, now, drawn(found, now), now, frames)
            frames += 1
        writer.finish()
    return frames
