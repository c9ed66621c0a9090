"""A ROS 2 bag: pictures, tracks as vision_msgs/Detection2DArray, markers, events.

Written by the library ``rosbags`` (the extra ``ros``), as a folder with an MCAP file and
metadata.yaml, which `ros2 bag` plays.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
from msgspec import UNSET

from recorders import channels
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.channels import NANOS
from recorders.errors import SceneTraceError
from recorders.messages import Track
from replay.export.extras import needed
from replay.export.output import whole_folder
from replay.export.pictures import StoredPicture, StoredPictures
from replay.palette import track_colour

_METADATA = "metadata.yaml"
_VERSION = 9
_LAST_SECOND = 2**31 - 1
_DEFINITIONS = {
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta",
    "vision_msgs/msg/BoundingBox2D": (
        "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y"
    ),
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose"
    ),
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id"
    ),
    "vision_msgs/msg/Detection2DArray": (
        "std_msgs/Header header\nvision_msgs/Detection2D[] detections"
    ),
    "foxglove_msgs/msg/CompressedVideo": (
        "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format"
    ),
}
_ADD, _DELETE_ALL = 0, 3
_LINE_STRIP, _LINE_LIST, _TEXT = 4, 5, 9


def write_ros2(
    log: AnnotatedLog, out: str | Path, *, force: bool = False
) -> tuple[int, int]:
    """Write a bag folder; returns how many messages it has, and how many pictures were left out
    because they are stored as no format that ROS has a message for.

    Topics: ``/<camera>/image/compressed`` (or ``/<camera>/video``), ``/<camera>/tracked_boxes``
    (vision_msgs/Detection2DArray, ``id`` is the track's; only those present), ``/<camera>/markers``
    (visualization_msgs/MarkerArray in the picture's pixels, frame ``<camera>``),
    ``/<camera>/scene_events`` (std_msgs/String, the event as JSON).

    Raises:
        OutputExistsError: the folder holds something and ``force`` is not set.
        SceneTraceError: ``rosbags`` is not installed, or a frame's time is beyond what ROS 2 counts.
    """
    rosbag2 = needed("rosbags.rosbag2", "rosbags", "ros", "--to ros2")
    typesys = needed("rosbags.typesys", "rosbags", "ros", "--to ros2")
    path = Path(out)
    old = [point.name for point in path.glob("*.mcap")] if path.is_dir() else []
    with whole_folder(path, _METADATA, force=force, stale=old) as folder:
        inner = folder / path.name
        plugin = rosbag2.StoragePlugin.MCAP
        with rosbag2.Writer(inner, version=_VERSION, storage_plugin=plugin) as bag:
            writer = _Bag(bag, typesys, log.camera)
            pictures = StoredPictures(log)
            _write(writer, log, pictures)
        for file in list(inner.iterdir()):
            file.rename(folder / file.name)
        inner.rmdir()
    return writer.count, pictures.left_out


def _write(writer: _Bag, log: AnnotatedLog, pictures: StoredPictures) -> None:
    """Pictures and frames in the order of their times."""
    waiting = iter(pictures)
    picture = next(waiting, None)
    for frame in log.frames(("events", "relations")):
        while picture is not None and picture.time_ns <= frame.time_ns:
            writer.picture(picture)
            picture = next(waiting, None)
        writer.frame(frame)
    while picture is not None:
        writer.picture(picture)
        picture = next(waiting, None)


class _Bag:
    """Messages into a bag."""

    def __init__(self, bag: Any, typesys: Any, camera: str) -> None:
        self._bag, self._camera = bag, camera
        self._store = typesys.get_typestore(typesys.Stores.ROS2_HUMBLE)
        found: dict[str, Any] = {}
        for name, text in _DEFINITIONS.items():
            found |= typesys.get_types_from_msg(text, name)
        self._store.register(found)
        self._connections: dict[str, Any] = {}
        self.count = 0

    def _type(self, name: str) -> Callable[..., Any]:
        package, kind = name.split("/")
        made: Callable[..., Any] = self._store.types[f"{package}/msg/{kind}"]
        return made

    def _put(self, name: str, kind: str, message: Any, time_ns: int) -> None:
        package, plain = kind.split("/")
        full = f"{package}/msg/{plain}"
        if name not in self._connections:
            self._connections[name] = self._bag.add_connection(
                channels.topic(self._camera, name), full, typestore=self._store
            )
        data = self._store.serialize_cdr(message, full)
        self._bag.write(self._connections[name], time_ns, data)
        self.count += 1

    def _header(self, time_ns: int) -> Any:
        return self._type("std_msgs/Header")(
            stamp=self._time(time_ns), frame_id=self._camera
        )

    def _time(self, time_ns: int) -> Any:
        seconds, nanos = divmod(time_ns, NANOS)
        if seconds > _LAST_SECOND:
            raise SceneTraceError(
                f"a frame at {time_ns} ns: ROS 2 counts seconds in 32 bits, to"
                f" {_LAST_SECOND} (in 2038)"
            )
        return self._type("builtin_interfaces/Time")(sec=seconds, nanosec=nanos)

    def picture(self, picture: StoredPicture) -> None:
        data = np.frombuffer(picture.data, np.uint8)
        if picture.is_video:
            message = self._type("foxglove_msgs/CompressedVideo")(
                timestamp=self._time(picture.time_ns),
                frame_id=self._camera,
                data=data,
                format={"hevc": "h265"}.get(picture.kind, picture.kind),
            )
            self._put("video", "foxglove_msgs/CompressedVideo", message, picture.time_ns)
            return
        message = self._type("sensor_msgs/CompressedImage")(
            header=self._header(picture.time_ns), format=picture.kind, data=data
        )
        self._put(
            "image/compressed", "sensor_msgs/CompressedImage", message, picture.time_ns
        )

    def frame(self, frame: AnnotatedFrame) -> None:
        now = frame.time_ns
        header = self._header(now)
        present = [track for track in frame.tracks if track.present]
        array = self._type("vision_msgs/Detection2DArray")(
            header=header, detections=[self._detection(track, header) for track in present]
        )
        self._put("tracked_boxes", "vision_msgs/Detection2DArray", array, now)
        markers = self._type("visualization_msgs/MarkerArray")(
            markers=list(self._markers(frame, present, header))
        )
        self._put("markers", "visualization_msgs/MarkerArray", markers, now)
        for event in frame.events:
            text = self._type("std_msgs/String")(data=msgspec.json.encode(event).decode())
            self._put("scene_events", "std_msgs/String", text, now)

    def _detection(self, track: Track, header: Any) -> Any:
        x, y, w, h = track.box
        pose = self._type("vision_msgs/Pose2D")(
            position=self._type("vision_msgs/Point2D")(x=x + w / 2, y=y + h / 2), theta=0.0
        )
        label = "" if track.label is UNSET else track.label
        result = self._type("vision_msgs/ObjectHypothesisWithPose")(
            hypothesis=self._type("vision_msgs/ObjectHypothesis")(
                class_id=label, score=track.confidence
            ),
            pose=self._type("geometry_msgs/PoseWithCovariance")(
                pose=self._pose(), covariance=np.zeros(36)
            ),
        )
        box = self._type("vision_msgs/BoundingBox2D")(center=pose, size_x=w, size_y=h)
        return self._type("vision_msgs/Detection2D")(
            header=header, results=[result], bbox=box, id=str(track.id)
        )

    def _pose(self, x: float = 0.0, y: float = 0.0) -> Any:
        return self._type("geometry_msgs/Pose")(
            position=self._point(x, y),
            orientation=self._type("geometry_msgs/Quaternion")(x=0.0, y=0.0, z=0.0, w=1.0),
        )

    def _point(self, x: float, y: float) -> Any:
        return self._type("geometry_msgs/Point")(x=x, y=y, z=0.0)

    def _markers(
        self, frame: AnnotatedFrame, present: list[Track], header: Any
    ) -> Iterator[Any]:
        """All that was there before goes; boxes with ids, and the edges."""
        yield self._marker(header, "", 0, action=_DELETE_ALL)
        centres = {}
        for track in present:
            x, y, w, h = track.box
            centres[track.id] = x + w / 2, y + h / 2
            corners = [(x, y), (x + w, y), (x + w, y + h), (x, y + h), (x, y)]
            colour = (*track_colour(track.id), 1.0)
            own = track.id % (1 << 31)
            yield self._marker(
                header, "boxes", own, _LINE_STRIP, points=corners, colour=colour
            )
            yield self._marker(
                header, "ids", own, _TEXT, place=(x, y), text=str(track.id), colour=colour
            )
        edges = [
            relation
            for relation in frame.relations
            if relation.a in centres and relation.b in centres
        ]
        ends = [centres[end] for edge in edges for end in (edge.a, edge.b)]
        if ends:
            yellow = (1.0, 0.85, 0.2, 1.0)
            yield self._marker(
                header, "relations", 0, _LINE_LIST, points=ends, colour=yellow
            )

    def _marker(
        self,
        header: Any,
        space: str,
        identity: int,
        kind: int = 0,
        *,
        action: int = _ADD,
        points: list[tuple[float, float]] | None = None,
        place: tuple[float, float] = (0.0, 0.0),
        text: str = "",
        colour: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
    ) -> Any:
        make = self._type
        red, green, blue, alpha = colour
        size = 12.0 if kind == _TEXT else 2.0
        return make("visualization_msgs/Marker")(
            header=header,
            ns=space,
            id=identity,
            type=kind,
            action=action,
            pose=self._pose(*place),
            scale=make("geometry_msgs/Vector3")(x=size, y=size, z=size),
            color=make("std_msgs/ColorRGBA")(r=red, g=green, b=blue, a=alpha),
            lifetime=make("builtin_interfaces/Duration")(sec=0, nanosec=0),
            frame_locked=False,
            points=[self._point(x, y) for x, y in points or []],
            colors=[],
            texture_resource="",
            texture=make("sensor_msgs/CompressedImage")(
                header=header, format="", data=np.zeros(0, np.uint8)
            ),
            uv_coordinates=[],
            text=text,
            mesh_resource="",
            mesh_file=make("visualization_msgs/MeshFile")(
                filename="", data=np.zeros(0, np.uint8)
            ),
            mesh_use_embedded_materials=False,
        )
