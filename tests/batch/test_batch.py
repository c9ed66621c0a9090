"""Many sources into a case: whole, once, the same whoever does it."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest

from reasoning.questions import Case
from reasoning.questions.catalogue import Choice
from recorders.errors import RecordingError
from replay.batch import BatchSummary, sources_of
from replay.batch.nursery import Nursery
from replay.cli import main
from tests.batch.conftest import WORDS, three_sources, walk
from tests.batch.files import digests

NAMES = "SELECT recording, camera, frames FROM recordings ORDER BY recording"


def batch(sources: Path | str, case: Path, *words: str) -> int:
    return main(["batch", str(sources), "-o", str(case), *WORDS, *words])


def several(sources: Path) -> str:
    return str(sources / "*" / "*.txt")


@pytest.fixture(scope="module")
def done_before(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with three sources, `in`, and the case that one worker made of them, `case`."""
    folder = tmp_path_factory.mktemp("done-before")
    three_sources(folder / "in")
    assert batch(several(folder / "in"), folder / "case", "--workers", "1") == 0
    return folder


@pytest.fixture
def case(done_before: Path, tmp_path: Path) -> Path:
    """A copy of that case."""
    return Path(shutil.copytree(done_before / "case", tmp_path / "case"))


def test_the_same_files_whoever_does_it_in_whatever_order(
    done_before: Path, tmp_path: Path
) -> None:
    there = sorted((done_before / "in").rglob("*.txt"), reverse=True)
    (tmp_path / "list.txt").write_text("\n".join(map(str, there)))
    assert batch(f"@{tmp_path / 'list.txt'}", tmp_path / "b", "--workers", "2") == 0
    assert digests(done_before / "case") == digests(tmp_path / "b")


def test_what_the_commands_make_one_by_one(sources: Path, tmp_path: Path) -> None:
    one = sources / "cam0" / "w0.txt"
    assert batch(one, tmp_path / "case") == 0
    (made,) = (tmp_path / "case" / "annotated").iterdir()
    scene, annotated = tmp_path / made.name, tmp_path / "a.mcap"
    assert main(["record", str(one), "-o", str(scene), *WORDS]) == 0
    assert main(["replay", str(scene), "-o", str(annotated)]) == 0
    assert made.read_bytes() == annotated.read_bytes()
    with Case([made]) as plain, Case([tmp_path / "case"]) as fleet:
        for table in ("tracks", "events", "relations", "targets", "quality"):
            rows = f"SELECT * EXCLUDE recording FROM {table} ORDER BY ALL"
            assert plain.rows(rows) == fleet.rows(rows)


