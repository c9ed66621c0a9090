"""Definitions of the messages that hold pictures and detections, for bags that lack them: those of
ROS 2 before Iron in SQLite, and those whose definitions are written as IDL.
"""

from __future__ import annotations

_LINE = "=" * 80
_TIME = "int32 sec\nuint32 nanosec\n"
_HEADER = "builtin_interfaces/Time stamp\nstring frame_id\n"
_POSE = "geometry_msgs/Point position\ngeometry_msgs/Quaternion orientation\n"
_PARTS = {
    "builtin_interfaces/Time": _TIME,
    "std_msgs/Header": _HEADER,
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Quaternion": "float64 x\nfloat64 y\nfloat64 z\nfloat64 w\n",
    "geometry_msgs/Pose": _POSE,
    "geometry_msgs/PoseWithCovariance": "geometry_msgs/Pose pose\nfloat64[36] covariance\n",
    "vision_msgs/Point2D": "float64 x\nfloat64 y\n",
    "vision_msgs/Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "vision_msgs/BoundingBox2D": (
        "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n"
    ),
    "vision_msgs/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id\n"
    ),
}
_WHOLE = {
    "sensor_msgs/CompressedImage": "std_msgs/Header header\nstring format\nuint8[] data\n",
    "sensor_msgs/Image": (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
        "uint8 is_bigendian\nuint32 step\nuint8[] data\n"
    ),
    "ffmpeg_image_transport_msgs/FFMPEGPacket": (
        "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\n"
        "uint8 flags\nbool is_bigendian\nuint8[] data\n"
    ),
    "vision_msgs/Detection2DArray": (
        "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n"
    ),
}


def known_definition(name: str) -> str:
    """The definition of a ROS 2 type as logs carry it, with all that it builds on; empty where it
    is none of those that are read here.

    >>> known_definition("sensor_msgs/msg/CompressedImage").splitlines()[0]
    'std_msgs/Header header'
    >>> known_definition("my_package/msg/Odd")
    ''
    """
    parts = name.split("/")
    body = _WHOLE.get("/".join((parts[0], parts[-1])))
    if body is None:
        return ""
    rest = [f"{_LINE}\nMSG: {part}\n{text}" for part, text in _needed(body).items()]
    return "\n".join([body.rstrip("\n"), *(text.rstrip("\n") for text in rest)]) + "\n"


def _needed(body: str) -> dict[str, str]:
    """The types that a definition builds on, in the order in which they are met."""
    found: dict[str, str] = {}
    waiting = [body]
    while waiting:
        for line in waiting.pop(0).splitlines():
            kind = line.split(maxsplit=1)[0].split("[", maxsplit=1)[0]
            if kind in _PARTS and kind not in found:
                found[kind] = _PARTS[kind]
                waiting.append(_PARTS[kind])
    return found
