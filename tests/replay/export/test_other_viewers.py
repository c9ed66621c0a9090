"""Exports for other people's tools, read back by those tools where they are installed."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import scenetrace
from recorders.annotated.reader import AnnotatedLog
from recorders.errors import SceneTraceError
from recorders.scene import SceneLog
from replay.cli import main
from replay.export import write_ros2, write_srt

FRAMES = 30


def exported(log: Path, to: str, out: Path, *words: str) -> int:
    return main(["export", str(log), "--to", to, "-o", str(out), *words])


def mot_rows(log: Path, tmp_path: Path) -> list[tuple[int, int, list[float]]]:
    out = tmp_path / "mot.txt"
    assert exported(log, "mot", out) == 0
    found = []
    for line in out.read_text().splitlines():
        frame, identity, *box = line.split(",")[:6]
        found.append((int(frame) - 1, int(identity), [float(v) for v in box]))
    return sorted(found)


def test_csv_has_names_and_all_rows(write_annotated: Any, tmp_path: Path) -> None:
    log = write_annotated()
    assert exported(log, "csv", tmp_path / "tracks.csv") == 0
    with (tmp_path / "tracks.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[0]["track"] == "1"
    assert float(rows[2]["x"]) == 12.0
    assert exported(log, "csv", tmp_path / "all") == 0
    assert (tmp_path / "all" / "events.csv").read_text().count("\n") == 3


@pytest.mark.parametrize(("to", "name"), [("coco", "c.json"), ("cvat", "c.xml")])
def test_boxes_come_back_as_detections(
    write_annotated: Any, tmp_path: Path, to: str, name: str
) -> None:
    log, out, again = write_annotated(), tmp_path / name, tmp_path / "again.mcap"
    assert exported(log, to, out) == 0
    words = ["record", str(out), "--fps", "10", "--size", "160x120", "-o", str(again)]
    assert main(words) == 0
    with SceneLog(again) as scene:
        found = [
            (frame.index, [round(v, 3) for v in box])
            for frame in scene.frames()
            for box in frame.detections.boxes
        ]
    wanted = [(frame, box) for frame, _, box in mot_rows(log, tmp_path)]
    assert sorted(found) == sorted(wanted)


def test_cvat_tracks_end_and_have_gaps(write_annotated: Any, tmp_path: Path) -> None:
    from defusedxml.ElementTree import parse

    out = tmp_path / "c.xml"
    assert exported(write_annotated(frames=range(10, 20)), "cvat", out) == 0
    tracks = parse(out).getroot().findall("track")
    assert [t.get("id") for t in tracks] == ["1", "2"]
    boxes = tracks[0].findall("box")
    assert [int(b.get("frame")) for b in boxes] == list(range(10, 20))
    assert {b.get("outside") for b in boxes} == {"0"}


def test_subtitles_tell_events_when_they_happen(
    write_annotated: Any, tmp_path: Path
) -> None:
    out = tmp_path / "e.srt"
    with AnnotatedLog(write_annotated()) as log:
        assert write_srt(log, out) == 2
    blocks = [block.splitlines() for block in out.read_text().strip().split("\n\n")]
    assert [block[1] for block in blocks] == [
        "00:00:00,800 --> 00:00:01,200",
        "00:00:01,200 --> 00:00:02,800",
        "00:00:02,800 --> 00:00:03,200",
    ]
    assert [block[2:] for block in blocks] == [
        ["1 and 2: interaction_started"],
        ["1 and 2: interaction_started", "1 and 2: joined"],
        ["1 and 2: joined"],
    ]


def test_clips_hold_every_event(write_annotated: Any, tmp_path: Path) -> None:
    out = tmp_path / "clips"
    assert exported(write_annotated(), "clips", out) == 0
    rows = list(csv.DictReader((out / "clips.csv").read_text().splitlines()))
    assert [(r["clip"], r["kind"], r["clip_t"]) for r in rows] == [
        ("clip_0001.mp4", "interaction_started", "1.0"),
        ("clip_0001.mp4", "joined", "1.4"),
    ]
    assert (out / "clip_0001.mp4").stat().st_size > 1000
    assert sorted(p.name for p in out.iterdir()) == ["clip_0001.mp4", "clips.csv"]
    assert exported(tmp_path / "annotated.mcap", "clips", out) == 1
    assert exported(tmp_path / "annotated.mcap", "clips", out, "--force") == 0


def panels_in(layout: Any) -> list[str]:
    if isinstance(layout, str):
        return [layout]
    return panels_in(layout["first"]) + panels_in(layout["second"])


def test_a_layout_shows_every_camera_with_its_drawings(
    write_annotated: Any, tmp_path: Path
) -> None:
    log = write_annotated(cameras=("north", "south"))
    out = tmp_path / "layout.json"
    assert exported(log, "layout", out, "--camera", "north") == 0
    layout = json.loads(out.read_text())
    assert sorted(panels_in(layout["layout"])) == sorted(layout["configById"])
    for camera in ("north", "south"):
        mode = layout["configById"][f"Image!{camera}_image"]["imageMode"]
        assert mode["imageTopic"] == f"/{camera}/image"
        assert mode["annotations"] == {f"/{camera}/annotations": {"visible": True}}
        assert layout["configById"][f"RosOut!{camera}_log"]["minLogLevel"] == 2


def test_a_bag_is_read_back_by_rosbags(write_annotated: Any, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    from rosbags.highlevel import AnyReader

    log, out = write_annotated(), tmp_path / "bag"
    assert exported(log, "ros2", out) == 0
    found, markers, pictures, events = [], 0, 0, []
    with AnyReader([out]) as reader:
        for connection, time_ns, data in reader.messages():
            message: Any = reader.deserialize(data, connection.msgtype)
            if connection.topic == "/camera/tracked_boxes":
                frame = round((time_ns - 5_000_000_000) / 100_000_000)
                stamp = message.header.stamp
                assert stamp.sec * 10**9 + stamp.nanosec == time_ns
                for one in message.detections:
                    centre, w, h = (
                        one.bbox.center.position,
                        one.bbox.size_x,
                        one.bbox.size_y,
                    )
                    box = [centre.x - w / 2, centre.y - h / 2, w, h]
                    found.append((frame, int(one.id), box))
            elif connection.topic == "/camera/markers":
                markers += len(message.markers)
            elif connection.topic == "/camera/image/compressed":
                assert message.format == "jpeg"
                assert bytes(message.data[:2]) == b"\xff\xd8"
                pictures += 1
            elif connection.topic == "/camera/scene_events":
                events.append(json.loads(message.data)["kind"])
    assert sorted(found) == mot_rows(log, tmp_path)
    assert (pictures, events) == (FRAMES, ["interaction_started", "joined"])
    assert markers == FRAMES + 2 * len(found) + 14


def test_a_bag_is_a_recording_again(write_annotated: Any, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    log, out, again = write_annotated(), tmp_path / "bag", tmp_path / "again.mcap"
    assert exported(log, "ros2", out) == 0
    assert main(["record", str(out), "-o", str(again), "--detect", "none"]) == 0
    with SceneLog(again) as scene:
        frames = list(scene.frames())
        boxes = [(f.index, box) for f in frames for box in f.detections.boxes]
    assert len(boxes) == len(mot_rows(log, tmp_path))


@pytest.mark.parametrize(
    ("to", "module", "extra"),
    [("ros2", "rosbags.rosbag2", "ros"), ("rrd", "rerun", "rerun")],
)
def test_a_missing_package_is_said(
    write_annotated: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    to: str,
    module: str,
    extra: str,
) -> None:
    monkeypatch.setitem(sys.modules, module, None)
    log, out = write_annotated(), tmp_path / "out.x"
    assert exported(log, to, out) == 1
    said = capsys.readouterr().err
    assert f"pip install 'scenetrace[{extra}]'" in said
    assert said.count("\n") == 1
    assert not out.exists()


def test_a_bag_without_pictures_has_the_rest(write_annotated: Any, tmp_path: Path) -> None:
    pytest.importorskip("rosbags")
    with AnnotatedLog(write_annotated(pictures=False)) as log:
        messages, left_out = write_ros2(log, tmp_path / "bag")
    assert (messages, left_out) == (2 * FRAMES + 2, 0)


def test_rerun_has_boxes_with_ids_edges_and_events(
    write_annotated: Any, tmp_path: Path
) -> None:
    pytest.importorskip("rerun")
    out = tmp_path / "scene.rrd"
    assert exported(write_annotated(), "rrd", out) == 0
    assert out.read_bytes().startswith(b"RRF")
    said = rerun("rrd", "print", "-vvv", str(out))
    for name in ("image", "image/tracks", "image/relations", "image/trails", "events"):
        assert f"/camera/{name}" in said, name
    for what in ("1 and 2: joined", "Boxes2D:labels", "EncodedImage:blob", "capture_time"):
        assert what in said, what


def test_rerun_finds_nothing_wrong_with_our_logs(
    write_annotated: Any, tmp_path: Path
) -> None:
    pytest.importorskip("rerun")
    said = rerun("mcap", "check", str(write_annotated()))
    rows = [line for line in said.splitlines() if "/camera/" in line]
    assert len(rows) >= 7
    assert [line for line in rows if not line.startswith("ok")] == []


def rerun(*words: str) -> str:
    made = subprocess.run(
        [sys.executable, "-m", "rerun", *words], capture_output=True, text=True, check=False
    )
    return made.stdout + made.stderr


def test_detections_of_supervision(write_annotated: Any) -> None:
    pytest.importorskip("supervision")
    with scenetrace.open(write_annotated()) as log:
        found = scenetrace.to_detections(log[3])
    assert found.tracker_id.tolist() == [1, 2]
    assert found.xyxy.tolist() == [[16, 40, 36, 80], [124, 42.5, 144, 82.5]]
    assert np.allclose(found.confidence, 0.9)


def test_supervision_that_is_missing_is_said(
    write_annotated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "supervision", None)
    with (
        scenetrace.open(write_annotated()) as log,
        pytest.raises(SceneTraceError, match="pip install 'scenetrace\\[supervision\\]'"),
    ):
        scenetrace.to_detections(log[3])
