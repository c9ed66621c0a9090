"""The index: the same answers as the logs, each recording once, safe to interrupt."""

from __future__ import annotations

import dataclasses
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from reasoning.questions import TABLES, Case, QueryError, QueryLimits
from reasoning.questions import asking as asking_module
from reasoning.questions import index as index_module
from reasoning.questions.index import build_index
from reasoning.questions.literals import Moment, Recordings
from reasoning.questions.ready_questions import SOURCES, Options, question
from recorders.errors import RecordingError, UsageError


@pytest.fixture(scope="module")
def logs(
    tmp_path_factory: pytest.TempPathFactory,
    meeting_story: Any,
    write_story: Callable[..., Any],
) -> list[Path]:
    folder = tmp_path_factory.mktemp("many")
    out = []
    for k in range(5):
        story = dataclasses.replace(meeting_story, frames=260 + k, start_ns=k * 10**12)
        out.append(write_story(story, folder / f"rec{k}.mcap"))
    return out


@pytest.fixture(scope="module")
def indexes(logs: list[Path], tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    folder = tmp_path_factory.mktemp("indexed")
    out = [folder / "case.duckdb", folder / "case"]
    for index in out:
        build_index(list(reversed(logs)), index)
    return out


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_an_index_answers_like_the_logs(
    logs: list[Path], tmp_path: Path, name: str
) -> None:
    out = tmp_path / name
    done = build_index(logs, out)
    assert [f.recording for f in done.added] == [f"rec{k}" for k in range(5)]
    with Case(logs) as direct, Case([out]) as indexed:
        for table, columns in TABLES.items():
            order = ", ".join(f"CAST({c} AS VARCHAR)" for c, _ in columns)
            query = f"SELECT * FROM sure_{table} ORDER BY {order}"
            assert indexed.rows(query) == direct.rows(query), table
        sql = question("contacts").sql(["1"], Options())
        assert indexed.rows(sql) == direct.rows(sql)


ASKED = [
    ("met", ["1"], {}), ("met", ["2", "1"], {}), ("together", ["1", "2"], {}), ("left-with", ["2"], {"within_s": 60.0}),
    ("who-was-in", ["bench"], {"at": Moment(frame=165)}), ("who-was-in", ["scene"], {"at": Moment(seconds=7.0)}),
    ("loitered", ["bench"], {"least_s": 1.0}), ("entered-never-left", [], {}), ("grouping-and-splitting", [], {}),
    ("group-history", ["3"], {}), ("before", ["12"], {}), ("timeline", ["3"], {}),
    *[("contacts", ["1"], {"by": by, "depth": 4}) for by in SOURCES],
]  # fmt: skip


@pytest.mark.parametrize("asked", ASKED, ids=lambda a: " ".join([a[0], *a[1]]))
def test_each_question_is_answered_alike_by_logs_database_and_parquet(
    logs: list[Path],
    indexes: list[Path],
    asked: tuple[str, list[str], dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    name, words, options = asked

    def make(some: Recordings | None) -> str:
        return question(name).sql(words, Options(recordings=some, **options))

    monkeypatch.setattr(
        asking_module, "_FIRST_ROWS", 10
    )  # so that recordings are asked one by one
    answers = []
    for inputs in (logs, indexes[:1], indexes[1:]):
        with Case(inputs) as c:
            answers.append((c.by_recording(make).columns, list(c.by_recording(make).rows)))
            assert (
                answers[-1][1]
                == c.rows(make(None))
                == list(c.by_recording(make, keeps_few=True).rows)
            )
            alone = Recordings("rec2", "rec3")
            assert list(c.by_recording(make, alone).rows) == [
                r for r in answers[-1][1] if r[0] in ("rec2", "rec3")
            ]
    assert answers[0] == answers[1] == answers[2]
    assert bool(answers[0][1]) == (name != "left-with")  # nobody leaves with another here


def test_a_question_that_takes_too_much_memory_at_once_is_asked_by_and_by(
    logs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking_module, "_FIRST_ROWS", 10)
    few = "SELECT recording, count(*) FROM frames"

    def make(some: Recordings | None) -> str:
        where, large = ("true", 10**8) if some is None else (some.sql(), 1)
        numbers = f"(SELECT list(range) AS all_of_them FROM range({large}))"
        return (
            f"{few}, {numbers} WHERE len(all_of_them) > 0 AND {where} GROUP BY recording"
            " ORDER BY recording"
        )

    with Case(logs, QueryLimits(memory_mib=128)) as c:
        assert list(c.by_recording(make, keeps_few=True).rows) == c.rows(
            f"{few} GROUP BY recording ORDER BY recording"
        )
        with pytest.raises(QueryError, match="128 MiB"):
            c.rows(make(None))


def test_a_pair_stands_together_in_an_index(indexes: list[Path]) -> None:
    for index in indexes:
        with Case([index]) as c:
            rows = c.rows(
                "SELECT recording, a, b, start_frame FROM relations WHERE recording ="
                " 'rec1'"
            )
            assert rows == sorted(rows)


def test_a_time_limit_is_that_of_the_whole_answer(
    logs: list[Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(asking_module, "_FIRST_ROWS", 10)
    slow = "SELECT count(*) FROM frames, range(200000000) WHERE hash(range) = 7"
    with (
        Case(logs, QueryLimits(seconds=0.5)) as c,
        pytest.raises(QueryError, match="stopped after"),
    ):
        list(
            c.by_recording(
                lambda some: slow if some is None else f"{slow} AND {some.sql()}"
            ).rows
        )


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_each_recording_once(logs: list[Path], tmp_path: Path, name: str) -> None:
    out = tmp_path / name
    build_index(logs[:2], out)
    copied = Path(shutil.copy(logs[0], tmp_path / "another-name.mcap"))
    done = build_index([copied, *logs[:3]], out)
    assert [f.recording for f in done.added] == ["rec2"]
    assert done.known == [copied, logs[0], logs[1]]
    with Case([out]) as c:
        assert c.rows("SELECT recording FROM recordings ORDER BY 1") == [
            ("rec0",),
            ("rec1",),
            ("rec2",),
        ]


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_an_interrupted_run_is_resumed(
    logs: list[Path], tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / name
    real = vars(index_module)["read_recordings"]

    def interrupted(path: Path, sink: Callable[..., object], **options: Any) -> Any:
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
        assert c.rows("SELECT count(*), count(DISTINCT recording) FROM recordings") == [
            (5, 5)
        ]
        assert c.rows("SELECT count(*) FROM frames WHERE recording = 'rec3'") == [(263,)]


KILLED = """
import os, signal, sys, threading, time
from pathlib import Path
from reasoning.questions import index
index.PART_RECORDINGS = 1
def strike():
    time.sleep(float(sys.argv[1]))
    os.kill(os.getpid(), signal.SIGKILL)
threading.Thread(target=strike, daemon=True).start()
index.build_index([Path(p) for p in sys.argv[3:]], Path(sys.argv[2]))
"""


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
def test_killed_at_any_moment_and_run_again(
    logs: list[Path], tmp_path: Path, name: str
) -> None:
    """SIGKILL after ever longer times, until a run ends by itself: what is in it is whole each
    time, all at last.
    """
    out = tmp_path / name
    killed, wait, seen = 0, 0.03, False
    while True:
        words = [sys.executable, "-c", KILLED, str(wait), str(out), *map(str, logs)]
        done = subprocess.run(
            words,
            capture_output=True,
            text=True,
            check=False,
            cwd=Path(__file__).parents[3],
        )
        if done.returncode == 0:
            break
        assert done.returncode == -signal.SIGKILL, done.stderr
        killed, wait = killed + 1, wait * 1.4
        assert killed < 60
        opened = True
        try:
            with Case([out]) as c:
                counted = (
                    "SELECT recording, frames, (SELECT count(*) FROM frames f WHERE"
                    " f.recording = r.recording)"
                )
                assert all(
                    said == there
                    for _, said, there in c.rows(f"{counted} FROM recordings r")
                )
        except RecordingError:
            opened = False
        assert (
            opened or not seen
        )  # it may have been killed before there was a first recording
        seen = opened
    assert killed >= 3
    with Case(logs) as direct, Case([out]) as indexed:
        for table, columns in TABLES.items():
            order = ", ".join(f"CAST({c} AS VARCHAR)" for c, _ in columns)
            query = f"SELECT * FROM sure_{table} ORDER BY {order}"
            assert indexed.rows(query) == direct.rows(query), table


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


def test_an_index_has_two_cameras_of_one_log_apart(
    tmp_path: Path, meeting_story: Any, meeting_log: Path
) -> None:
    with Case([meeting_log]) as c:
        assert c.rows("SELECT recording, camera FROM recordings") == [
            ("meeting", meeting_story.camera)
        ]
