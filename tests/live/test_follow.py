"""Logs read while they are written, and replays that follow them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from threading import Event, Thread
from typing import Any

import pytest

from fixtures.streams import write_stream
from recorders.annotated.reader import AnnotatedLog
from recorders.errors import RecordingError
from recorders.log import LogReader, LogWriter
from recorders.log.growing import GrowingLog
from replay.annotated_writer import replay
from replay.cli import main
from replay.configuration import replay_config
from replay.run import ReplayOptions

MS = 1_000_000
MAIN = "import sys;from replay.cli import main;sys.exit(main(sys.argv[1:]))"


def cli(*words: object, stdin: Any = None) -> subprocess.Popen[str]:
    """The command, running."""
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *map(str, words)],
        stdin=stdin,
        stderr=subprocess.PIPE,
        text=True,
    )


def write(log: LogWriter, first: int, last: int, channels: tuple[int, int]) -> None:
    """Frames of a picture and detections each."""
    for k in range(first, last):
        log.write(channels[0], b"p" * 3000 + bytes([k % 256]), k * 40 * MS)
        log.write(channels[1], b"d%d" % k, k * 40 * MS)


def writer(path: Path) -> tuple[LogWriter, tuple[int, int]]:
    """A log that is written as a live recording is."""
    log = LogWriter(
        path, keep_part=True, picture_topics=["/camera/image"], flush_interval_ns=250 * MS,
        chunk_bytes=20_000,
    )  # fmt: skip
    return log, (
        log.channel("/camera/image", None, "x"),
        log.channel("/camera/detections", None, "json"),
    )


class TestGrowing:
    def test_the_messages_are_those_of_the_finished_log(self, tmp_path: Path) -> None:
        path = tmp_path / "scene.mcap"
        log, channels = writer(path)

        def work() -> None:
            for k in range(0, 200, 5):
                write(log, k, k + 5, channels)
                time.sleep(0.005)
            log.attach("a", "text/plain", b"x")
            log.metadata("m", {"k": "v"})
            log.close()

        thread = Thread(target=work)
        thread.start()
        with GrowingLog(path) as growing:
            found = [(m.topic, m.order, m.sequence, m.data) for m in growing.messages()]
            assert growing.complete
            assert not growing.abandoned
            assert growing.metadata() == [("m", {"k": "v"})]
            assert [a.data for a in growing.attachments()] == [b"x"]
        thread.join()
        with LogReader(path) as whole:
            assert found == [
                (m.topic, m.order, m.sequence, m.data) for m in whole.messages()
            ]
            assert len(found) == 400

    def test_messages_come_before_the_log_ends(self, tmp_path: Path) -> None:
        log, channels = writer(tmp_path / "scene.mcap")
        write(log, 0, 100, channels)
        with GrowingLog(tmp_path / "scene.mcap") as growing:
            messages = growing.messages(["/camera/detections"])
            first = [next(messages).data for _ in range(90)]
            assert first == [b"d%d" % k for k in range(90)]
        log.abort()

    def test_a_writer_that_is_gone(self, tmp_path: Path) -> None:
        log, channels = writer(tmp_path / "scene.mcap")
        write(log, 0, 100, channels)
        log.abort()
        with GrowingLog(tmp_path / "scene.mcap") as growing:
            found = [m.data for m in growing.messages(["/camera/detections"])]
            assert growing.abandoned
        assert found == [b"d%d" % k for k in range(len(found))]
        assert len(found) >= 90

    def test_an_old_part_beside_the_finished_log(self, tmp_path: Path) -> None:
        log, channels = writer(tmp_path / "scene.mcap")
        write(log, 0, 20, channels)
        log.close()
        (tmp_path / "scene.mcap.part").write_bytes(b"what a killed process left")
        with GrowingLog(tmp_path / "scene.mcap") as growing:
            assert len(list(growing.messages())) == 40

    def test_stopped(self, tmp_path: Path) -> None:
        log, channels = writer(tmp_path / "scene.mcap")
        write(log, 0, 100, channels)
        stop = Event()
        with GrowingLog(tmp_path / "scene.mcap", stop=stop) as growing:
            count = 0
            for _ in growing.messages():
                count += 1
                stop.set()
            assert count > 100
            assert not growing.complete
        log.abort()

    def test_nobody_writes_it(self, tmp_path: Path) -> None:
        stop = Event()
        stop.set()
        with pytest.raises(RecordingError, match="nor does anybody write it"):
            GrowingLog(tmp_path / "scene.mcap", stop=stop)

    def test_a_topic_that_begins_late(self, tmp_path: Path) -> None:
        log, channels = writer(tmp_path / "scene.mcap")
        write(log, 0, 100, channels)
        late = log.channel("/late", None, "x")
        log.write(late, b"", 99 * 40 * MS)
        log.close()
        with (
            GrowingLog(tmp_path / "scene.mcap") as growing,
            pytest.raises(
                RecordingError,
                match="begins after the first frames: such a log cannot be followed; replay it once it is complete",
            ),
        ):
            list(growing.messages())

    def test_a_message_that_comes_late(self, tmp_path: Path) -> None:
        log, channels = writer(tmp_path / "scene.mcap")
        write(log, 0, 100, channels)
        write(log, 2, 3, channels)
        log.close()
        with (
            GrowingLog(tmp_path / "scene.mcap") as growing,
            pytest.raises(RecordingError, match="comes after those of"),
        ):
            list(growing.messages())


ANNOTATED = ("tracks", "events", "targets", "graph", "digest", "annotations")


def annotated(path: Path) -> list[tuple[str, int, bytes]]:
    """The annotated messages of a log."""
    topics = [f"/camera/{name}" for name in ANNOTATED]
    with LogReader(path) as log:
        return [(m.topic, m.log_time_ns, m.data) for m in log.messages(topics)]


class TestFollowing:
    def test_it_annotates_while_the_recording_goes_on(self, tmp_path: Path) -> None:
        stream = write_stream(tmp_path / "s.ts", "mpegts", 240, fps=10)
        scene, live = tmp_path / "scene.mcap", tmp_path / "live.mcap"
        following = cli("replay", scene, "--follow", "-o", live)
        recording = cli("record", "-", "-o", scene, stdin=subprocess.PIPE)
        assert recording.stdin is not None
        data = stream.read_bytes()
        os.write(recording.stdin.fileno(), data[: len(data) * 3 // 4])
        part = tmp_path / "live.mcap.part"
        until = time.monotonic() + 60
        while not (part.exists() and part.stat().st_size > 200_000):
            assert time.monotonic() < until, (
                "nothing is annotated before the recording ends"
            )
            time.sleep(0.05)
        with GrowingLog(part) as log:
            tracks = log.messages(["/camera/tracks"])
            assert len([next(tracks) for _ in range(40)]) == 40
        os.write(recording.stdin.fileno(), data[len(data) * 3 // 4 :])
        recording.stdin.close()
        assert recording.wait(timeout=120) == 0, recording.stderr
        _, said = following.communicate(timeout=120)
        assert following.returncode == 0, said
        assert "240 frames" in said
        whole = tmp_path / "whole.mcap"
        config = replay_config("events", assignments=["events.hindsight=false"])
        replay(scene, whole, ReplayOptions(config=config))
        assert annotated(live) == annotated(whole)
        checking = cli("verify", live)
        checking.communicate(timeout=120)
        assert checking.returncode == 0
        for process in (following, recording):
            assert process.stderr is not None
            process.stderr.close()

    @pytest.mark.parametrize("tracker", ["shells", "parts"])
    def test_other_trackers(self, tmp_path: Path, tracker: str) -> None:
        from recorders.recording import record
        from recorders.sources import open_source

        scene = tmp_path / "scene.mcap"
        record(open_source(write_stream(tmp_path / "s.mkv", "matroska", 60)), scene)
        config = replay_config(tracker, assignments=[f"{tracker}.hindsight=false"])
        options = ReplayOptions(tracker, config)
        replay(scene, tmp_path / "whole.mcap", options)
        following = ReplayOptions(tracker, config, follow=Event())
        done = replay(scene, tmp_path / "live.mcap", following)
        assert done.ended
        assert annotated(tmp_path / "live.mcap") == annotated(tmp_path / "whole.mcap")

    def test_an_interrupt_leaves_a_log_that_can_be_verified(self, tmp_path: Path) -> None:
        from recorders.recording import record
        from recorders.sources import open_source

        whole = tmp_path / "whole.mcap"
        record(open_source(write_stream(tmp_path / "s.mkv", "matroska", 150)), whole)
        # The first part of it, held open as a recorder would.
        part = tmp_path / "scene.mcap.part"
        code = (
            "import fcntl,sys,time\n"
            f"data = open({str(whole)!r}, 'rb').read()\n"
            f"f = open({str(part)!r}, 'wb'); fcntl.flock(f, fcntl.LOCK_EX)\n"
            "f.write(data[: len(data) * 3 // 4]); f.flush(); time.sleep(60)\n"
        )
        holder = subprocess.Popen([sys.executable, "-c", code])
        live = tmp_path / "live.mcap"
        following = cli("replay", tmp_path / "scene.mcap", "--follow", "-o", live)
        beside = tmp_path / "live.mcap.part"
        until = time.monotonic() + 60
        while not (beside.exists() and beside.stat().st_size > 200_000):
            assert time.monotonic() < until
            time.sleep(0.05)
        following.send_signal(signal.SIGINT)
        _, said = following.communicate(timeout=60)
        holder.kill()
        holder.wait()
        assert following.returncode == 0, said
        with AnnotatedLog(live) as log:
            assert sum(1 for _ in log.frames()) > 50
        checking = cli("verify", live, "--scene", whole)
        _, said = checking.communicate(timeout=60)
        assert checking.returncode == 0, said

    def test_what_needs_the_whole_is_refused(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str]
    ) -> None:
        out = str(tmp_path / "o.mcap")
        for words in (["--to", "5"], ["--checkpoint", "1"], ["--against", "x.mcap"]):
            assert main(["replay", "x.mcap", "--follow", "-o", out, *words]) == 2
            said = capsys.readouterr().err
            assert f"{words[0]} needs a recording that is complete" in said
