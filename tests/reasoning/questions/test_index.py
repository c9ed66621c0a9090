"""The index: the same answers as the logs, each recording once, safe to interrupt."""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import pytest

from reasoning.questions import TABLES, Case
from reasoning.questions import index as index_module
from reasoning.questions.index import build_index
from reasoning.questions.ready import Options, question
from recorders.errors import RecordingError, UsageError


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory, meeting_story, write_story) -> list[Path]:
    folder = tmp_path_factory.mktemp("many")
    out = []
    for k in range(5):
        story = dataclasses.replace(meeting_story, frames=260 + k, start_ns=k * 10**12)
        out.append(write_story(story, folder / f"rec{k}.mcap"))
    return out


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_an_index_answers_like_the_logs(logs: list[Path], tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    done = build_index(logs, out)
    assert [f.recording for f in done.added] == [f"rec{k}" for k in range(5)]
    with Case(logs) as direct, Case([out]) as indexed:
        for table, columns in TABLES.items():
            order = ", ".join(f"CAST({c} AS VARCHAR)" for c, _ in columns)
            query = f"SELECT * FROM {table} ORDER BY {order}"
            assert indexed.rows(query) == direct.rows(query), table
        sql = question("contacts").sql(["1"], Options())
        assert indexed.rows(sql) == direct.rows(sql)


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_each_recording_once(logs: list[Path], tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    build_index(logs[:2], out)
    copied = Path(shutil.copy(logs[0], tmp_path / "another-name.mcap"))
    done = build_index([copied, *logs[:3]], out)
    assert [f.recording for f in done.added] == ["rec2"]
    assert done.known == [copied, logs[0], logs[1]]
    with Case([out]) as c:
        assert c.rows("SELECT recording FROM recordings ORDER BY 1") == [("rec0",), ("rec1",), ("rec2",)]


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_an_interrupted_run_is_resumed(
    logs: list[Path], tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / name
    real = index_module.read_recordings

    def interrupted(path, sink, **options):
        if path == logs[3]:
            sink("frames", [("rec3", 0, 0.0)])
            raise KeyboardInterrupt
        return real(path, sink, **options)

    monkeypatch.setattr(index_module, "PART_RECORDINGS", 2)
    monkeypatch.setattr(index_module, "read_recordings", interrupted)
    with pytest.raises(KeyboardInterrupt):
        build_index(logs, out)
    with Case([out]) as c:
        names = {r[0] for r in c.rows("SELECT recording FROM recordings")}
        assert {"rec0", "rec1"} <= names <= {"rec0", "rec1", "rec2"}
        assert c.rows("SELECT count(*) FROM frames WHERE recording = 'rec3'") == [(0,)]
    monkeypatch.setattr(index_module, "read_recordings", real)
    build_index(logs, out)
    with Case([out]) as c:
        assert c.rows("SELECT count(*), count(DISTINCT recording) FROM recordings") == [(5, 5)]
        assert c.rows("SELECT count(*) FROM frames WHERE recording = 'rec3'") == [(263,)]


def test_a_leftover_part_is_cleared(logs: list[Path], tmp_path: Path) -> None:
    out = tmp_path / "case"
    (out / ".part-000000").mkdir(parents=True)
    (out / ".part-000000" / "tracks.parquet").write_bytes(b"half")
    build_index(logs[:1], out)
    assert sorted(p.name for p in out.iterdir()) == ["part-000000"]


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_a_log_that_cannot_be_read(logs: list[Path], tmp_path: Path, name: str) -> None:
    bad = tmp_path / "bad.mcap"
    bad.write_bytes(logs[0].read_bytes()[:2000])
    with pytest.raises(RecordingError):
        build_index([bad, logs[1]], tmp_path / name)
    done = build_index([bad, logs[1]], tmp_path / name, keep_going=True)
    assert [f.recording for f in done.added] == ["rec1"]
    assert done.failed[0][0] == bad


def test_strangers_are_left_alone(logs: list[Path], tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "diary.txt").write_text("dear diary")
    with pytest.raises(UsageError, match=r"diary\.txt"):
        build_index(logs[:1], tmp_path / "mine")
    (tmp_path / "x.duckdb").write_bytes(b"not a database at all")
    with pytest.raises(RecordingError):
        build_index(logs[:1], tmp_path / "x.duckdb")
    assert (tmp_path / "x.duckdb").read_bytes() == b"not a database at all"


def test_an_index_has_two_cameras_of_one_log_apart(tmp_path: Path, meeting_story, meeting_log: Path) -> None:
    with Case([meeting_log]) as c:
        assert c.rows("SELECT recording, camera FROM recordings") == [("meeting", meeting_story.camera)]
