"""ROS bags that others' libraries wrote: the same tracks as from the pictures and boxes themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders.log import LogReader
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from replay.annotated_writer import replay
from replay.run import ReplayOptions

rosbags = pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
START_NS = 1_750_000_000_000_000_000
FRAMES = 60
VISION = {
    "vision_msgs/msg/Point2D": "float64 x\nfloat64 y\n",
    "vision_msgs/msg/Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "vision_msgs/msg/BoundingBox2D": (
        "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n"
    ),
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/Detection2D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox2D bbox\nstring id\n"
    ),
    "vision_msgs/msg/Detection2DArray": (
        "std_msgs/Header header\nvision_msgs/Detection2D[] detections\n"
    ),
}


def typestore() -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    found: dict[str, Any] = {}
    for name, text in VISION.items():
        found.update(get_types_from_msg(text, name))
    store.register(found)
    return store


def write_bag(path: Path, pets: Path, storage: str) -> None:
    """Pictures and det.txt of PETS as a ROS 2 bag, boxes by their centres."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = typestore()
    t = store.types
    header, time = t["std_msgs/msg/Header"], t["builtin_interfaces/msg/Time"]
    rows: dict[int, list[list[float]]] = {}
    for line in (pets / "det.txt").read_text().splitlines():
        values = [float(v) for v in line.split(",")]
        rows.setdefault(int(values[0]), []).append(values)
    point, quaternion = t["geometry_msgs/msg/Point"], t["geometry_msgs/msg/Quaternion"]
    pose = t["geometry_msgs/msg/PoseWithCovariance"](
        pose=t["geometry_msgs/msg/Pose"](
            position=point(0.0, 0.0, 0.0), orientation=quaternion(0.0, 0.0, 0.0, 1.0)
        ),
        covariance=np.zeros(36),
    )
    plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
    with Writer(path, version=9, storage_plugin=plugin) as bag:
        images = bag.add_connection(
            "/image/compressed", "sensor_msgs/msg/CompressedImage", typestore=store
        )
        found = bag.add_connection(
            "/detections", "vision_msgs/msg/Detection2DArray", typestore=store
        )
        for k in range(FRAMES):
            now = START_NS + k * 10**9 // 7
            stamp = header(
                stamp=time(sec=now // 10**9, nanosec=now % 10**9), frame_id="camera"
            )
            data = (pets / "img1" / f"{k + 1:06d}.jpg").read_bytes()
            image = t["sensor_msgs/msg/CompressedImage"](
                header=stamp, format="jpeg", data=np.frombuffer(data, np.uint8)
            )
            bag.write(images, now, store.serialize_cdr(image, image.__msgtype__))
            detections = [
                t["vision_msgs/msg/Detection2D"](
                    header=stamp,
                    results=[
                        t["vision_msgs/msg/ObjectHypothesisWithPose"](
                            hypothesis=t["vision_msgs/msg/ObjectHypothesis"](
                                class_id="", score=score
                            ),
                            pose=pose,
                        )
                    ],
                    bbox=t["vision_msgs/msg/BoundingBox2D"](
                        center=t["vision_msgs/msg/Pose2D"](
                            position=t["vision_msgs/msg/Point2D"](x=x + w / 2, y=y + h / 2),
                            theta=0.0,
                        ),
                        size_x=w,
                        size_y=h,
                    ),
                    id="",
                )
                for _, _, x, y, w, h, score, *_ in rows.get(k + 1, [])
            ]
            array = t["vision_msgs/msg/Detection2DArray"](
                header=stamp, detections=detections
            )
            # A detector answers later than the picture after next.
            late = now + 320_000_000
            bag.write(found, late, store.serialize_cdr(array, array.__msgtype__))


@pytest.fixture(scope="module")
def pets(real_data: Path) -> Path:
    return real_data / "pets09-s2l1"


@pytest.fixture(scope="module")
def plain(pets: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """Tracks of `record img1 --detections det.txt`."""
    folder = tmp_path_factory.mktemp("plain")
    few = folder / "img1"
    few.mkdir()
    for k in range(FRAMES):
        name = f"{k + 1:06d}.jpg"
        (few / name).write_bytes((pets / "img1" / name).read_bytes())
    rows = (pets / "det.txt").read_text().splitlines(keepends=True)
    det = folder / "det.txt"
    det.write_text("".join(r for r in rows if int(r.split(",")[0]) <= FRAMES))
    source = open_source(few, detections=det, fps=7)
    record(source, folder / "scene.mcap", RecordOptions(start_ns=START_NS))
    return tracks(folder / "scene.mcap", folder)


def tracks(scene: Path, folder: Path) -> dict[str, Any]:
    """Boxes of the recording, and payloads of the tracks, by frame."""
    out = folder / "annotated.mcap"
    replay(scene, out, ReplayOptions(tracker="events", force=True))
    with LogReader(out) as log, SceneLog(scene) as recorded:
        return {
            "boxes": [f.detections.boxes for f in recorded.frames()],
            "tracks": [(m.log_time_ns, m.data) for m in log.messages(["/camera/tracks"])],
        }


@pytest.mark.real
@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_ros2_bag_gives_the_same_tracks(
    pets: Path, plain: dict[str, Any], tmp_path: Path, storage: str
) -> None:
    bag = tmp_path / "bag"
    write_bag(bag, pets, storage)
    source = open_source(bag)
    assert "pictures and detections are paired by their equal stamps" in source.notes
    record(source, tmp_path / "scene.mcap", RecordOptions())
    found = tracks(tmp_path / "scene.mcap", tmp_path)
    assert found["boxes"] == plain["boxes"]
    assert found["tracks"] == plain["tracks"]


@pytest.mark.real
def test_a_foreign_log_is_recorded_replayed_and_annotated(
    real_data: Path, tmp_path: Path
) -> None:
    source = open_source(real_data / "scenes" / "mcap-camera-json")
    done = record(source, tmp_path / "scene.mcap", RecordOptions())
    assert (done.frames, done.width, done.height, done.losses) == (10, 520, 360, ())
    replay(tmp_path / "scene.mcap", tmp_path / "a.mcap", ReplayOptions(tracker="events"))
    with LogReader(tmp_path / "a.mcap") as log:
        counts = {c.topic: c.message_count for c in log.channels}
    assert counts["/camera/annotations"] == 10
    assert counts["/camera_calibration"] == 10


@pytest.mark.real
def test_bags_without_pictures_are_named(real_data: Path) -> None:
    from recorders.errors import SourceError

    bags = sorted((real_data / "mcap-recordings").glob("*.mcap"))
    assert len(bags) == 7
    for bag in bags:
        with pytest.raises(SourceError, match="no pictures and no detections of a kind"):
            open_source(bag)
