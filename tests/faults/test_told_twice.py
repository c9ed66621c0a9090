"""What stands in a log twice, in two sizes, or under a number that is none: read once, or told."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from recorders.log import LogReader, LogWriter, Message, Schema
from recorders.log.recovery import recover
from tests.faults.small import WORDS, annotated, boxes, run, said

Change = Callable[[Message], list[Message]]
AT_NS = 160_000_000


def changed(path: Path, out: Path, change: Change) -> Path:
    """The log with each message replaced by what `change` makes of it."""
    with LogReader(path) as log, LogWriter(out) as writer:
        ids = {
            c.topic: writer.channel(c.topic, c.schema, c.message_encoding, c.metadata)
            for c in log.channels
        }
        for message in log.messages():
            for m in change(message):
                writer.write(
                    ids[m.topic], m.data, m.log_time_ns, m.publish_time_ns, m.sequence
                )
        for name, values in log.metadata():
            writer.metadata(name, values)
    return out


def scene_log(folder: Path, frames: int = 12) -> Path:
    det, out = boxes(folder / "det.txt", frames), folder / "scene.mcap"
    assert run("record", str(det), "-o", str(out), *WORDS)[0] == 0
    return out


def with_fields(message: Message, **fields: object) -> Message:
    data = msgspec.json.decode(message.data) | fields
    return msgspec.structs.replace(message, data=msgspec.json.encode(data))


def twice(message: Message) -> list[Message]:
    return [message] * (2 if message.log_time_ns == AT_NS else 1)


def test_a_frame_that_was_recorded_twice_is_read_once_and_told(tmp_path: Path) -> None:
    log = changed(scene_log(tmp_path), tmp_path / "twice.mcap", twice)
    code, told = run("record", str(log), "-o", str(tmp_path / "out.mcap"))
    assert code == 0
    assert (
        f"1 message was recorded twice on /camera/detections, the first at {AT_NS}" in told
    )
    assert "12 frames" in told
    code, told = run("replay", str(log), "-o", str(tmp_path / "made.mcap"))
    assert code == 1
    assert f"the frame at {AT_NS} ns was recorded twice" in told
    code, found = said("doctor", str(log))
    assert "1 messages on /camera/detections stand here twice" in found


def test_a_log_of_two_recorders_is_read_once(tmp_path: Path) -> None:
    log = changed(scene_log(tmp_path), tmp_path / "twice.mcap", lambda m: [m, m])
    code, told = run("record", str(log), "-o", str(tmp_path / "out.mcap"))
    assert code == 0
    assert "12 messages were recorded twice" in told
    assert "12 frames of 640x480 over 0.4 s" in told


@pytest.mark.parametrize(("every", "frames"), [(1, 19), (5, 20)])
def test_messages_alike_of_a_coarse_clock_are_frames(
    tmp_path: Path, every: int, frames: int
) -> None:
    path = tmp_path / "foreign.mcap"
    with LogWriter(path) as log:
        schema = Schema("scenetrace.Detections", "jsonschema", b"{}")
        channel = log.channel("/cam/detections", schema, "json")
        for frame in range(20):
            # The last two have one time, which a clock that counts as coarsely always gives.
            log.write(
                channel,
                b'{"boxes": [[10, 20, 30, 40]]}',
                min(frame, 18) // every * every * 40_000_000,
                sequence=0,
            )
    code, told = run("record", str(path), "-o", str(tmp_path / "out.mcap"))
    assert code == 0
    assert f"{frames} frames" in told


@pytest.mark.parametrize("topic", ["tracks", "relations", "groups", "events"])
def test_an_annotation_that_stands_twice_is_told(tmp_path: Path, topic: str) -> None:
    made = annotated(tmp_path)
    log = changed(
        made,
        tmp_path / "twice.mcap",
        lambda m: [m, m] if m.topic == f"/camera/{topic}" else [m],
    )
    code, told = run("query", str(log), "SELECT count(*) FROM events")
    assert code == 1
    assert "two messages for one frame" in told


def test_joined_annotations_are_told_by_export(tmp_path: Path) -> None:
    made = annotated(tmp_path)
    later = changed(
        made,
        tmp_path / "later.mcap",
        lambda m: [msgspec.structs.replace(m, log_time_ns=m.log_time_ns + 10**11)],
    )
    joined = tmp_path / "joined.mcap"
    joined.write_bytes(made.read_bytes() + later.read_bytes())
    recover(joined, tmp_path / "recovered.mcap")
    for words in (["export", "--to", "mot", "-o", str(tmp_path / "o.txt")], ["query"]):
        rest = ["SELECT count(*) FROM tracks"] if words == ["query"] else words[1:]
        code, told = run(words[0], str(tmp_path / "recovered.mcap"), *rest)
        assert code == 1
        assert "frames must rise" in told


def test_detections_of_several_sizes_are_told(tmp_path: Path) -> None:
    log = changed(
        scene_log(tmp_path),
        tmp_path / "sizes.mcap",
        lambda m: [with_fields(m, width=1280, height=960) if m.log_time_ns >= AT_NS else m],
    )
    code, told = run("record", str(log), "-o", str(tmp_path / "out.mcap"))
    assert code == 3
    assert (
        "made for several picture sizes were scaled to 640x480: 8 of 1280x960, the first in"
        " frame 4" in told
    )


def test_detections_made_for_another_size_than_the_pictures_are_told(
    tmp_path: Path,
) -> None:
    import cv2
    import numpy as np

    from recorders import channels

    log = scene_log(tmp_path)
    out = tmp_path / "with-pictures.mcap"
    jpeg = cv2.imencode(".jpg", np.full((240, 320, 3), 90, np.uint8))[1].tobytes()
    with LogReader(log) as opened, LogWriter(out) as writer:
        (one,) = opened.channels
        ids = [
            writer.channel("/camera/image", channels.schema("image"), "protobuf"),
            writer.channel(one.topic, one.schema, one.message_encoding),
        ]
        for m in opened.messages():
            picture = channels.compressed_image(jpeg, "jpeg", m.log_time_ns, "camera")
            writer.write(ids[0], picture, m.log_time_ns)
            writer.write(ids[1], m.data, m.log_time_ns)
    code, told = run("record", str(out), "-o", str(tmp_path / "out.mcap"))
    assert code == 0, told
    assert "the detections are made for 640x480: scaled to 320x240" in told


def test_more_detections_than_the_limit_are_told(tmp_path: Path) -> None:
    log, out = scene_log(tmp_path), str(tmp_path / "out.mcap")
    limit = ("--limit", "max_detections_per_frame=1")
    code, told = run("record", str(log), "-o", out, *limit)
    assert code == 3
    assert "all but the first 1 detections of a frame" in told


@pytest.mark.parametrize("number", [2**63, 2**70])
def test_a_frame_number_beyond_64_bits_is_told_as_such(tmp_path: Path, number: int) -> None:
    def renumbered(m: Message) -> list[Message]:
        text = m.data.replace(b'"frame":4,', b'"frame":%d,' % number)
        return [msgspec.structs.replace(m, data=text)]

    log = changed(scene_log(tmp_path), tmp_path / "big.mcap", renumbered)
    code, told = run("replay", str(log), "-o", str(tmp_path / "made.mcap"))
    assert code == 1
    assert f"the frame at {AT_NS} ns has the number {number}" in told
    assert "clock" not in told
    code, told = run("record", str(log), "-o", str(tmp_path / "out.mcap"))
    assert code == 0
    assert "12 frames" in told
