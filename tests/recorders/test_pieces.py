"""Pieces of logs stand alone: what still holds and what pictures need comes along."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from recorders.annotated.reader import AnnotatedLog
from recorders.errors import UsageError
from recorders.log import LogReader, LogWriter, Schema
from recorders.pieces import Span, cut, merge
from recorders.scene import SceneLog
from replay.cli import main

FPS = 25
FRAMES = 40
REGIONS = {
    "roi": [[4, 4], [124, 4], [124, 92], [4, 92]],
    "zones": {"door": [[40, 20], [90, 20], [90, 80], [40, 80]]},
}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a scene log of H.264 with regions, and its annotated log."""
    folder = tmp_path_factory.mktemp("pieces")
    pictures = folder / "img"
    pictures.mkdir()
    rng = np.random.default_rng(0)
    ground = cv2.resize(rng.integers(0, 255, (12, 16, 3), np.uint8), (128, 96))
    rows = []
    for k in range(FRAMES):
        picture = ground.copy()
        cv2.rectangle(picture, (10 + 2 * k, 30), (22 + 2 * k, 66), (10, 200, 240), -1)
        cv2.imwrite(str(pictures / f"{k + 1:06d}.png"), picture)
        rows.append(f"{k + 1},-1,{10 + 2 * k},30,12,36,0.9,-1,-1,-1")
    (folder / "det.txt").write_text("\n".join(rows) + "\n")
    (folder / "r.json").write_text(json.dumps(REGIONS))
    scene = folder / "scene.mcap"
    words = f"--fps {FPS} --codec h264 --detect none --detections {folder / 'det.txt'}"
    words += f" --regions {folder / 'r.json'}"
    assert main(["record", str(pictures), "-o", str(scene), *words.split()]) == 0
    assert main(["replay", str(scene), "-o", str(folder / "annotated.mcap")]) == 0
    return folder


def pictures_of(path: Path) -> dict[int, np.ndarray]:
    with SceneLog(path) as scene:
        found = {frame.time_ns: np.asarray(frame.image) for frame in scene.frames()}
        assert scene.unreadable.lines() == []
    return found


def span_of(path: Path, first: int, end: int) -> Span:
    with SceneLog(path) as scene:
        times = list(scene.frame_times())
    return Span(times[first], times[end])


def test_a_cut_has_regions_and_the_packets_since_the_key_frame(
    place: Path, tmp_path: Path
) -> None:
    scene, out = place / "scene.mcap", tmp_path / "cut.mcap"
    whole = pictures_of(scene)
    report = cut(scene, out, span_of(scene, 7, 12))
    assert report.carried >= 2
    assert report.notes == []
    piece = pictures_of(out)
    assert list(piece) == list(whole)[7:12]
    for time_ns, picture in piece.items():
        assert picture is not None
        assert np.array_equal(picture, whole[time_ns])
    with SceneLog(out) as opened:
        frame = next(opened.frames())
        assert frame.regions is not None
        assert [zone.name for zone in frame.regions.zones] == ["door"]


@pytest.mark.parametrize("words", [[], ["--annotations-only"]])
def test_a_cut_says_what_a_replay_of_the_span_says_and_verifies(
    place: Path, tmp_path: Path, words: list[str]
) -> None:
    scene, whole = place / "scene.mcap", place / "annotated.mcap"
    span, out = tmp_path / "span.mcap", tmp_path / "cut.mcap"
    ends = ["--from", "frame:10", "--to", "frame:20"]
    topics = [] if not words else [
        "--exclude", "/camera/image,/camera/detections,/camera/regions,/camera/foreground"
    ]  # fmt: skip
    assert main(["replay", str(scene), "-o", str(span), *ends, *words]) == 0
    assert main(["cut", str(whole), "-o", str(out), *ends, *topics]) == 0
    assert main(["verify", str(out), "--scene", str(scene)]) == 0
    with LogReader(span) as a, LogReader(out) as b:
        said = [
            [
                (m.topic, m.log_time_ns, m.publish_time_ns, m.sequence, m.data)
                for m in log.messages()
            ]
            for log in (a, b)
        ]
    assert sorted(said[0]) == sorted(said[1])


def test_the_span_of_a_replay_stands_alone(place: Path, tmp_path: Path) -> None:
    scene, out = place / "scene.mcap", tmp_path / "span.mcap"
    assert main(["replay", str(scene), "-o", str(out), "--from", "frame:7"]) == 0
    whole = pictures_of(scene)
    piece = pictures_of(out)
    assert list(piece) == list(whole)[7:]
    assert all(np.array_equal(piece[t], whole[t]) for t in piece)
    again = tmp_path / "again.mcap"
    assert main(["replay", str(out), "-o", str(again)]) == 0


