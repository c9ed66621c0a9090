"""More of what is fuzzed: payloads, folders of boxes, models, cases, notes, words of a command."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from reasoning.questions.metres import read_points
from recorders import channels
from recorders.annotated.membership import decode_labels
from recorders.detectors.model_file import parse_names, read_model
from recorders.formats.columns import parse_columns
from recorders.formats.opening import open_rows
from recorders.log import ChannelInfo, LogReader, Schema
from recorders.payloads.pictures import read_picture
from replay.cases.case_file import read_case
from replay.cases.notes import read_notes
from replay.cli.common import parse_clock, parse_limits
from replay.compare import compare
from replay.evaluate.truth import read_truth
from tests.faults.fuzz import Target

_FILES = {
    "yolo/000001.txt": b"0 0.5 0.5 0.1 0.2 0.9\n1 0.2 0.3 0.1 0.1 0.5\n",
    "kitti/000001.txt": b"Car 0.00 0 -1.5 100.0 120.0 200.0 180.0 1.5 1.6 3.9 1 2 3 0.1 0.9\n",
    "labelme/1.json": json.dumps(
        {
            "imageWidth": 640,
            "imageHeight": 480,
            "shapes": [
                {"label": "p", "shape_type": "rectangle", "points": [[1, 2], [30, 40]]}
            ],
        }
    ).encode(),
    "voc/1.xml": b"<annotation><size><width>640</width><height>480</height></size><object>"
    b"<name>p</name><bndbox><xmin>1</xmin><ymin>2</ymin><xmax>30</xmax><ymax>40</ymax></bndbox>"
    b"</object></annotation>",
}
_DEFINITION = b"""std_msgs/Header header
string format
uint8[] data
================================================================================
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
"""
_CDR = b"\0\1\0\0" + bytes(8) + b"\4\0\0\0cam\0" + b"\4\0\0\0png\0" + b"\3\0\0\0abc"


def more_targets(folder: Path) -> dict[str, tuple[Sequence[bytes], Target]]:
    """Each target: sound inputs, and what reads one. `folder` has what `targets` made."""
    log = folder / "annotated-zstd.mcap"
    picture = np.zeros((24, 32), np.uint8)
    picture[4:9, 5:20] = 3
    with LogReader(log) as opened:
        messages = {m.topic: m.data for m in opened.messages()}
    sent = channels.compressed_image(b"\xff\xd8\xff", "jpeg", 5, "camera")
    found: dict[str, tuple[Sequence[bytes], Target]] = {
        "label images": (
            [cv2.imencode(".png", picture)[1].tobytes()],
            lambda data, _: decode_labels(data),
        ),
        "Foxglove's pictures": ([sent], _payload("foxglove.CompressedImage", "protobuf")),
        "ROS 2's pictures": ([_CDR], _payload("sensor_msgs/msg/CompressedImage", "cdr")),
        "ROS definitions": ([_DEFINITION], _definition),
        "pictures in JSON": (
            [b'{"timestamp": {"sec": 1, "nsec": 2}, "format": "png", "data": "aGFsbG8="}'],
            _payload("foxglove.CompressedImage", "json"),
        ),
        "points in metres": ([b"x,y,X,Y\n0,0,0,0\n1,0,5,0\n0,1,0,5\n1,1,5,5\n"], _points),
        "cases": ([_case(log)], _written("case.toml", read_case)),
        "notes": (
            [b'{"recording": "a", "frame": 37, "t": 1.5, "text": "x", "by": "me"}\n'],
            _written("notes.jsonl", read_notes),
        ),
        "models": ([_model()], _written("model.onnx", read_model)),
        "names in a model": (
            [b"{0: 'person', 2: 'car'}", b'["cat", "dog"]'],
            lambda text, _: parse_names(text.decode("utf-8", "replace")),
        ),
        "golden files": ([log.read_bytes()], _compared),
        "ground truth": (
            [b"1,1,10,20,30,40,1,1,1\n2,1,11,20,30,40,1,1,1\n"],
            _written("gt.txt", read_truth),
        ),
        "words: columns": ([b"frame,x,y,w,h,score", b"f,_,x1"], _word(parse_columns)),
        "words: clock": (
            [b"1:20", b"12:03:40", b"2026-01-31T12:00:00+01:00"],
            _word(lambda text: parse_clock(text, lambda: 0)),
        ),
        "words: limits": ([b"max_chunk_bytes=5"], _word(lambda text: parse_limits([text]))),
    }
    for name, seed in _FILES.items():
        found[f"boxes ({name})"] = ([seed], _folder(name))
    for topic, data in sorted(messages.items()):
        name = topic.rsplit("/", 1)[1]
        found[f"payloads ({name})"] = ([data], _decoded(name))
    return found


def _case(log: Path) -> bytes:
    return (
        f'title = "x"\nzones = {{door = [[1, 1], [9, 1], [9, 9.5]]}}\n[[recordings]]\n'
        f'log = "{log.name}"\nstart = 2026-03-01T12:00:00+01:00\n'
    ).encode()


def _model() -> bytes:
    from onnx import TensorProto, helper

    shape = helper.make_tensor_value_info("x", TensorProto.FLOAT, [1, 3, 8, 8])
    out = helper.make_tensor_value_info("y", TensorProto.FLOAT, [1, 3, 8, 8])
    node = helper.make_node("Relu", ["x"], ["y"])
    model = helper.make_model(helper.make_graph([node], "g", [shape], [out]))
    return bytes(model.SerializeToString())


def _written(name: str, read: Callable[[Path], Any]) -> Target:
    def target(data: bytes, folder: Path) -> None:
        (folder / name).write_bytes(data)
        read(folder / name)

    return target


def _word(read: Callable[[str], Any]) -> Target:
    return lambda data, _: read(data.decode("utf-8", "replace"))


def _decoded(name: str) -> Target:
    return lambda data, _: channels.decode(name, data)


def _payload(kind: str, encoding: str) -> Target:
    language = {"cdr": "ros2msg", "protobuf": "protobuf", "json": "jsonschema"}[encoding]
    text = _DEFINITION if encoding == "cdr" else b""
    if encoding == "protobuf":
        text = channels.schema("image").data
    channel = ChannelInfo("/x", Schema(kind, language, text), encoding)
    return lambda data, _: read_picture(channel, data)


def _definition(data: bytes, folder: Path) -> None:
    schema = Schema("sensor_msgs/msg/CompressedImage", "ros2msg", data)
    read_picture(ChannelInfo("/x", schema, "cdr"), _CDR)


def _points(data: bytes, folder: Path) -> None:
    _written("points.csv", read_points)(data, folder)


def _folder(name: str) -> Target:
    def target(data: bytes, folder: Path) -> None:
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(data)
        for _ in open_rows(path.parent, (640, 480)).rows(lambda *_: None):
            pass

    return target


def _compared(data: bytes, folder: Path) -> None:
    path = folder / "golden.mcap"
    path.write_bytes(data)
    compare(path, folder / "annotated-zstd.mcap")
