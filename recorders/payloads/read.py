"""A payload into plain fields, whatever its encoding: what the readers of pictures and detections
share.
"""

from __future__ import annotations

import base64
import binascii
import math
import re
from datetime import UTC, datetime
from functools import lru_cache
from typing import Any

import msgspec
from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
from foxglove_schemas_protobuf.CompressedVideo_pb2 import CompressedVideo
from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations
from foxglove_schemas_protobuf.RawImage_pb2 import RawImage
from google.protobuf.message import DecodeError

from recorders.errors import SceneTraceError
from recorders.log.model import ChannelInfo, Message, Schema
from recorders.loose_json import decode_loose
from recorders.payloads import ros
from recorders.payloads.ros_known import known_definition

NANOS = 1_000_000_000
_OURS = "scenetrace.Detections"
_PROTOBUF: dict[str, Any] = {
    "foxglove.CompressedImage": CompressedImage,
    "foxglove.CompressedVideo": CompressedVideo,
    "foxglove.ImageAnnotations": ImageAnnotations,
    "foxglove.RawImage": RawImage,
}
_RFC3339 = re.compile(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(\.\d{1,9})?(Z|[+-]\d\d:\d\d)")


class PayloadError(SceneTraceError):
    """A message that cannot be read as what its channel says it is; the text is the reason alone."""


def payload_kind(channel: ChannelInfo) -> str:
    """What a channel holds: its schema's name, the same for every encoding.

    >>> from recorders.log.model import Schema
    >>> schema = Schema("sensor_msgs/msg/Image", "ros2msg", b"")
    >>> payload_kind(ChannelInfo("/a", schema, "cdr"))
    'sensor_msgs/Image'
    """
    name = "" if channel.schema is None else channel.schema.name
    if not name and channel.message_encoding == "json":
        # Without a schema the topic tells: /camera/detections.
        return _OURS if channel.topic.endswith("/detections") else ""
    if name.startswith("foxglove_msgs/"):
        return f"foxglove.{name.rsplit('/', 1)[1]}"
    return ros.plain_name(name)


_FOR_ADDRESSES = str.maketrans("-_", "+/")


@lru_cache(maxsize=64)
def _definitions(name: str, text: bytes) -> ros.Definitions:
    return ros.parse_definitions(name, text.decode("utf-8", "replace"))


def _definition(schema: Schema) -> bytes:
    """A ROS message's definition; that which is known where the log has none that can be read.

    Raises:
        PayloadError: none is known.
    """
    if schema.data and schema.encoding in ("ros2msg", "ros1msg"):
        return schema.data
    known = known_definition(schema.name).encode()
    if not known:
        lacking = "written in " + schema.encoding if schema.data else "not in the log"
        raise PayloadError(f"its definition is {lacking}; ros2msg and ros1msg can be read")
    return known


def fields(channel: ChannelInfo, data: bytes) -> Any:
    """The payload's fields: a protobuf message, or a dictionary with the same or ROS' names.

    Raises:
        PayloadError: the encoding is none that can be read, or the payload does not follow it;
            names the channel's schema and encoding.
    """
    kind, encoding = payload_kind(channel), channel.message_encoding
    try:
        if encoding == "protobuf" and kind in _PROTOBUF:
            return _PROTOBUF[kind].FromString(data)
        if encoding == "json":
            return decode_loose(data)
        if encoding in ("cdr", "ros1") and channel.schema is not None:
            definitions = _definitions(channel.schema.name, _definition(channel.schema))
            return ros.decode(channel.schema.name, definitions, data, encoding == "ros1")
    except (
        DecodeError,
        msgspec.DecodeError,
        ros.DefinitionError,
        UnicodeDecodeError,
    ) as error:
        raise PayloadError(f"not {described(channel)}: {error}") from error
    raise PayloadError(
        f"{described(channel)} cannot be read; known are protobuf, json, cdr and ros1"
    )


def described(channel: ChannelInfo) -> str:
    """A channel's schema and encoding in words."""
    name = "a message without a schema" if channel.schema is None else channel.schema.name
    return f"{name} in the encoding {channel.message_encoding or 'none'}"


def member(found: Any, name: str) -> Any:
    """A field of a protobuf message or of a dictionary; None where there is none."""
    if isinstance(found, dict):
        return found.get(name)
    return getattr(found, name, None)


def binary(value: Any) -> bytes:
    """Bytes as they are, or out of JSON's base64.

    Raises:
        PayloadError: neither.
    """
    if isinstance(value, bytes):
        return value
    if isinstance(value, str):
        # As browsers have it (data:image/jpeg;base64,...), for addresses, without what fills it up.
        text = value.partition(";base64,")[2] if value.startswith("data:") else value
        text = "".join(text.split()).rstrip("=").translate(_FOR_ADDRESSES)
        try:
            return base64.b64decode(text + "=" * (-len(text) % 4), validate=True)
        except (binascii.Error, ValueError) as error:
            raise PayloadError(f"its data is no base64: {error}") from error
    if isinstance(value, list):
        try:
            return bytes(value)
        except (TypeError, ValueError) as error:
            raise PayloadError(f"its data is no list of bytes: {error}") from error
    raise PayloadError("it holds no data")


def whole(value: Any, what: str) -> int:
    """A whole number of 0 or more.

    Raises:
        PayloadError: it is none.
    """
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise PayloadError(f"{what} is no number")
    if not math.isfinite(value) or value < 0 or value != int(value):
        raise PayloadError(f"{what} is {value}: a whole number of 0 or more is wanted")
    return int(value)


def stamp_ns(found: Any) -> int:
    """When a message says that it was captured, in ns; 0 where it does not say."""
    header = member(found, "header")
    stamp = member(found, "timestamp") if header is None else member(header, "stamp")
    if isinstance(stamp, str):
        return _from_text(stamp)
    for seconds, nanos in (("seconds", "nanos"), ("sec", "nanosec"), ("sec", "nsec")):
        a, b = member(stamp, seconds), member(stamp, nanos)
        if isinstance(a, int) and isinstance(b, int):
            return max(0, a * NANOS + b)
    return 0


def own_stamp_ns(message: Message) -> int:
    """A message's own stamp, also of one whose picture cannot be read; 0 where it has none."""
    try:
        return stamp_ns(fields(message.channel, message.data))
    except PayloadError:
        return 0


def _from_text(text: str) -> int:
    match = _RFC3339.fullmatch(text)
    if match is None:
        return 0
    zone = "+00:00" if match[3] == "Z" else match[3]
    try:
        moment = datetime.fromisoformat(match[1] + zone)
    except ValueError:
        return 0
    since = moment - datetime(1970, 1, 1, tzinfo=UTC)
    nanos = int((match[2] or ".0")[1:].ljust(9, "0"))
    return max(0, (since.days * 86_400 + since.seconds) * NANOS + nanos)


def frame_id(found: Any) -> str:
    """The coordinate frame that a message names, or an empty text."""
    header = member(found, "header")
    name = member(found if header is None else header, "frame_id")
    return name if isinstance(name, str) else ""