def test_finished_work_is_not_done_twice(
    sources: Path, case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    times = {path: path.stat().st_mtime_ns for path in case.rglob("*.mcap")}
    walk(sources / "cam1" / "new.txt", 90)
    assert batch(several(sources), case, "--json-lines") == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert lines[-1] | {"seconds": 0} == {
        "done": 1, "known": 3, "failed": 0, "left_out": 0, "unread_folders": 0, "frames": 20,
        "seconds": 0,
    }  # fmt: skip
    assert times.items() <= {p: p.stat().st_mtime_ns for p in case.rglob("*.mcap")}.items()


def test_the_same_bytes_under_another_name_are_known(
    sources: Path, case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = digests(case)
    copy = tmp_path / "copy.txt"
    copy.write_bytes((sources / "cam0" / "w0.txt").read_bytes())
    batch(copy, case)
    assert "0 recordings done" in capsys.readouterr().err.splitlines()[-1]
    assert digests(case) == before


def test_another_configuration_is_another_recording(sources: Path, case: Path) -> None:
    assert batch(sources / "cam0" / "w0.txt", case, "--tracker", "shells") == 0
    with Case([case]) as asked:
        found = asked.rows("SELECT tracker FROM recordings ORDER BY tracker")
    assert found == [("events",)] * 3 + [("shells",)]


def test_what_cannot_be_read_is_set_aside_with_its_reason(
    sources: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (sources / "cam0" / "x.txt").write_text("not,a,table\n")
    case = tmp_path / "case"
    assert batch(several(sources), case) == 3
    assert "x.txt" in capsys.readouterr().err
    assert main(["batch", "--status", str(case), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["done"], found["failed"]) == (3, 1)
    (failure,) = found["failures"]
    assert failure["source"].endswith("x.txt")
    assert failure["step"] == "record"
    assert failure["tries"] == 1
    # It is not tried again until somebody wants it.
    assert batch(several(sources), case) == 3
    walk(sources / "cam0" / "x.txt", 33)
    assert batch(several(sources), case) == 0
    # Of what was mended, the status tells no failure any more.
    capsys.readouterr()
    assert main(["batch", "--status", str(case), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["done"], found["failed"]) == (4, 0)


def test_what_is_no_source_is_named_at_once(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "empty").mkdir()
    assert batch(tmp_path / "empty", tmp_path / "case") == 2
    assert "holds no video" in capsys.readouterr().err
    (tmp_path / "a.mp4").write_bytes(b"")
    (tmp_path / "list.txt").write_text("a.mp4 --bogus 3\n")
    assert batch(f"@{tmp_path / 'list.txt'}", tmp_path / "case") == 2
    assert "unrecognized arguments: --bogus 3" in capsys.readouterr().err
    os.mkfifo(tmp_path / "pipe.mp4")
    assert batch(tmp_path / "pipe.mp4", tmp_path / "case", "--time-limit", "60") == 1
    assert "neither a file nor a folder" in capsys.readouterr().err


def test_thumbnails_beside_videos_are_no_source(tmp_path: Path) -> None:
    for name in ("a.mp4", "b.mp4", "a.jpg"):
        (tmp_path / name).write_bytes(b"")
    (tmp_path / "pictures").mkdir()
    (tmp_path / "pictures" / "1.jpg").write_bytes(b"")
    (tmp_path / "again").symlink_to(tmp_path)
    found = [Path(source).name for source, _ in sources_of([str(tmp_path)]).found]
    assert found == ["a.mp4", "b.mp4", "pictures"]


@pytest.mark.parametrize(
    ("words", "said"),
    [(("--time-limit", "0.05"), "--time-limit"), (("--memory", "64"), "--memory")],
)
def test_one_that_takes_too_much_is_stopped(
    sources: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    words: tuple[str, str],
    said: str,
) -> None:
    assert batch(sources / "cam0" / "w0.txt", tmp_path / "case", *words) == 1
    assert said in capsys.readouterr().err
    assert not list((tmp_path / "case").rglob("*.mcap"))
    # Poison is not swallowed twice.
    (status,) = (tmp_path / "case" / "status").iterdir()
    before = status.stat().st_mtime_ns
    assert batch(sources / "cam0" / "w0.txt", tmp_path / "case", *words) == 1
    assert status.stat().st_mtime_ns == before
    assert batch(sources / "cam0" / "w0.txt", tmp_path / "case", "--again") == 0


def _workers_of(driver: int) -> list[int]:
    found = subprocess.run(["pgrep", "-P", str(driver)], capture_output=True, check=False)
    return [int(number) for number in found.stdout.split()]


def _wait_for_the_end_of(workers: list[int]) -> None:
    """Until they have seen that nobody waits for them."""
    end = time.monotonic() + 120
    while running := [number for number in workers if _runs(number)]:
        assert time.monotonic() < end, f"{running} go on"
        time.sleep(0.05)


def _runs(number: int) -> bool:
    try:
        state = Path(f"/proc/{number}/stat").read_text().rpartition(")")[2].split()[0]
    except OSError:
        return False
    return state != "Z"


def test_a_driver_that_is_killed_leaves_nothing_half(sources: Path, tmp_path: Path) -> None:
    whole, case = tmp_path / "whole", tmp_path / "case"
    for number in range(4, 6):
        walk(sources / "cam0" / f"w{number}.txt", 100 + number)
    batch(several(sources), whole)
    command = [sys.executable, "-c", "import scenetrace; scenetrace.main()"]
    words = ["batch", several(sources), "-o", str(case), *WORDS, "--workers", "2"]
    process = subprocess.Popen(
        [*command, *words], env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    )
    end = time.monotonic() + 120
    while time.monotonic() < end and not list((case / "status").glob("*.json")):
        time.sleep(0.02)
    workers = _workers_of(process.pid)
    process.send_signal(signal.SIGKILL)
    process.wait()
    _wait_for_the_end_of(workers)
    right = digests(whole)
    assert digests(case).items() <= right.items()
    assert batch(several(sources), case) == 0
    assert digests(case) == right


def test_one_that_is_interrupted_leaves_no_parts(
    sources: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(summary: BatchSummary, *_: object) -> None:
        if summary.running:
            raise KeyboardInterrupt

    monkeypatch.setattr("replay.cli.batch._tell", interrupted)
    # Those that are lent to tests go on after their batch.
    monkeypatch.setattr("replay.batch.engines.Nursery", Nursery)
    assert batch(several(sources), tmp_path / "case", "--workers", "2") == 1
    monkeypatch.undo()
    assert not (tmp_path / "case" / ".parts").exists()
    assert batch(several(sources), tmp_path / "case", "--workers", "2") == 0


def test_a_folder_that_may_not_be_read_is_left_out(
    done_before: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    shut = tmp_path / "in" / "shut"
    shut.mkdir(parents=True)
    one = min((done_before / "case" / "scene").iterdir())
    shutil.copy(one, tmp_path / "in" / one.name)
    listed = Path.iterdir

    def refused(folder: Path) -> Iterator[Path]:
        if folder == shut:  # root may read everything
            raise PermissionError(13, "Permission denied")
        return listed(folder)

    monkeypatch.setattr(Path, "iterdir", refused)
    assert batch(tmp_path / "in", tmp_path / "case", "--json") == 3
    told = capsys.readouterr()
    assert f"left out: {shut}: cannot be read: Permission denied" in told.err
    summary = json.loads(told.out)
    assert (summary["done"], summary["unread_folders"]) == (1, 1)
    assert batch(shut, tmp_path / "case") == 2
    assert "Permission denied" in capsys.readouterr().err


def test_a_case_where_a_log_is_expected(
    case: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["info", str(case), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["recordings"], found["frames"]) == (3, 60)
    assert main(["verify", str(case), "--quick"]) == 0
    assert capsys.readouterr().out.count("identical") == 3
    assert main(["diff", str(case), str(case)]) == 1
    assert "name one of its recordings" in capsys.readouterr().err
    assert main(["doctor", str(tmp_path)]) == 1
    assert "this is a folder, not a log" in capsys.readouterr().err


def test_files_of_a_case_that_were_changed_are_named(
    case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main(["batch", "--compact", str(case)])
    main(["batch", "--compact", str(case)])
    assert main(["doctor", str(case)]) == 0
    changed, gone = sorted((case / "annotated").iterdir())[:2]
    with changed.open("ab") as file:
        file.write(b"x")
    gone.unlink()
    capsys.readouterr()
    assert main(["doctor", str(case), "--json"]) == 1
    told = {one["key"]: one["reason"] for one in json.loads(capsys.readouterr().out)}
    assert told == {
        f"annotated/{changed.name}": "changed: another SHA-256",
        f"annotated/{gone.name}": "missing",
    }


def test_a_remote_folder_of_pictures_is_a_source(tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    pictures = tmp_path / "in" / "cam4" / "pictures"
    pictures.mkdir(parents=True)
    for number in range(3):
        picture = np.full((48, 64, 3), 40 * number, np.uint8)
        cv2.imwrite(str(pictures / f"{number}.png"), picture)
    words = ["--fps", "5", "--camera", "{folder}"]
    for source, name in ((pictures, "a"), (f"file://{tmp_path}/in/", "b")):
        assert main(["batch", str(source), "-o", str(tmp_path / name), *words]) == 0
    remote, plain = (digests(tmp_path / name, statuses=False) for name in ("b", "a"))
    assert remote == plain
    assert any("camera=cam4" in key for key in remote)


def test_one_batch_at_a_time(
    sources: Path, case: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    import fcntl

    with (case / ".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        assert batch(several(sources), case) == 2
    assert "another batch" in capsys.readouterr().err


def test_a_compacted_case_answers_the_same(sources: Path, tmp_path: Path) -> None:
    case = tmp_path / "case"
    batch(several(sources), case, "--camera", "{folder}")
    query = "SELECT * FROM tracks ORDER BY ALL"
    with Case([case]) as asked:
        before = asked.rows(query)
        assert main(["batch", "--compact", str(case)]) == 0
        # One that was open before goes on with its files.
        assert asked.rows(query) == before
    files = len(list((case / "tables" / "tracks").rglob("*.parquet")))
    assert main(["batch", "--compact", str(case)]) == 0
    assert files == 4
    assert len(list((case / "tables" / "tracks").rglob("*.parquet"))) == 2
    with Case([case]) as asked:
        assert asked.rows(query) == before
    walk(sources / "cam1" / "new.txt", 90)
    assert batch(several(sources), case, "--camera", "{folder}") == 0
    with Case([case]) as asked:
        assert len(asked.rows(NAMES)) == 4


def test_a_camera_and_a_day(sources: Path, tmp_path: Path) -> None:
    case = tmp_path / "case"
    words = ("--camera", "{folder}", "--start", "2026-01-31T12:00:00Z")
    batch(several(sources), case, *words)
    with Case([case], choice=Choice("cam1", ("2026-01-31", "2026-01-31"))) as asked:
        assert {row[1] for row in asked.rows(NAMES)} == {"cam1"}
    with pytest.raises(RecordingError, match="that day; there are 2026-01-31"):
        Case([case], choice=Choice("cam1", ("2026-02-01", "2026-02-01")))
    with pytest.raises(RecordingError, match="that camera; there are: cam0, cam1"):
        Case([case], choice=Choice("cam7"))


def test_a_case_of_another_version_is_refused(sources: Path, case: Path) -> None:
    (case / "tables" / "schema.json").write_text('{"version": "0"}')
    with pytest.raises(RecordingError, match="another version"):
        Case([case])
    assert batch(several(sources), case) == 1


def test_a_tracker_of_ones_own_is_shipped(sources: Path, tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "my_fleet_tracker.py").write_text(
        "import replay.trackers.catalogue as c\n\n\n"
        "def Mine(scene, config):\n    return c.TRACKERS['shells'](scene, config)\n\n\n"
        "Mine.SECTIONS = c.TRACKER_SECTIONS['shells']\n"
    )
    case = tmp_path / "case"
    words = ("--ship", str(tmp_path / "mine"), "--tracker", "my_fleet_tracker:Mine")
    assert batch(sources / "cam0" / "w0.txt", case, *words) == 0
    with Case([case]) as asked:
        assert asked.rows("SELECT tracker FROM recordings") == [("my_fleet_tracker:Mine",)]


def test_a_store_by_uri(done_before: Path, tmp_path: Path) -> None:
    pytest.importorskip("fsspec")
    store = f"file://{tmp_path}/case"
    assert main(["batch", several(done_before / "in"), "-o", store, *WORDS]) == 0
    assert digests(tmp_path / "case") == digests(done_before / "case")
    with Case([store]) as asked:
        assert len(asked.rows(NAMES)) == 3
