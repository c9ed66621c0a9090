"""What messages of other people's logs say: pictures, videos and detections in the encodings that
camera logs are written in (Foxglove's protobuf and JSON, ROS 2 CDR, ROS 1).
"""

from recorders.payloads.detections import DETECTIONS, Detected, read_detections
from recorders.payloads.pictures import (
    PICTURES,
    RawPicture,
    Still,
    VideoPacket,
    read_picture,
)
from recorders.payloads.read import PayloadError, own_stamp_ns, payload_kind

__all__ = [
    "DETECTIONS",
    "PICTURES",
    "Detected",
    "PayloadError",
    "RawPicture",
    "Still",
    "VideoPacket",
    "own_stamp_ns",
    "payload_kind",
    "read_detections",
    "read_picture",
]
