"""Outputs appear whole or not at all: existing files, two writers, a full disk, a killed process."""

from __future__ import annotations

import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from recorders.errors import OutputExistsError, RecordingError
from recorders.log import LogReader, LogWriter
from recorders.log.recovery import recover


def fill(log: LogWriter, count: int = 100) -> None:
    channel = log.channel("/a", None, "raw")
    for k in range(count):
        log.write(channel, b"data %d" % k, k * 100_000_000)


def test_only_the_part_file_shows_while_writing(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        fill(log)
        assert sorted(p.name for p in tmp_path.iterdir()) == ["log.mcap.part"]
    assert sorted(p.name for p in tmp_path.iterdir()) == ["log.mcap"]


def test_an_exception_leaves_nothing(tmp_path: Path) -> None:
    with pytest.raises(ZeroDivisionError), LogWriter(tmp_path / "log.mcap") as log:
        fill(log, 1 // 0)
    assert list(tmp_path.iterdir()) == []


def test_keep_part_leaves_what_was_flushed(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "log.mcap", keep_part=True)
    fill(log)
    log.abort()
    report = recover(tmp_path / "log.mcap.part", tmp_path / "saved.mcap")
    assert report.messages == 90
    assert not report.is_complete


def test_an_existing_output_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_text("precious")
    with pytest.raises(
        OutputExistsError,
        match="exists already, not overwriting it; give another name or --force",
    ):
        LogWriter(path)
    assert path.read_text() == "precious"
    with LogWriter(path, force=True) as log:
        fill(log)
        assert path.read_text() == "precious"
    with LogReader(path) as log:
        assert log.message_count == 100


def test_an_output_that_appears_meanwhile_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    log = LogWriter(path)
    fill(log)
    path.write_text("precious")
    with pytest.raises(OutputExistsError):
        log.close()
    assert path.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [path]


def test_two_writers_cannot_share_an_output(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        with pytest.raises(
            RecordingError, match="another run is writing it, or one was interrupted"
        ):
            LogWriter(path)
        with pytest.raises(RecordingError, match="another process is writing it now"):
            LogWriter(path, force=True)
        fill(log)
    with LogReader(path) as reader:
        assert reader.message_count == 100


def test_what_an_interrupted_run_left_is_kept_without_force(tmp_path: Path) -> None:
    part = tmp_path / "log.mcap.part"
    part.write_bytes(b"left over")
    with pytest.raises(RecordingError, match="scenetrace recover"):
        LogWriter(tmp_path / "log.mcap")
    assert part.read_bytes() == b"left over"
    with LogWriter(tmp_path / "log.mcap", force=True) as log:
        fill(log)
    assert not part.exists()


@pytest.mark.parametrize("keep", [False, True])
def test_a_full_disk_is_one_clear_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep: bool
) -> None:
    written = 0
    real_write = os.write

    def write(descriptor: int, data: memoryview) -> int:
        nonlocal written
        if written + len(data) > 1000:
            raise OSError(errno.ENOSPC, "No space left on device")
        written += len(data)
        return real_write(descriptor, data)

    monkeypatch.setattr("recorders.log.output.os.write", write)
    with (
        pytest.raises(RecordingError, match="the disk is full") as caught,
        LogWriter(tmp_path / "log.mcap", keep_part=keep) as log,
    ):
        fill(log, 1000)
    assert caught.value.path == tmp_path / "log.mcap"
    assert [p.name for p in tmp_path.iterdir()] == (["log.mcap.part"] if keep else [])


def test_a_disk_that_fills_at_the_end_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fsync(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    log = LogWriter(tmp_path / "log.mcap")
    fill(log)
    monkeypatch.setattr("recorders.log.output.os.fsync", fsync)
    with pytest.raises(RecordingError, match="the disk is full"):
        log.close()
    assert list(tmp_path.iterdir()) == []


def test_an_output_whose_part_file_is_still_there_stays_whole(tmp_path: Path) -> None:
    """As a process leaves it that is killed between taking the one name and giving up the other."""
    path = tmp_path / "log.mcap"
    with LogWriter(path) as log:
        fill(log)
    os.link(path, tmp_path / "log.mcap.part")
    whole = path.read_bytes()
    with LogWriter(path, force=True) as log:
        fill(log, 5)
        assert path.read_bytes() == whole
    assert [p.name for p in tmp_path.iterdir()] == ["log.mcap"]
    with LogReader(path) as opened:
        assert opened.message_count == 5


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="there is no folder"):
        LogWriter(tmp_path / "missing" / "log.mcap")
    with pytest.raises(RecordingError, match="this is a folder"):
        LogWriter(tmp_path)


def test_a_closed_writer_says_so(tmp_path: Path) -> None:
    log = LogWriter(tmp_path / "log.mcap")
    fill(log)
    log.close()
    log.close()
    log.abort()
    with pytest.raises(RecordingError, match="closed already"):
        log.metadata("late", {})
    assert (tmp_path / "log.mcap").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ((2, b"", 0), "no channel has the id 2"),
        ((0, b"", 0), "no channel has the id 0"),
        ((1, b"", -1), r"log time -1 and publish time -1 must be in \[0, 2\^64\)"),
        ((1, b"", 1 << 64), "must be in"),
        ((1, b"", 0, 0, 1 << 32), r"sequence 4294967296 in \[0, 2\^32\)"),
    ],
)
def test_values_that_do_not_fit_are_refused(
    tmp_path: Path, arguments: tuple[int, bytes, int], text: str
) -> None:
    log = LogWriter(tmp_path / "log.mcap")
    log.channel("/a", None, "raw")
    with pytest.raises(RecordingError, match=text):
        log.write(*arguments)
    log.abort()


KILLED = """
import sys
from recorders.log import LogWriter
log = LogWriter(sys.argv[1], picture_topics={"/image"}, keep_part=True)
image = log.channel("/image", None, "jpeg")
small = log.channel("/small", None, "json")
k = 0
while True:
    log.write(image, b"p" * 1000, k * 40_000_000)
    log.write(small, b"%d" % k, k * 40_000_000)
    k += 1
    if k == 5000:
        print("far enough", flush=True)
        sys.stdin.read()
"""


def test_a_killed_writer_leaves_everything_up_to_the_last_chunk(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "far enough\n"
    process.send_signal(signal.SIGKILL)
    process.communicate()
    assert not path.exists()
    part = tmp_path / "log.mcap.part"
    with pytest.raises(RecordingError, match="scenetrace recover"):
        LogReader(part)
    before = part.read_bytes()
    report = recover(part, path)
    assert recover(part, path, force=True) == report
    assert part.read_bytes() == before
    assert report.losses[-1].offset == part.stat().st_size
    assert "writer was killed" in report.losses[-1].reason
    with LogReader(path) as log:
        small = [int(m.data) for m in log.messages(["/small"])]
        assert small == list(range(len(small)))
        assert len(small) >= 5000 - 25  # all but the last second of recording
        assert sum(1 for _ in log.messages(["/image"])) >= len(small)
