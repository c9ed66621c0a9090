"""The channels of a scene: topic names, schemas, and the encoding and strict decoding of their
payloads.

Pictures, drawings and log lines are Foxglove's protobuf messages, so that Foxglove and Lichtblick
show them; our own messages are JSON with a JSON Schema that `recorders.json_schemas` makes of
`recorders.messages`.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any, TypeVar

import msgspec
import numpy as np
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.Log_pb2 import Log
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.message import DecodeError

from recorders import json_schemas, messages
from recorders.errors import RecordingError, UsageError
from recorders.limits import DEFAULT_LIMITS, Limits
from recorders.log import Schema
from recorders.message_checks import check_detections, check_regions

DEFAULT_CAMERA = "camera"
NANOS = 1_000_000_000
S = TypeVar("S", bound=msgspec.Struct)

JSON_CHANNELS: Mapping[str, type[msgspec.Struct]] = {
    "detections": messages.Detections,
    "regions": messages.Regions,
    "changes": messages.SceneChange,
    "targets": messages.Targets,
    "tracks": messages.Tracks,
    "relations": messages.Relations,
    "groups": messages.Groups,
    "held_back": messages.HeldBack,
    "events": messages.Event,
    "graph": messages.Graph,
    "digest": messages.Digest,
}
PROTOBUF_CHANNELS: Mapping[str, Any] = {
    "image": CompressedImage,
    "video": CompressedVideo,
    "foreground": CompressedImage,
    "membership": CompressedImage,
    "annotations": ImageAnnotations,
    "log": Log,
}
RECORDED = ("image", "foreground", "detections", "regions", "changes")
PICTURES = ("image", "foreground", "membership")
ANNOTATED = (
    "targets",
    "tracks",
    "relations",
    "groups",
    "held_back",
    "events",
    "graph",
    "membership",
    "annotations",
    "log",
    "digest",
)

_SCHEMA_NAMES = {"events": "scenetrace.Event"}
# Fields of type Any take whatever a file nests into them; only there the depth has to be counted.
_OPEN_ENDED = frozenset({"events", "graph", "targets", "changes"})
# An unterminated string reaches to the end, or every quote in it would be tried as a start of its
# own.
_STRINGS = re.compile(rb'"(?:[^"\\]|\\.)*+(?:"|\\?\Z)', re.DOTALL)
_CAMERA = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]*")


def topic(camera: str, name: str) -> str:
    """The topic of a camera's channel: ``/camera/tracks``, ``/robot/left camera/tracks``.

    Raises:
        UsageError: the camera's name has an empty part, or something that cannot be printed.
    """
    if not camera.isprintable() or not all(camera.split("/")):
        raise UsageError(f"camera name {camera!r}: its parts between '/' must be words")
    return f"/{camera}/{name}"


def check_camera(camera: str) -> None:
    """Hold a new recording's camera to a name that every tool takes.

    Raises:
        UsageError: the name is not letters, digits, ``_``, ``-`` and ``.``.
    """
    if not _CAMERA.fullmatch(camera):
        raise UsageError(f"camera name {camera!r}: must be letters, digits, '_', '-', '.'")


def split(full: str) -> tuple[str, str]:
    """Camera and channel name of a topic; an empty camera for a topic that is none of ours."""
    start, _, name = full.rpartition("/")
    camera = start[1:]
    known = name in RECORDED or name in ANNOTATED
    if known and start[:1] == "/" and all(camera.split("/")) and camera.isprintable():
        return camera, name
    return "", full


@cache
def schema(name: str) -> Schema:
    """The schema of a channel (``video`` for an ``image`` channel that holds H.264)."""
    if name in PROTOBUF_CHANNELS:
        return protobuf_schema(PROTOBUF_CHANNELS[name])
    kind = JSON_CHANNELS[name]
    data = msgspec.json.encode(json_schemas.document(kind), order="deterministic")
    return Schema(
        _SCHEMA_NAMES.get(name, f"scenetrace.{kind.__name__}"), "jsonschema", data
    )


def protobuf_schema(kind: Any) -> Schema:
    """The schema of messages of a class that protobuf made."""
    return Schema(kind.DESCRIPTOR.full_name, "protobuf", _descriptor_set(kind))


def message_encoding(name: str) -> str:
    """``protobuf`` or ``json``."""
    return "protobuf" if name in PROTOBUF_CHANNELS else "json"


def _descriptor_set(kind: Any) -> bytes:
    found: dict[str, Any] = {}

    def visit(descriptor: Any) -> None:
        for dependency in descriptor.dependencies:
            if dependency.name not in found:
                visit(dependency)
        found[descriptor.name] = descriptor

    visit(kind.DESCRIPTOR.file)
    files = FileDescriptorSet()
    for descriptor in found.values():
        descriptor.CopyToProto(files.file.add())
    return bytes(files.SerializeToString(deterministic=True))


@cache
def _decoder(name: str) -> msgspec.json.Decoder[Any]:
    return msgspec.json.Decoder(JSON_CHANNELS[name])


def encode(name: str, message: Any) -> bytes:
    """The payload of one of our JSON messages, or of a Foxglove protobuf message."""
    if name in PROTOBUF_CHANNELS:
        return bytes(message.SerializeToString(deterministic=True))
    assert isinstance(message, JSON_CHANNELS[name])
    return msgspec.json.encode(message)


def decode(
    name: str, data: bytes, *, path: str = "", limits: Limits = DEFAULT_LIMITS
) -> Any:
    """The message in a payload: a struct of `recorders.messages` or a Foxglove protobuf message.

    Raises:
        RecordingError: it is not such a message, is nested too deep, or holds values out of
            range; names the channel.
    """
    try:
        if name in PROTOBUF_CHANNELS:
            return PROTOBUF_CHANNELS[name].FromString(data)
        if name in _OPEN_ENDED:
            _check_depth(data, limits.max_json_depth)
        decoded = _decoder(name).decode(data)
        if name == "detections":
            check_detections(decoded, limits)
        elif name == "regions":
            check_regions(decoded)
        return decoded  # noqa: TRY300
    except (
        msgspec.MsgspecError,
        DecodeError,
        RecursionError,
        UnicodeDecodeError,
        ValueError,
    ) as error:
        raise RecordingError(
            f"not {'an' if name[0] in 'aeiou' else 'a'} {name} message: {error}",
            path,
            record=name,
        ) from error


def _check_depth(data: bytes, limit: int) -> None:
    if data.count(b"{") + data.count(b"[") <= limit:
        return
    characters = np.frombuffer(_STRINGS.sub(b"", data), np.uint8)
    opened = ((characters == ord("{")) | (characters == ord("["))).astype(np.int32)
    closed = ((characters == ord("}")) | (characters == ord("]"))).astype(np.int32)
    depth = int(np.cumsum(opened - closed).max(initial=0))
    if depth > limit:
        raise ValueError(f"nested {depth} deep, over the limit of {limit} (max_json_depth)")


def _stamp(target: Any, time_ns: int) -> None:
    target.timestamp.seconds, target.timestamp.nanos = divmod(time_ns, NANOS)


def compressed_image(data: bytes, picture_format: str, time_ns: int, camera: str) -> bytes:
    """The payload of a foxglove.CompressedImage (``jpeg`` or ``png``), or of a CompressedVideo
    (``h264``).
    """
    image = CompressedVideo() if picture_format == "h264" else CompressedImage()
    _stamp(image, time_ns)
    image.frame_id = camera
    image.data = data
    image.format = picture_format
    return bytes(image.SerializeToString(deterministic=True))


_LEVELS = dict(Log.Level.items())


def log_line(text: str, time_ns: int, name: str, level: str = "INFO") -> bytes:
    """The payload of a foxglove.Log."""
    line = Log(level=_LEVELS[level], message=text, name=name)
    _stamp(line, time_ns)
    return bytes(line.SerializeToString(deterministic=True))
