"""Several processes at one file, paths that are too long, folders that may not be written, clocks
that lie.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

from reasoning.questions import Case
from reasoning.questions.index import build_index
from recorders.log import LogReader, LogWriter
from tests.faults.small import WORDS, annotated, boxes, run

MAIN = "import sys; from replay.cli import main; sys.exit(main(sys.argv[1:]))"


def started(*words: str) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *words], stderr=subprocess.PIPE, text=True
    )


def test_two_writers_of_one_output(tmp_path: Path) -> None:
    det, out = boxes(tmp_path / "det.txt"), tmp_path / "out.mcap"
    both = [started("record", str(det), "-o", str(out), *WORDS) for _ in range(2)]
    said = [process.communicate()[1] for process in both]
    codes = sorted(process.returncode for process in both)
    assert codes == [0, 1], said
    assert any("exists already" in text for text in said)
    with LogReader(out) as log:
        assert log.message_count == 12
    assert sorted(p.name for p in tmp_path.iterdir()) == ["det.txt", "out.mcap"]


@pytest.mark.parametrize("name", ["case.duckdb", "case"])
@pytest.mark.parametrize("later_s", [0.0, 0.1, 0.2])
def test_two_writers_of_one_index(tmp_path: Path, name: str, later_s: float) -> None:
    log, index = annotated(tmp_path), tmp_path / name
    first = started("index", str(log), "-o", str(index))
    time.sleep(later_s)
    second = started("index", str(log), "-o", str(index))
    said = [process.communicate()[1] for process in (first, second)]
    codes = sorted(process.returncode for process in (first, second))
    # The second waits for nobody: it says who holds it, or finds the recording there.
    assert codes in ([0, 0], [0, 1]), said
    assert "Traceback" not in "".join(said)
    with Case([index]) as case:
        assert len(list(case.sql("SELECT * FROM recordings").rows)) == 1
    assert not [p for p in tmp_path.iterdir() if p.name.startswith(".")]


def test_who_cannot_open_an_index_leaves_it_to_whom_it_belongs(tmp_path: Path) -> None:
    log, index = annotated(tmp_path), tmp_path / "case.duckdb"
    asked: list[int] = []

    def ask(stage: str, done: int) -> None:
        other = started("index", str(log), "-o", str(index))
        other.communicate()
        asked.append(other.returncode)

    done = build_index([log], index, progress=ask)
    assert len(done.added) == 1
    assert asked == [1]
    with Case([index]) as case:
        assert len(list(case.sql("SELECT * FROM recordings").rows)) == 1


def test_a_log_that_is_deleted_while_it_is_read(tmp_path: Path) -> None:
    log = annotated(tmp_path)
    with LogReader(log) as reader:
        log.unlink()
        assert len(list(reader.messages())) == reader.message_count


@pytest.mark.parametrize("command", ["record", "replay", "export"])
def test_a_path_of_4000_characters_is_one_line(tmp_path: Path, command: str) -> None:
    made = annotated(tmp_path)
    out = str(tmp_path / ("a" * 200 + "/") / "x") + "/y" * 1900
    words = {
        "record": ["record", str(tmp_path / "det.txt"), *WORDS],
        "replay": ["replay", str(tmp_path / "scene.mcap")],
        "export": ["export", str(made), "--to", "mot"],
    }[command]
    code, said = run(*words, "-o", out)
    assert code == 1
    assert said.count("\n") == 1


@pytest.mark.skipif(os.geteuid() == 0, reason="the superuser may write everywhere")
def test_a_folder_that_may_not_be_written(tmp_path: Path) -> None:
    annotated(tmp_path)
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o500)
    code, said = run("replay", str(tmp_path / "scene.mcap"), "-o", str(closed / "x.mcap"))
    assert code == 1
    assert "cannot be written" in said


YEAR_2262 = 9_223_372_036_000_000_000
CLOCKS = {
    "back by an hour": [0, 40, 80, -3_600_000, 160],
    "on by 58 days": [0, 40, 80, 58 * 86_400_000, 58 * 86_400_000 + 40],
    "all at one moment": [0, 0, 0, 0, 0],
    "a leap second": [0, 40, 1040, 1080, 1120],
}


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize(
    "start_ns", [3_600_000_000_000, 1_767_225_600_000_000_000, YEAR_2262]
)
def test_clocks_that_lie_are_told_or_followed(
    tmp_path: Path, clock: str, start_ns: int
) -> None:
    det = boxes(tmp_path / "det.txt", frames=5)
    sound, bent = tmp_path / "scene.mcap", tmp_path / "bent.mcap"
    assert run("record", str(det), "-o", str(sound), *WORDS)[0] == 0
    with LogReader(sound) as log, LogWriter(bent) as out:
        channels = {
            c.id: out.channel(c.topic, c.schema, c.message_encoding, c.metadata)
            for c in log.channels
        }
        moments = [start_ns + 1_000_000 * ms for ms in CLOCKS[clock]]
        for m in log.messages():
            frame = min(4, m.log_time_ns // 40_000_000)
            if 0 <= moments[frame] < 2**64:
                out.write(channels[m.channel.id], m.data, moments[frame])
        for name, values in log.metadata():
            out.metadata(name, values)
    replayed = tmp_path / "annotated.mcap"
    code, said = run("replay", str(bent), "-o", str(replayed))
    assert "Traceback" not in said
    if code in (1, 2):
        assert said.count("\n") == 1
        assert not replayed.exists()
        return
    for words in (
        ["query", str(replayed), "SELECT * FROM tracks", "--json"],
        ["verify", str(replayed)],
        ["export", str(replayed), "--to", "mot", "-o", str(tmp_path / "out.txt")],
    ):
        again, more = run(*words)
        assert again in (0, 3), more
        assert "null" not in more
