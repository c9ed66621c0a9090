"""The main job on real recordings, through the command line: record, replay, verify, ask, export,
score.
"""

from __future__ import annotations

import csv
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import av
import pytest

from recorders.log import LogReader
from recorders.scene import SceneLog
from replay.cli import main

pytestmark = pytest.mark.real

# Floors a little under what was measured (HOTA, MOTA, IDF1 in percent; most switches).
PETS_FROM_PIXELS = (60.0, 80.0, 80.0, 15)
PETS_FROM_DETECTIONS = (42.0, 66.0, 58.0, 60)
CAVIAR = (
    "Browse1", "Browse_WhileWaiting1", "Fight_OneManDown1", "Fight_RunAway1", "LeftBag", "LeftBag_PickedUp",
    "Meet_Crowd", "Meet_WalkSplit", "Meet_WalkTogether1", "Rest_WiggleOnFloor", "Walk1", "Walk3",
)  # fmt: skip
BAGS = (
    "cdr_test_0", "multiple_files_0", "only_topics", "talker", "test_bag_for_seek_0", "topics_and_services", "wbag_0",
)  # fmt: skip
PROGRAM = """
import sys
from recorders.vision import cv2
cv2.setNumThreads(int(sys.argv[1]))
from replay.cli import main
for words in (["record", sys.argv[2], "--fps", "7", "-o", "scene.mcap"],
              ["replay", "scene.mcap", "-o", "annotated.mcap", "--tracker", sys.argv[3]]):
    if main(words):
        sys.exit(1)
"""


def done(*words: object, code: int = 0) -> None:
    """A command that has to end with a code."""
    assert main([str(w) for w in words]) == code, words


def answer(capsys: pytest.CaptureFixture[str], *words: object) -> object:
    """A command's answer as JSON."""
    capsys.readouterr()
    done(*words, "--json")
    return json.loads(capsys.readouterr().out)


def floors(scores: object) -> tuple[float, float, float, float]:
    """HOTA, MOTA, IDF1 and switches of `eval --json`."""
    assert isinstance(scores, dict)
    return scores["HOTA"], scores["MOTA"], scores["IDF1"], scores["switches"]


def cut(video: Path, out: Path, frames: int) -> Path:
    """The first packets of a video as they are, in a file of its own."""
    with av.open(str(video)) as source, av.open(str(out), "w") as target:
        stream = source.streams.video[0]
        copy = target.add_stream_from_template(stream)
        for k, packet in enumerate(source.demux(stream)):
            if packet.dts is None or k >= frames:
                break
            packet.stream = copy
            target.mux(packet)
    return out


def frame_count(log: Path) -> int:
    with SceneLog(log) as scene:
        return sum(1 for _ in scene.frame_times())


