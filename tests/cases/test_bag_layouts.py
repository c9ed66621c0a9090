"""Bags as they lie about: without metadata.yaml, without definitions, in several files, packed
message by message, damaged.
"""

from __future__ import annotations

import shutil
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from recorders.errors import SourceError
from recorders.log import Message
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import open_source
from recorders.sources.opening import open_log

rosbags = pytest.importorskip("rosbags", reason="the extra `ros` is not installed")
START_NS, STEP_NS, FRAMES = 1_750_000_000_000_000_000, 40_000_000, 8
PICTURE = "sensor_msgs/msg/CompressedImage"
BOXES = "vision_msgs/msg/Detection2DArray"
OWN = "my_package/msg/Odd"
EVERYTHING = {"/cam/compressed": PICTURE, "/found": BOXES, "/odd": OWN}


def _types(name: str) -> Any:
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from recorders.payloads.ros_known import known_definition

    store = get_typestore(getattr(Stores, name))
    found: dict[str, Any] = {}
    for section in known_definition(BOXES).split("=" * 80 + "\n"):
        head, _, body = section.partition("\n")
        if head.startswith("MSG: vision_msgs/"):
            kind = head.removeprefix("MSG: vision_msgs/")
            found.update(get_types_from_msg(body, f"vision_msgs/msg/{kind}"))
        elif "Detection2D[]" in section:
            found.update(get_types_from_msg(section, BOXES))
    found.update(get_types_from_msg("string a\nfloat32[3] b\n", OWN))
    store.register(found)
    return store


def _jpeg(k: int) -> bytes:
    image = np.full((48, 64, 3), 60, np.uint8)
    image[10:30, 4 * k : 4 * k + 10] = 200
    return cv2.imencode(".jpg", image)[1].tobytes()


