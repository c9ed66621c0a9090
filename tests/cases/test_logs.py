"""Logs after public reports: read, replayed, recorded, or named for what they are."""

from __future__ import annotations

from pathlib import Path

import duckdb
import pytest

from recorders.log import LogReader
from recorders.scene import SceneLog
from replay.cli import main
from tests.cases.conftest import Case

SOUND = [
    "base", "bursts_long", "channel_repeated", "detections_every_third", "detections_only",
    "dup_metadata", "empty_channel", "gray_jpeg", "header_stamp", "image_other_stamp", "json_image",
    "mixed_chunking", "minimal_json", "no_message_index", "out_of_order", "publish_vs_log",
    "qos_metadata", "schemaless", "sim_time_zero", "stats_swapped", "topic_after_topic",
    "two_channels", "unchunked", "unicode_topics", "zero_payload", "zstd_no_size",
]  # fmt: skip


def tables(log: Path, sql: str, tmp_path: Path) -> list[tuple[object, ...]]:
    out = tmp_path / "answer.parquet"
    assert (
        main(["query", str(log), sql, "--format", "parquet", "-o", str(out), "--force"])
        == 0
    )
    return duckdb.sql(f"SELECT * FROM '{out}'").fetchall()


def replayed(log: Path, tmp_path: Path, code: int = 0, *more: str) -> Path:
    out = tmp_path / "annotated.mcap"
    words = ["replay", str(log), "-o", str(out), "--tracker", "events", "--force", *more]
    assert main(words) == code
    return out


def recorded(log: Path, tmp_path: Path, code: int = 0, *more: str) -> Path:
    out = tmp_path / "scene.mcap"
    assert main(["record", str(log), "-o", str(out), "--force", *more]) == code
    return out


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_log_is_replayed(case: Case, tmp_path: Path, name: str) -> None:
    words = ("400", "1000") if name == "bursts_long" else ()
    with SceneLog(replayed(case(f"mcap/{name}", *words), tmp_path)) as scene:
        count = sum(1 for _ in scene.frames())
    assert count == {"bursts_long": 400, "detections_every_third": 20}.get(name, 60)


@pytest.mark.parametrize("name", ["json_image", "header_stamp", "ros2_detection2darray"])
def test_a_log_of_others_is_recorded_as_the_plain_one(
    case: Case, tmp_path: Path, name: str
) -> None:
    with (
        SceneLog(recorded(case(f"mcap/{name}"), tmp_path)) as scene,
        SceneLog(case("mcap/base")) as plain,
    ):
        for frame, wanted in zip(scene.frames(), plain.frames(), strict=True):
            assert frame.detections.boxes == wanted.detections.boxes
            assert frame.detections.labels == wanted.detections.labels
            assert frame.image is not None
            assert wanted.image is not None
            assert (frame.image == wanted.image).all()


def test_pictures_of_another_time_are_paired_and_drawings_bear_their_stamp(
    case: Case, tmp_path: Path
) -> None:
    from foxglove_schemas_protobuf.CompressedImage_pb2 import CompressedImage
    from foxglove_schemas_protobuf.ImageAnnotations_pb2 import ImageAnnotations

    log = replayed(case("mcap/image_other_stamp"), tmp_path)
    with SceneLog(log) as scene:
        assert all(frame.image is not None for frame in scene.frames())
    with LogReader(log) as reader:
        stamps = [
            CompressedImage.FromString(m.data).timestamp.ToNanoseconds()
            for m in reader.messages(["/camera/image"])
        ]
        drawn = [
            ImageAnnotations.FromString(m.data).timestamp.ToNanoseconds()
            for m in reader.messages(["/camera/annotations"])
        ]
    assert drawn == stamps