def test_pets_is_replayed_again_to_the_same_digest(
    pets: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = answer(capsys, "verify", pets / "annotated.mcap")
    assert isinstance(found, dict)
    assert found["identical"]
    assert found["frames"] == 795


def test_pets_is_scored_once_the_size_of_the_truth_is_said(
    pets: Path, real_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [
        "eval",
        str(pets / "annotated.mcap"),
        "--truth",
        str(real_data / "pets09-s2l1" / "gt.txt"),
    ]
    assert main(words) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert (
        said.err
        == "scenetrace: error: the truth reaches to (766, 577) but the recording is"
        " 480x360: say the size of the picture that the truth was labelled in with"
        " --truth-size WxH\n"
    )
    scores = answer(capsys, *words, "--truth-size", "768x576")
    hota, mota, idf1, switches = floors(scores)
    assert hota >= PETS_FROM_PIXELS[0]
    assert mota >= PETS_FROM_PIXELS[1]
    assert idf1 >= PETS_FROM_PIXELS[2]
    assert switches <= PETS_FROM_PIXELS[3]


def test_pets_is_exported_for_others(
    pets: Path, real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    result = tmp_path / "result.txt"
    done("export", pets / "annotated.mcap", "--to", "mot", "-o", result)
    rows = [line.split(",") for line in result.read_text().splitlines()]
    assert {len(row) for row in rows} == {10}
    frames = [int(row[0]) for row in rows]
    assert frames == sorted(frames)
    assert frames[0] >= 1
    assert frames[-1] <= 795
    assert len({(row[0], row[1]) for row in rows}) == len(rows), "an id twice in a frame"
    centres = [(float(r[2]) + float(r[4]) / 2, float(r[3]) + float(r[5]) / 2) for r in rows]
    inside = sum(0 <= x <= 480 and 0 <= y <= 360 for x, y in centres)
    assert inside > 0.99 * len(rows), (
        "only who is just leaving has a centre beyond the picture"
    )
    truth = ("--truth", real_data / "pets09-s2l1" / "gt.txt", "--truth-size", "768x576")
    of_log = answer(capsys, "eval", pets / "annotated.mcap", *truth)
    of_text = answer(capsys, "eval", result, *truth, "--size", "480x360")
    assert floors(of_text) == pytest.approx(floors(of_log), abs=0.1)


def test_pets_answers_questions(pets: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = pets / "annotated.mcap"
    frames = answer(
        capsys, "query", log, "SELECT count(*) AS n, max(t) AS last FROM frames"
    )
    assert frames == [{"n": 795, "last": pytest.approx(794 / 7, abs=0.01)}]
    events = answer(
        capsys, "query", log, "SELECT kind, count(*) AS n FROM events GROUP BY kind"
    )
    assert isinstance(events, list)
    found = {row["kind"]: row["n"] for row in events}
    assert found["entered"] >= 10
    assert found["grouped"] >= 5
    assert found["group_formed"] >= 5
    pairs = answer(
        capsys,
        "query",
        log,
        "SELECT DISTINCT a, b FROM relations WHERE state = 'JOINT' AND a < b",
    )
    assert isinstance(pairs, list)
    assert len(pairs) >= 5
    met = answer(capsys, "query", log, "--ask", "met", pairs[0]["a"])
    assert isinstance(met, list)
    assert met


def test_pets_from_detections_alone(
    real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = real_data / "pets09-s2l1"
    done(
        "record",
        source / "det.txt",
        "--fps",
        7,
        "--size",
        "768x576",
        "-o",
        tmp_path / "det.mcap",
    )
    done("replay", tmp_path / "det.mcap", "-o", tmp_path / "annotated.mcap")
    scores = answer(
        capsys, "eval", tmp_path / "annotated.mcap", "--truth", source / "gt.txt"
    )
    hota, mota, idf1, switches = floors(scores)
    assert hota >= PETS_FROM_DETECTIONS[0]
    assert mota >= PETS_FROM_DETECTIONS[1]
    assert idf1 >= PETS_FROM_DETECTIONS[2]
    assert switches <= PETS_FROM_DETECTIONS[3]


def test_pictures_pass_through_byte_for_byte(real_data: Path, tmp_path: Path) -> None:
    source, folder = real_data / "pets09-s2l1", tmp_path / "img1"
    folder.mkdir()
    for k in range(1, 31):
        shutil.copy(source / "img1" / f"{k:06d}.jpg", folder)
    det = ("--detections", source / "det.txt")
    done("record", folder, "--fps", 7, "-o", tmp_path / "plain.mcap")
    done(
        "record", folder, "--fps", 7, *det, "-o", tmp_path / "with.mcap", code=3
    )  # detections go on after them
    for name in ("plain", "with"):
        scene, annotated = tmp_path / f"{name}.mcap", tmp_path / f"{name}-annotated.mcap"
        done("replay", scene, "-o", annotated)
        done("verify", annotated)
        with LogReader(annotated) as log:
            pictures = [m.data for m in log.messages(["/camera/image"])]
        assert len(pictures) == 30
        for k, payload in enumerate(pictures):
            assert (folder / f"{k + 1:06d}.jpg").read_bytes() in payload


@pytest.mark.parametrize("name", CAVIAR)
def test_every_caviar_file_is_recorded_without_its_identities(
    real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    source = real_data / "caviar" / f"{name}.xml"
    done("record", source, "-o", tmp_path / "scene.mcap")
    with LogReader(tmp_path / "scene.mcap") as log:
        assert not any(b'"id"' in m.data for m in log.messages(["/camera/detections"]))
    done("doctor", tmp_path / "scene.mcap")
    done(
        "replay",
        tmp_path / "scene.mcap",
        "-o",
        tmp_path / "annotated.mcap",
        "--annotations-only",
    )
    scores = answer(capsys, "eval", tmp_path / "annotated.mcap", "--truth", source)
    assert floors(scores)[1] >= 60  # LeftBag_PickedUp is the lowest


@pytest.mark.parametrize("name", ["OneLeaveShopReenter1cor", "EnterExitCrossingPaths1cor"])
def test_the_corridor_videos(
    real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    video = cut(real_data / "caviar-corridor" / f"{name}.mpg", tmp_path / "cut.mpg", 150)
    done("record", video, "-o", tmp_path / "scene.mcap")
    assert 140 <= frame_count(tmp_path / "scene.mcap") <= 150
    done("replay", tmp_path / "scene.mcap", "-o", tmp_path / "annotated.mcap")
    done("verify", tmp_path / "annotated.mcap", "--quick")
    tracks = answer(
        capsys, "query", tmp_path / "annotated.mcap", "SELECT DISTINCT track FROM tracks"
    )
    assert isinstance(tracks, list)
    assert 1 <= len(tracks) <= 20


@pytest.mark.parametrize(("name", "animals"), [("two_flies", 2), ("three_flies", 3)])
def test_the_flies_keep_their_identities(
    real_data: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    animals: int,
) -> None:
    flies = real_data / "flies"
    done(
        "record",
        flies / f"{name}.mp4",
        "--detect",
        "threshold",
        "-o",
        tmp_path / "scene.mcap",
    )
    assert frame_count(tmp_path / "scene.mcap") == 128
    done(
        "replay",
        tmp_path / "scene.mcap",
        "--tracker",
        "shells",
        "-o",
        tmp_path / "annotated.mcap",
    )
    truth = flies / f"{name}.gt.txt"
    _, _, idf1, switches = floors(
        answer(capsys, "eval", tmp_path / "annotated.mcap", "--truth", truth)
    )
    assert switches == 0
    assert idf1 >= 90
    tracks = answer(
        capsys, "query", tmp_path / "annotated.mcap", "SELECT DISTINCT track FROM tracks"
    )
    assert isinstance(tracks, list)
    assert len(tracks) == animals


@pytest.mark.parametrize("name", BAGS)
def test_bags_of_others_are_read_whole_and_replay_says_what_they_lack(
    real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    bag = real_data / "mcap-recordings" / f"{name}.mcap"
    info = answer(capsys, "info", bag)
    assert isinstance(info, dict)
    with LogReader(bag) as log:
        counts: dict[str, int] = {}
        for message in log.messages():
            counts[message.topic] = counts.get(message.topic, 0) + 1
    assert {
        c["topic"]: c["messages"] or 0 for c in info["channels"] if c["messages"]
    } == counts
    capsys.readouterr()
    done("doctor", bag)
    assert not [
        line for line in capsys.readouterr().out.splitlines() if line.startswith("error")
    ]
    assert main(["replay", str(bag), "-o", str(tmp_path / "a.mcap")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(
        f"scenetrace: error: {bag}: no detections to replay (a channel"
        " /<camera>/detections in JSON); "
    )
    assert f"it holds {info['channels'][0]['topic']}" in line
    assert line.endswith("with `scenetrace record SOURCE -o scene.mcap`")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(sys.platform != "linux", reason="the names of OpenBLAS kernels")
def test_processes_with_other_hash_seeds_threads_and_kernels_write_the_same(
    real_data: Path, tmp_path: Path
) -> None:
    video = cut(real_data / "pets09-s2l1" / "video.avi", tmp_path / "cut.avi", 60)
    running = []
    for k, (seed, threads, kernel) in enumerate(
        (("1", "1", "Haswell"), ("4242", "3", "Prescott"))
    ):
        folder = tmp_path / str(k)
        folder.mkdir()
        environment = {
            **os.environ, "PYTHONHASHSEED": seed, "OPENBLAS_CORETYPE": kernel, "OPENBLAS_NUM_THREADS": threads,
            "OMP_NUM_THREADS": threads,
        }  # fmt: skip
        words = [sys.executable, "-c", PROGRAM, threads, str(video), "events"]
        running.append(
            subprocess.Popen(words, cwd=folder, env=environment, stderr=subprocess.PIPE)
        )
    for process in running:
        _, said = process.communicate(timeout=300)
        assert process.returncode == 0, said
    for name in ("scene.mcap", "annotated.mcap"):
        first, second = ((tmp_path / k / name).read_bytes() for k in "01")
        assert first == second, name


def test_csv_of_a_real_log_is_csv(pets: Path, tmp_path: Path) -> None:
    out = tmp_path / "tracks.csv"
    done(
        "query",
        pets / "annotated.mcap",
        "SELECT * FROM tracks",
        "--format",
        "csv",
        "-o",
        out,
    )
    with out.open(newline="") as f:
        rows = list(csv.DictReader(f))
    assert len(rows) > 3000
    assert {"frame", "track", "x", "y", "w", "h", "mode"} <= set(rows[0])