def _message(store: Any, kind: str, k: int) -> Any:
    t = store.types
    now = START_NS + k * STEP_NS
    header, time = t["std_msgs/msg/Header"], t["builtin_interfaces/msg/Time"]
    more = {"seq": k} if "seq" in header.__dataclass_fields__ else {}
    stamp = header(
        stamp=time(sec=now // 10**9, nanosec=now % 10**9), frame_id="camera", **more
    )
    if kind == PICTURE:
        data = np.frombuffer(_jpeg(k), np.uint8)
        return t[kind](header=stamp, format="jpeg", data=data)
    if kind == OWN:
        return t[kind](a="odd", b=np.zeros(3, np.float32))
    place = t["vision_msgs/msg/Point2D"](x=4.0 * k + 5, y=20.0)
    box = t["vision_msgs/msg/BoundingBox2D"](
        center=t["vision_msgs/msg/Pose2D"](position=place, theta=0.0),
        size_x=10.0,
        size_y=20.0,
    )
    one = t["vision_msgs/msg/Detection2D"](header=stamp, results=[], bbox=box, id="")
    return t[kind](header=stamp, detections=[one])


def ros2(
    path: Path, topics: dict[str, str], storage: str = "SQLITE3", packed: str = ""
) -> Path:
    """A bag folder of ROS 2."""
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

    store = _types("ROS2_HUMBLE")
    writer = Writer(path, version=8, storage_plugin=StoragePlugin[storage])
    if packed:
        writer.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with writer as bag:
        for topic, kind in topics.items():
            connection = bag.add_connection(topic, kind, typestore=store)
            for k in range(FRAMES):
                message = _message(store, kind, k)
                now = START_NS + k * STEP_NS
                bag.write(connection, now, store.serialize_cdr(message, kind))
    return path


def ros1(path: Path, topics: dict[str, str], frames: range) -> Path:
    """A bag file of ROS 1."""
    from rosbags.rosbag1 import Writer

    store = _types("ROS1_NOETIC")
    with Writer(path) as bag:
        for topic, kind in topics.items():
            connection = bag.add_connection(topic, kind, typestore=store)
            for k in frames:
                message = _message(store, kind, k)
                now = START_NS + k * STEP_NS
                bag.write(connection, now, store.serialize_ros1(message, kind))
    return path


def without_definitions(folder: Path) -> Path:
    """As distributions before Iron wrote it."""
    for file in folder.glob("*.db3"):
        with sqlite3.connect(file) as database:
            database.execute("DROP TABLE message_definitions")
            database.execute("DROP TABLE schema")
        database.close()
    return folder


def alone(folder: Path) -> Path:
    """A storage file that was copied out of its folder."""
    (file,) = folder.glob("*.db3")
    return Path(shutil.move(file, folder.parent / "copied.db3"))


def _split(folder: Path) -> Path:
    folder.mkdir()
    ros1(folder / "walk_0.bag", EVERYTHING, range(FRAMES // 2))
    ros1(folder / "walk_1.bag", EVERYTHING, range(FRAMES // 2, FRAMES))
    return folder


LAYOUTS: dict[str, Callable[[Path], list[Path]]] = {
    "without definitions": lambda t: [without_definitions(ros2(t / "b", EVERYTHING))],
    "a lone file": lambda t: [alone(without_definitions(ros2(t / "b", EVERYTHING)))],
    "its metadata": lambda t: [ros2(t / "b", EVERYTHING) / "metadata.yaml"],
    "packed messages": lambda t: [ros2(t / "b", EVERYTHING, "MCAP", "MESSAGE")],
    "a packed file": lambda t: [ros2(t / "b", EVERYTHING, "SQLITE3", "FILE")],
    "apart, two kinds": lambda t: [
        ros2(t / "a", {"/cam/compressed": PICTURE, "/odd": OWN}, "MCAP"),
        ros2(t / "b", {"/found": BOXES}),
    ],
    "ROS 1 splits": lambda t: [_split(t / "b")],
    "ROS 1 files": lambda t: sorted(_split(t / "b").iterdir()),
}


@pytest.mark.parametrize("layout", LAYOUTS)
def test_every_layout_gives_the_same_recording(tmp_path: Path, layout: str) -> None:
    source = open_source(LAYOUTS[layout](tmp_path))
    done = record(source, tmp_path / "scene.mcap", RecordOptions())
    assert done.losses == ()
    with SceneLog(tmp_path / "scene.mcap") as scene:
        frames = list(scene.frames())
    assert [f.time_ns for f in frames] == [START_NS + k * STEP_NS for k in range(FRAMES)]
    boxes = [[(4.0 * k, 10.0, 10.0, 20.0)] for k in range(FRAMES)]
    assert [f.detections.boxes for f in frames] == boxes
    assert all(f.image is not None for f in frames)
    passed = _of(tmp_path / "scene.mcap", "/odd")
    assert len(passed) == FRAMES
    assert all(
        message.channel.schema.name == OWN for message in passed if message.channel.schema
    )


def _of(path: Path, topic: str) -> list[Message]:
    from recorders.log import LogReader

    with LogReader(path) as log:
        return list(log.messages([topic]))


def test_latched_channels_stay_latched(tmp_path: Path) -> None:
    from rosbags.interfaces import (
        Qos,
        QosDurability,
        QosHistory,
        QosLiveliness,
        QosReliability,
        QosTime,
    )
    from rosbags.rosbag2 import StoragePlugin, Writer

    store = _types("ROS2_HUMBLE")
    never = QosTime(0, 0)
    latched = Qos(
        QosHistory.KEEP_LAST, 1, QosReliability.RELIABLE, QosDurability.TRANSIENT_LOCAL,
        never, never, QosLiveliness.AUTOMATIC, never, False,
    )  # fmt: skip
    with Writer(tmp_path / "b", version=9, storage_plugin=StoragePlugin.SQLITE3) as bag:
        connection = bag.add_connection(
            "/map", OWN, typestore=store, offered_qos_profiles=[latched]
        )
        message = _message(store, OWN, 0)
        bag.write(connection, START_NS, store.serialize_cdr(message, OWN))
    files = open_log([tmp_path / "b"], _limits())
    assert files is not None
    (channel,) = files.channels
    assert "durability: 1" in channel.metadata["offered_qos_profiles"]


def _limits() -> Any:
    from recorders.limits import DEFAULT_LIMITS

    return DEFAULT_LIMITS


def test_what_metadata_names_and_is_not_there(tmp_path: Path) -> None:
    folder = ros2(tmp_path / "walk", EVERYTHING)
    text = (folder / "metadata.yaml").read_text()
    entry = "- walk.db3"
    assert entry in text
    indent = text[: text.index(entry)].rsplit("\n", 1)[1]
    more = text.replace(entry, f"{entry}\n{indent}- walk_1.db3", 1)
    (folder / "metadata.yaml").write_text(more)
    done = record(open_source(folder), tmp_path / "scene.mcap", RecordOptions())
    assert done.losses == ("metadata.yaml names files that are not there: walk_1.db3",)
    (folder / "walk.db3").unlink()
    with pytest.raises(SourceError, match=r"a bag without its files: metadata\.yaml names"):
        open_source(folder)


def test_a_bag_that_was_cut_off_says_what_to_do(tmp_path: Path) -> None:
    bag = ros1(tmp_path / "walk.bag", EVERYTHING, range(FRAMES))
    bag.write_bytes(bag.read_bytes()[: bag.stat().st_size // 2])
    with pytest.raises(SourceError, match="`rosbag reindex` writes the index"):
        open_source(bag)
    folder = ros2(tmp_path / "b", EVERYTHING)
    (file,) = folder.glob("*.db3")
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    with pytest.raises(SourceError, match=r"sqlite3 b.db3 .recover \| sqlite3 whole.db3"):
        open_source(folder)
