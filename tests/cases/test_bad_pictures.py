"""One bad picture in a log, or in a folder: the rest is done, and what was left out is named."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from recorders.pictures import encode_jpeg
from recorders.scene import SceneLog
from replay.cli import main
from tests.cases.conftest import Case

BAD = 30


def garbled(data: bytes) -> bytes:
    changed = bytearray(data)
    for k in range(700, len(changed) - 2, 37):
        changed[k] ^= 0x5A
    return bytes(changed)


def smaller(data: bytes) -> bytes:
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return encode_jpeg(np.asarray(cv2.resize(picture, (160, 120)), np.uint8))


def rewritten(base: Path, out: Path, change: Callable[[str, int, bytes], bytes]) -> None:
    """The log again, each payload as ``change`` gives it for topic, number in it and payload."""
    with base.open("rb") as old, out.open("wb") as new:
        writer = Writer(new)
        writer.start()
        ids: dict[str, int] = {}
        counts: Counter[str] = Counter()
        for schema, channel, message in make_reader(old).iter_messages():
            assert schema is not None
            topic = channel.topic
            if topic not in ids:
                kept = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[topic] = writer.register_channel(topic, channel.message_encoding, kept)
            data = change(topic, counts[topic], message.data)
            writer.add_message(ids[topic], message.log_time, data, message.publish_time)
            counts[topic] += 1
        writer.finish()


def with_bad_picture(base: Path, out: Path, spoil: Callable[[bytes], bytes]) -> Path:
    """The log again, one of its pictures spoilt."""
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage

    def spoilt(topic: str, count: int, data: bytes) -> bytes:
        if topic != "/camera/image" or count != BAD:
            return data
        picture = CompressedImage.FromString(data)
        picture.data = spoil(picture.data)
        return picture.SerializeToString()

    rewritten(base, out, spoilt)
    return out


@pytest.mark.parametrize(
    ("spoil", "told"),
    [
        pytest.param(
            garbled, "a damaged jpeg picture: premature end of data segment", id="garbled"
        ),
        pytest.param(
            smaller,
            "a picture of 160x120, the detections say 320x240",
            id="of another size",
            marks=pytest.mark.long,
        ),
        pytest.param(
            lambda _: b"", "a picture of 0 bytes", id="empty", marks=pytest.mark.long
        ),
    ],
)
def test_every_command_does_the_rest(
    case: Case,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    spoil: Callable[[bytes], bytes],
    told: str,
) -> None:
    log = with_bad_picture(case("mcap/base"), tmp_path / "log.mcap", spoil)
    annotated = str(tmp_path / "annotated.mcap")
    for words in (
        ["replay", str(log), "-o", annotated, "--tracker", "events"],
        ["export", annotated, "--to", "video", "-o", str(tmp_path / "film.mp4")],
        ["export", annotated, "--to", "clips", "-o", str(tmp_path / "clips")],
        ["report", annotated, "-o", str(tmp_path / "report.html")],
        ["evidence", annotated, "--events", "5", "-o", str(tmp_path / "evidence")],
    ):
        assert main(words) == 3, words
        lines = capfd.readouterr().err.splitlines()
        named = [line for line in lines if line.startswith("scenetrace: left out: ")]
        assert len(named) == 1
        assert told in named[0]
        assert f"at 1750000001200000000 ns on /camera/image (frame {BAD})" in named[0]
        assert not any("Corrupt JPEG" in line for line in lines)


def test_a_garbled_picture_of_a_folder_is_left_out_without_the_decoders_words(
    case: Case, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = case("video/f_folder", "garbled")
    out = tmp_path / "scene.mcap"
    assert main(["record", str(folder), "--fps", "25", "-o", str(out)]) == 3
    said = capfd.readouterr().err
    assert "left out: a damaged jpeg picture" in said
    assert "at 000030.jpg" in said
    assert "Corrupt JPEG" not in said


def test_padding_harms_no_picture_and_others_words_are_passed_on(
    capfd: pytest.CaptureFixture[str],
) -> None:
    from recorders.decoder_words import decoded_in_silence
    from recorders.pictures import decode_picture

    plain = encode_jpeg(np.full((30, 40, 3), 90, np.uint8))
    padded = plain[:-2] + b"\x11" * 20 + plain[-2:]
    assert (decode_picture(padded) == decode_picture(plain)).all()
    assert capfd.readouterr().err == ""

    def speak() -> int:
        os.write(2, b"somebody else\nCorrupt JPEG data: bad Huffman code\n")
        return 1

    assert decoded_in_silence(speak) == (1, "bad Huffman code")
    assert capfd.readouterr().err == "somebody else\n"


def test_nan_in_a_logs_json_costs_its_box_alone(
    case: Case, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    log, out = tmp_path / "log.mcap", tmp_path / "scene.mcap"

    def spoilt(topic: str, count: int, data: bytes) -> bytes:
        if topic == "/camera/detections" and count == BAD:
            return data.replace(b"0.9", b"NaN", 1)
        return data

    rewritten(case("mcap/base"), log, spoilt)
    assert main(["record", str(log), "-o", str(out)]) == 3
    assert "left out: a box without width or height, or not finite" in (
        capfd.readouterr().err
    )
    with SceneLog(out) as scene:
        counts = [len(frame.detections.boxes) for frame in scene.frames()]
    assert counts == [2] * BAD + [1] + [2] * (60 - BAD - 1)


def test_a_frame_without_a_picture_is_named_by_what_shows_it(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    base, missing = case("mcap/base"), tmp_path / "missing.mcap"
    with base.open("rb") as old, missing.open("wb") as new:
        writer = Writer(new)
        writer.start()
        ids: dict[str, int] = {}
        for schema, channel, message in make_reader(old).iter_messages():
            assert schema is not None
            if channel.topic not in ids:
                kept = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, kept
                )
            if not (channel.topic.endswith("image") and message.sequence == 7):
                time = message.log_time
                writer.add_message(ids[channel.topic], time, message.data, time)
        writer.finish()
    annotated = tmp_path / "a.mcap"
    assert main(["replay", str(missing), "-o", str(annotated)]) == 0
    video = tmp_path / "a.mp4"
    words = ["export", str(annotated), "--to", "video", "--until", "1", "-o", str(video)]
    assert main(words) == 3
    said = capsys.readouterr().err
    assert "no picture of a frame is in the log, at 1750000000280000000 ns" in said
    assert "(frame 7)" in said
