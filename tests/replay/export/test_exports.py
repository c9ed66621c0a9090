"""Exports of an annotated log, read back by other people's readers."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import duckdb
import pytest

from recorders.annotated.reader import AnnotatedLog
from recorders.errors import OutputExistsError, RecordingError, UsageError
from replay.cli import main
from replay.evaluate import evaluate, read_mot
from replay.evaluate.track_table import read_tracks
from replay.export import write_graphml, write_json, write_mot, write_parquet
from replay.export.mot import format_number

CONTRACT = {
    "frames": ["frame", "t"],
    "tracks": [
        "frame", "t", "track", "x", "y", "w", "h", "vx", "vy", "mode", "confidence", "grouping", "grouped", "splitting",
        "group_id", "scene", "label", "present",
    ],
    "relations": ["a", "b", "state", "start_frame", "end_frame", "start_t", "end_t"],
    "groups": ["group_id", "members", "start_frame", "end_frame", "start_t", "end_t", "formed_from", "ended_by"],
    "encounters": ["a", "b", "kind", "start_frame", "end_frame", "start_t", "end_t", "confidence",
                   "seen_share", "identity"],
    "events": ["event", "kind", "frame", "t", "subjects", "rule", "evidence", "text"],
}  # fmt: skip


def exported(log: Path, to: str, out: Path, *words: str) -> int:
    return main(["export", str(log), "--to", to, "-o", str(out), *words])


def test_mot_holds_what_is_present(write_annotated: Any, tmp_path: Path) -> None:
    log, out = write_annotated(), tmp_path / "r.txt"
    assert exported(log, "mot", out) == 0
    lines = out.read_text().splitlines()
    assert lines[:2] == ["1,1,10,40,20,40,0.9,-1,-1,-1", "1,2,130,42.5,20,40,0.9,-1,-1,-1"]
    assert len(lines) == 60
    with AnnotatedLog(log) as opened:
        scores = evaluate(read_tracks(opened).table, read_mot(out))
    assert (scores.clear.mota, scores.hota.hota) == (100.0, 100.0)


def test_a_span_keeps_the_frames_numbers(write_annotated: Any, tmp_path: Path) -> None:
    with AnnotatedLog(write_annotated(frames=range(7, 9))) as log:
        assert write_mot(log, tmp_path / "r.txt") == 4
    assert read_mot(tmp_path / "r.txt").frames.tolist() == [7, 7, 8, 8]


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (7.0, "7"),
        (-0.0001, "0"),
        (12.3456, "12.346"),
        (1e-9, "0"),
        (100.0, "100"),
        (-1.5, "-1.5"),
    ],
)
def test_numbers_are_short_and_plain(value: float, text: str) -> None:
    assert format_number(value) == text


def test_json_is_one_document_of_all_tables(write_annotated: Any, tmp_path: Path) -> None:
    out = tmp_path / "all.json"
    assert exported(write_annotated(), "json", out) == 0
    document = json.loads(out.read_text())
    for table, columns in CONTRACT.items():
        assert all(list(row) == ["recording", *columns] for row in document[table])
    assert len(document["frames"]) == 30
    assert [(r["state"], r["start_frame"], r["end_frame"]) for r in document["relations"]] == [
        ("INTERACTION", 8, 11), ("JOINT", 12, 17), ("INTERACTION", 18, 21)
    ]  # fmt: skip
    assert document["groups"][0]["members"] == [1, 2]
    assert document["events"][1]["evidence"] == {"overlap": 0.5}


def test_parquet_folder_and_single_table_hold_the_same(
    write_annotated: Any, tmp_path: Path
) -> None:
    log, folder, single = write_annotated(), tmp_path / "tables", tmp_path / "x.parquet"
    assert exported(log, "parquet", folder) == 0
    assert exported(log, "parquet", single) == 0
    for table, columns in CONTRACT.items():
        found = duckdb.sql(f"SELECT * FROM '{folder}/{table}.parquet'")
        assert found.columns == ["recording", *columns]
    tracks = duckdb.sql(f"SELECT * FROM '{folder}/tracks.parquet'").fetchall()
    assert duckdb.sql(f"SELECT * FROM '{single}'").fetchall() == tracks
    assert len(tracks) == 70
    assert duckdb.sql(f"SELECT members FROM '{folder}/groups.parquet'").fetchall() == [
        ([1, 2],)
    ]
    assert write_parquet(log, tmp_path / "e.parquet", table="events") == {"events": 2}


@pytest.mark.parametrize("to", ["mot", "json", "graphml", "parquet"])
def test_the_same_log_gives_the_same_bytes(
    to: str, write_annotated: Any, tmp_path: Path
) -> None:
    log = write_annotated()
    one, other = tmp_path / f"one.{to}", tmp_path / f"other.{to}"
    assert exported(log, to, one) == exported(log, to, other) == 0
    assert one.read_bytes() == other.read_bytes()


@pytest.mark.parametrize("to", ["mot", "json", "graphml", "parquet", "video"])
def test_nothing_is_overwritten_or_left_half_done(
    to: str, write_annotated: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log, out = write_annotated(), tmp_path / "out.x"
    out.write_text("precious")
    assert exported(log, to, out) == 1
    assert "exists already" in capsys.readouterr().err
    assert out.read_text() == "precious"
    assert exported(log, to, out, "--force") == 0
    assert out.read_bytes() != b"precious"
    damaged = tmp_path / "damaged.mcap"
    data = log.read_bytes()
    damaged.write_bytes(data[: len(data) // 2])
    assert exported(damaged, to, tmp_path / "new.x") == 1
    assert "damaged.mcap" in capsys.readouterr().err
    assert not [p for p in tmp_path.iterdir() if p.name.startswith("new.x")]


def test_a_full_folder_is_not_overwritten(write_annotated: Any, tmp_path: Path) -> None:
    log, folder = write_annotated(), tmp_path / "tables"
    folder.mkdir()
    (folder / "mine.txt").write_text("precious")
    with pytest.raises(OutputExistsError):
        write_parquet(log, folder)
    write_parquet(log, folder, force=True)
    assert (folder / "mine.txt").read_text() == "precious"


def test_wrong_words(
    write_annotated: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = write_annotated()
    with pytest.raises(UsageError, match="no table 'people'; there are: frames, tracks"):
        write_parquet(log, tmp_path / "x.parquet", table="people")
    assert exported(log, "excel", tmp_path / "x") == 2
    assert exported(log, "video", tmp_path / "v.mp4", "--scale", "99") == 2
    assert exported(log, "video", tmp_path / "v.mp4", "--from", "soon") == 2
    assert "soon" in capsys.readouterr().err


def test_a_scene_log_is_told_to_be_replayed(tmp_path: Path) -> None:
    from fixtures.logs import write_scene_log
    from fixtures.scenes import generate

    path = write_scene_log(
        generate("empty_scene"), tmp_path / "scene.mcap", pictures="none", masks=False
    )
    for write in (write_json, write_graphml, write_parquet):
        with pytest.raises(RecordingError, match=r"holds no tracks.*scenetrace replay"):
            write(path, tmp_path / "out")
    with pytest.raises(RecordingError, match=r"holds no tracks.*scenetrace replay"):
        AnnotatedLog(path)
    assert not [p for p in tmp_path.iterdir() if p.name.startswith("out")]


def test_several_cameras_are_chosen_by_name(write_annotated: Any, tmp_path: Path) -> None:
    log = write_annotated(cameras=("left", "right"))
    with pytest.raises(UsageError, match=r"several cameras \(left, right\)"):
        AnnotatedLog(log)
    assert exported(log, "mot", tmp_path / "r.txt", "--camera", "right") == 0
    with pytest.raises(UsageError, match=r"several cameras \(left, right\)"):
        write_json(log, tmp_path / "both.json")
    assert not (tmp_path / "both.json").exists()
    assert write_json(log, tmp_path / "one.json", camera="left")["frames"] == 30
    assert exported(log, "json", tmp_path / "two.json", "--camera", "right") == 0