def test_topics_that_the_digests_need_are_missed(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "few.mcap"
    words = ["--topics", "/camera/tracks,/camera/events"]
    assert main(["filter", str(place / "annotated.mcap"), "-o", str(out), *words]) == 0
    assert "digests are taken out" in capsys.readouterr().err
    with LogReader(out) as log:
        assert log.topics() == ["/camera/events", "/camera/tracks"]
    with AnnotatedLog(out) as opened:
        assert opened.tracker == "events"
        assert opened.size() == (128, 96)
        assert len(list(opened.frames(("tracks",)))) == FRAMES
    assert main(["verify", str(out)]) == 1
    assert "not an annotated log" in capsys.readouterr().err


def test_merge_sorts_and_keeps_both(tmp_path: Path) -> None:
    schema = Schema("s", "jsonschema", b'{"type":"object"}')
    for name, times in (("a", (5, 1, 9)), ("b", (1, 7))):
        with LogWriter(tmp_path / f"{name}.mcap") as log:
            channel = log.channel("/x", schema, "json", {})
            for t in times:
                log.write(channel, f'"{name}{t}"'.encode(), t)
            log.attach(f"{name}.txt", "text/plain", b"")
            log.metadata(name, {"k": name})
    out = tmp_path / "both.mcap"
    report = merge([tmp_path / "a.mcap", tmp_path / "b.mcap"], out)
    assert (report.messages, report.notes) == (5, [])
    with LogReader(out) as log:
        stored = [m.data.decode().strip('"') for m in log.stored()]
        assert stored == ["a1", "b1", "a5", "b7", "a9"]
        assert len(log.channels) == 1
        assert [a.name for a in log.attachments()] == ["a.txt", "b.txt"]
        assert [name for name, _ in log.metadata()] == ["a", "b"]


def test_latched_topics_of_ros_and_calibrations_are_carried(tmp_path: Path) -> None:
    log_path, out = tmp_path / "bag.mcap", tmp_path / "cut.mcap"
    with LogWriter(log_path) as log:
        plain = Schema("std_msgs/msg/String", "ros2msg", b"string data")
        info = Schema("sensor_msgs/msg/CameraInfo", "ros2msg", b"")
        quality = {"offered_qos_profiles": "- durability: 1\n  depth: 1"}
        ids = {
            "/map": log.channel("/map", plain, "cdr", quality),
            "/chat": log.channel("/chat", plain, "cdr", {}),
            "/tf_static": log.channel("/tf_static", plain, "cdr", {}),
            "/info": log.channel("/info", info, "cdr", {}),
        }
        for t in (1, 2):
            for topic, channel in ids.items():
                log.write(channel, f"{topic}{t}".encode(), t)
        log.write(ids["/chat"], b"in", 10)
    assert cut(log_path, out, Span(5, 20)).carried == 4
    with LogReader(out) as log:
        said = [m.data.decode() for m in log.messages()]
    assert said == ["/tf_static1", "/map2", "/tf_static2", "/info2", "in"]


def test_sort_keeps_the_digests(place: Path, tmp_path: Path) -> None:
    out = tmp_path / "sorted.mcap"
    assert main(["sort", str(place / "annotated.mcap"), "-o", str(out)]) == 0
    assert main(["verify", str(out)]) == 0


def test_regions_at_the_replay_need_no_new_recording(place: Path, tmp_path: Path) -> None:
    regions = tmp_path / "other.json"
    gate = {"gate": [[30, 10], [100, 10], [100, 90], [30, 90]]}
    regions.write_text(json.dumps({**REGIONS, "zones": gate}))
    scene, out = place / "scene.mcap", tmp_path / "zoned.mcap"
    words = ["replay", str(scene), "-o", str(out), "--regions", str(regions)]
    assert main(words) == 0
    with AnnotatedLog(out) as log:
        zones = {
            e.evidence["zone"]
            for f in log.frames()
            for e in f.events
            if e.kind == "zone_entered"
        }
    assert zones == {"gate"}
    assert main(["verify", str(out)]) == 0
    # From another place the same: the recording is the old one, the regions are the log's own.
    assert main([*words, "--annotations-only", "--force"]) == 0
    assert main(["verify", str(out), "--scene", str(scene)]) == 0


def test_nothing_in_the_span_leaves_nothing(place: Path, tmp_path: Path) -> None:
    out = tmp_path / "none.mcap"
    with pytest.raises(UsageError, match="in this span"):
        cut(place / "scene.mcap", out, Span(10**15))
    with pytest.raises(UsageError, match="none of its topics"):
        cut(place / "scene.mcap", out, Span(topics=["/lidar"]))
    assert list(tmp_path.iterdir()) == []