def test_a_clock_that_was_set_back_is_told_and_can_be_followed(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/clock_back")
    replayed(log, tmp_path, 1)
    assert "the recorder's clock was set back" in capsys.readouterr().err
    out = tmp_path / "interleaved.mcap"
    assert main(["record", str(log), "-o", str(out)]) == 1
    assert "--time file follows the file's order" in capsys.readouterr().err
    assert not out.exists()
    scene = recorded(log, tmp_path, 0, "--time", "file")
    assert "the clock was set back 1 time" in capsys.readouterr().err
    annotated = replayed(scene, tmp_path)
    sql = "SELECT count(DISTINCT track), (SELECT count(*) FROM events) FROM tracks"
    assert tables(annotated, sql, tmp_path) == [(2, 11)]


@pytest.mark.parametrize(
    ("seconds", "after"), [("5000000", "10"), ("1750000000", "1"), ("100", "30")]
)
@pytest.mark.parametrize("tracker", ["events", "shells", "parts"])
def test_a_jump_of_the_clock_parts_the_recording(
    case: Case,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    seconds: str,
    after: str,
    tracker: str,
) -> None:
    out = tmp_path / "annotated.mcap"
    log = case("mcap/clock_jump", seconds, after)
    assert main(["replay", str(log), "-o", str(out), "--tracker", tracker]) == 0
    said = capsys.readouterr().err
    assert f"a gap of {seconds} s" in said
    assert f"before frame {after}: nothing was recorded then" in said
    sql = "SELECT count(*) FILTER (NOT isfinite(x + y + w + h + vx + vy)) FROM tracks"
    assert tables(out, sql, tmp_path) == [(0,)]
    spanning = f"""SELECT count(*) FROM (SELECT track FROM tracks GROUP BY track
                   HAVING min(frame) < {after} AND max(frame) >= {after})"""
    if int(after) > 1:  # what was seen once is no track yet that could end
        assert tables(out, spanning, tmp_path) == [(0,)]


def test_bursts_of_log_times_take_no_memory(case: Case, tmp_path: Path) -> None:
    import tracemalloc

    log = replayed(case("mcap/bursts_long", "400", "1000"), tmp_path)
    tracemalloc.start()
    try:
        tables(log, "SELECT count(*) FROM encounters", tmp_path)
        assert tracemalloc.get_traced_memory()[1] < 200 << 20
    finally:
        tracemalloc.stop()


def test_one_bad_picture_is_left_out_and_named(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/truncated_jpeg")
    for make in (recorded, replayed):
        make(log, tmp_path, 3)
        said = capsys.readouterr().err
        assert "a jpeg picture that is cut off, at 1750000000400000000 ns on" in said
    report = tmp_path / "report.html"
    annotated = tmp_path / "annotated.mcap"
    assert main(["report", str(annotated), "-o", str(report)]) in (0, 3)


@pytest.mark.parametrize(
    ("codec", "missing"), [("libx264", 20), ("libx265", 20), ("libvpx-vp9", 20)]
)
def test_a_video_before_its_first_key_frame_is_left_out(
    case: Case,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    codec: str,
    missing: int,
) -> None:
    log = case("mcap/video_p_first", codec, "5", "25")
    scene = recorded(log, tmp_path, 3)
    name = {"libx264": "h264", "libx265": "hevc", "libvpx-vp9": "vp9"}[codec]
    assert (
        f"a packet of {name} without a whole key frame before it" in capsys.readouterr().err
    )
    with SceneLog(scene) as found:
        without = [f.index for f in found.frames() if f.image is None]
    assert without == list(range(missing))
    with SceneLog(log) as direct:
        assert sum(f.image is not None for f in direct.frames()) == 55 - missing


def test_several_cameras_are_listed_and_any_can_be_chosen(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/multi_camera")
    recorded(log, tmp_path, 2)
    said = capsys.readouterr().err
    assert "4 topics of pictures; choose one with --image-topic" in said
    assert "/robot/cam/image  foxglove.CompressedImage (protobuf), 320x240 jpeg, 60" in said
    for camera in ("front", "rear left", "robot/cam", "Kamera_süd"):
        replayed(log, tmp_path, 0, "--camera", camera)
    both = ("--camera", "front=/front/image", "--camera", "rear=/rear left/image")
    scene = recorded(log, tmp_path, 0, *both)
    for camera in ("front", "rear"):
        with SceneLog(scene, camera) as found:
            assert sum(len(f.detections.boxes) for f in found.frames()) == 120


def test_everything_else_passes_through_byte_for_byte(case: Case, tmp_path: Path) -> None:
    log = case("mcap/qos_metadata")
    with LogReader(log) as before, LogReader(recorded(log, tmp_path)) as after:
        wanted = list(before.messages(["/map"]))
        found = list(after.messages(["/map"]))
        assert [(m.data, m.log_time_ns, m.publish_time_ns, m.sequence) for m in found] == [
            (m.data, m.log_time_ns, m.publish_time_ns, m.sequence) for m in wanted
        ]
        assert found[0].channel.metadata == wanted[0].channel.metadata
        assert found[0].channel.schema == wanted[0].channel.schema
        assert "intrinsics.yaml" in {a.name for a in after.attachments()}
    without = recorded(log, tmp_path, 0, "--exclude", "/ma*")
    with LogReader(without) as after:
        assert "/map" not in after.topics()


def test_negative_times_are_said_and_left_out(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/time_rollover")
    replayed(log, tmp_path, 1)
    assert "as a signed number this is -80000000 ns" in capsys.readouterr().err
    with SceneLog(recorded(log, tmp_path, 3)) as scene:
        assert sum(1 for _ in scene.frames()) == 58


def test_joined_logs_are_recovered_whole(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/concatenated")
    assert main(["doctor", str(log)]) == 1
    assert "another log begins here" in capsys.readouterr().out
    out = tmp_path / "whole.mcap"
    assert main(["recover", str(log), "-o", str(out)]) == 0
    assert "120 of 120 messages" in capsys.readouterr().out
    with SceneLog(out) as scene:
        assert sum(1 for _ in scene.frames()) == 60


def test_a_redefined_channel_keeps_its_messages_apart(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "apart.mcap"
    assert main(["recover", str(case("mcap/channel_redefined")), "-o", str(out)]) == 0
    assert "channel 2 means /b from here on, /a before" in capsys.readouterr().err
    with LogReader(out) as log:
        assert [len(list(log.messages([t]))) for t in ("/a", "/b")] == [31, 29]


def test_a_sound_chunk_over_the_limit_is_told_from_damage(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/huge_chunk")
    assert main(["doctor", str(log)]) == 0
    assert "not damaged, but larger than what is read by default" in capsys.readouterr().out
    out = tmp_path / "a.mcap"
    assert main(["recover", str(log), "-o", str(out)]) == 1
    assert "--limit max_chunk_bytes=314589228 allows it" in capsys.readouterr().err
    assert not out.exists()
    limit = ("--limit", "max_chunk_bytes=400000000")
    replayed(log, tmp_path, 0, "--annotations-only", *limit)
    assert main(["info", str(log), "--limit", "max_chunk=5"]) == 2
    assert "did you mean max_chunk_bytes?" in capsys.readouterr().err


def test_many_messages_at_one_time(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/many_at_once")
    replayed(log, tmp_path, 1)
    assert "--limit max_messages_per_frame=100000 allows more" in capsys.readouterr().err
    replayed(log, tmp_path, 0, "--limit", "max_messages_per_frame=100000")


def test_one_error_for_one_damage(case: Case, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", str(case("mcap/corrupt_zstd_mid"))]) == 1
    errors = [x for x in capsys.readouterr().out.splitlines() if x.startswith("error")]
    assert len(errors) == 1


def test_statistics_are_never_believed(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/stats_swapped")
    assert main(["info", str(log)]) == 0
    assert "messages  120 over 2.360 s" in capsys.readouterr().out
    replayed(log, tmp_path, 0, "--from", "1")


def test_topics_that_nobody_can_read_leave_the_others_readable(
    case: Case, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(case("mcap/unicode_topics"))]) == 0
    lines = capsys.readouterr().out.splitlines()
    channels = [x for x in lines if x.startswith("  /") or x.startswith('  ""')]
    assert max(map(len, channels)) <= 80
    assert any(
        "/camera/detections " in x and "scenetrace.Detections" in x for x in channels
    )


def test_frames_of_another_unit_of_time_are_told(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/ns_apart")
    replayed(log, tmp_path)
    assert "frames are 100 ns apart, as no camera takes them" in capsys.readouterr().err
    scene = recorded(log, tmp_path, 0, "--fps", "25")
    replayed(scene, tmp_path)
    assert "2 tracks" in capsys.readouterr().err


def test_detections_without_a_schema_are_recorded(case: Case, tmp_path: Path) -> None:
    with SceneLog(recorded(case("mcap/schemaless"), tmp_path)) as scene:
        assert sum(len(f.detections.boxes) for f in scene.frames()) == 120
    with LogReader(tmp_path / "scene.mcap") as log:
        assert len(list(log.messages(["/notes"]))) == 6


def test_messages_compressed_one_by_one_are_recorded(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    replayed(case("mcap/message_compressed"), tmp_path, 1)
    assert "compressed by itself (zstd), as ROS 2's compression mode" in (
        capsys.readouterr().err
    )
    with SceneLog(recorded(case("mcap/message_compressed"), tmp_path)) as scene:
        assert sum(len(f.detections.boxes) for f in scene.frames()) == 120


def test_a_compressed_file_and_a_folder_of_splits_are_recorded(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import zstandard

    folder = tmp_path / "bag"
    folder.mkdir()
    data = case("mcap/base").read_bytes()
    packed = folder / "bag_0.mcap.zstd"
    packed.write_bytes(zstandard.compress(data))
    assert main(["info", str(packed)]) == 1
    assert "compressed as a whole with zstd" in capsys.readouterr().err
    assert main(["info", str(folder)]) == 1
    assert "`scenetrace record` reads the folder of a bag" in capsys.readouterr().err
    for source in (packed, folder):
        with SceneLog(recorded(source, tmp_path)) as scene:
            assert sum(f.image is not None for f in scene.frames()) == 60


@pytest.mark.parametrize(
    ("name", "messages"),
    [
        ("killed_no_summary", 119),
        ("trunc_in_chunk_index", 120),
        ("trunc_mid_chunk", 63),
        ("memoryerror_trunc", 19),
        ("zero_tail", 71),
        ("never_flushed", 0),
    ],
)
def test_what_is_whole_is_recovered(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, messages: int
) -> None:
    out = tmp_path / "whole.mcap"
    assert main(["recover", str(case(f"mcap/{name}")), "-o", str(out)]) == 3
    assert f"{messages} messages" in capsys.readouterr().out


def test_one_time_for_all_is_refused_and_a_rate_helps(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = case("mcap/equal_stamps")
    recorded(log, tmp_path, 2)
    assert "all frames have one time by the clock 'log'" in capsys.readouterr().err


@pytest.mark.parametrize(("kind", "frames"), [("normal", 60), ("unused", 60)])
def test_logs_of_another_writer(case: Case, tmp_path: Path, kind: str, frames: int) -> None:
    pytest.importorskip("foxglove")
    with SceneLog(replayed(case("mcap/fg_sdk", kind), tmp_path)) as scene:
        found = list(scene.frames())
        assert len(found) == frames
        assert all(frame.image is not None for frame in found)


def test_a_log_of_another_writer_without_frames_is_named(
    case: Case, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("foxglove")
    words = ["replay", str(case("mcap/fg_sdk", "empty")), "-o", str(tmp_path / "o.mcap")]
    assert main(words) == 1
    assert "no detections to replay" in capsys.readouterr().err


def test_chunks_that_all_overlap_are_read_in_linear_time(
    case: Case, tmp_path: Path
) -> None:
    import time

    spent = []
    for count in ("60", "240"):
        log = case("mcap/overlap_all", count)
        began = time.process_time()
        replayed(
            log, tmp_path, 0, "--annotations-only", "--limit", "max_open_bytes=30000000"
        )
        spent.append(time.process_time() - began)
    assert spent[1] < 8 * spent[0] + 1
