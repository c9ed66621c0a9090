"""Live sources: pipes, lost connections, drops, the clock."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path
from threading import Thread
from typing import Any

import pytest

from fixtures.streams import number_of, write_stream
from recorders.errors import SourceError, UsageError
from recorders.limits import DEFAULT_LIMITS
from recorders.log import LogReader
from recorders.recording import RecordOptions, record
from recorders.scene import SceneLog
from recorders.sources import live_feed, open_source
from recorders.sources.live import LiveSource, _Times
from recorders.sources.live_feed import safe_address
from replay.cli import main

MS = 1_000_000


def cli(*words: str, stdin: Any = None) -> subprocess.CompletedProcess[str]:
    """The command, run to its end."""
    return subprocess.run(
        [sys.executable, "-c", "import sys;from replay.cli import main;sys.exit(main(sys.argv[1:]))", *words],
        stdin=stdin, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


def start(*words: str, **options: Any) -> subprocess.Popen[str]:
    """The command, running."""
    return subprocess.Popen(
        [sys.executable, "-c", "import sys;from replay.cli import main;sys.exit(main(sys.argv[1:]))", *words],
        stderr=subprocess.PIPE, text=True, **options,
    )  # fmt: skip


def numbers(path: Path) -> list[int]:
    """The numbers that a log's pictures say."""
    with SceneLog(path) as scene:
        return [number_of(f.image) for f in scene.frames() if f.image is not None]


def facts(path: Path) -> dict[str, str]:
    """What a log says of itself."""
    with LogReader(path) as log:
        return dict(log.metadata())["scenetrace"]


class TestPipes:
    @pytest.mark.parametrize(
        ("kind", "codec", "words"),
        [
            ("h264", "libx264", ["--fps", "10"]),
            ("mjpeg", "mjpeg", ["--fps", "10"]),
            ("matroska", "libx264", []),
            ("mpegts", "libx264", []),
        ],
    )
    def test_every_picture_is_recorded(
        self, tmp_path: Path, kind: str, codec: str, words: list[str]
    ) -> None:
        stream = write_stream(tmp_path / "s", kind, 60, fps=10, codec=codec)
        out = tmp_path / "scene.mcap"
        with stream.open("rb") as pipe:
            done = cli("record", "-", "-o", str(out), *words, stdin=pipe)
        assert done.returncode == 0, done.stderr
        assert "60 frames of 192x96 over 5.9 s" in done.stderr
        assert numbers(out) == list(range(60))

    def test_an_assumed_rate_is_said(self, tmp_path: Path) -> None:
        stream = write_stream(tmp_path / "s", "h264", 30)
        with stream.open("rb") as pipe:
            done = cli("record", "-", "--detect", "none", "-o", str(tmp_path / "o.mcap"), stdin=pipe)  # fmt: skip
        assert "assuming 25 frames per second; say it with --fps" in done.stderr

    def test_what_is_no_video_is_refused(self, tmp_path: Path) -> None:
        (tmp_path / "s").write_bytes(b"no video at all\n" * 100)
        with (tmp_path / "s").open("rb") as pipe:
            done = cli("record", "-", "-o", str(tmp_path / "o.mcap"), stdin=pipe)
        assert done.returncode == 1
        assert "standard input" in done.stderr or "-: no video" in done.stderr
        assert not list(tmp_path.glob("o.mcap*"))

    @pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
    def test_an_interrupt_ends_the_log_well(self, tmp_path: Path, number: int) -> None:
        stream = write_stream(tmp_path / "s", "mpegts", 100)
        out = tmp_path / "scene.mcap"
        running = start("record", "-", "--detect", "none", "-o", str(out), stdin=subprocess.PIPE)  # fmt: skip
        assert running.stdin is not None
        os.write(running.stdin.fileno(), stream.read_bytes())  # and the pipe stays open
        part = tmp_path / "scene.mcap.part"
        _wait_for(lambda: part.exists() and part.stat().st_size > 100_000)
        running.send_signal(number)
        _, said = running.communicate(timeout=60)
        assert running.returncode == 0, said
        found = numbers(out)
        assert len(found) >= 20
        assert found == list(range(len(found)))
        assert not part.exists()


class TestSegments:
    @pytest.mark.parametrize("codec", ["jpeg", "h264"])
    def test_each_stands_alone(self, tmp_path: Path, codec: str) -> None:
        stream = write_stream(tmp_path / "s.mkv", "matroska", 60, fps=10)
        regions = tmp_path / "regions.json"
        regions.write_text(json.dumps({"roi": [[0, 0], [191, 0], [191, 95], [0, 95]]}))
        out = tmp_path / "scene.mcap"
        done = cli(
            "record", str(stream), "--segment", "2s", "--codec", codec, "--regions",
            str(regions), "-o", str(out),
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        logs = sorted(tmp_path.glob("scene-*.mcap"))
        assert [log.name for log in logs] == [f"scene-000{k}.mcap" for k in (1, 2, 3)]
        assert "3 logs" in done.stderr
        for k, log in enumerate(logs):
            assert numbers(log) == list(range(20 * k, 20 * k + 20))
            with SceneLog(log) as scene:
                frames = list(scene.frames())
                assert [f.detections.frame for f in frames] == list(range(20))
                assert frames[0].time_ns == 2_000_000_000 * k
                assert frames[0].regions is not None
            assert facts(log)["frames"] == "20"
            assert main(["replay", str(log), "-o", f"{log}.out"]) == 0

    def test_an_old_segment_is_not_overwritten(self, tmp_path: Path) -> None:
        stream = write_stream(tmp_path / "s.mkv", "matroska", 20, fps=10)
        (tmp_path / "scene-0003.mcap").write_bytes(b"")
        done = cli(
            "record", str(stream), "--segment", "1s", "-o", str(tmp_path / "scene.mcap")
        )
        assert done.returncode == 1
        assert "scene-0003.mcap exists already" in done.stderr

    @pytest.mark.parametrize("word", ["0", "ten", "-1s", "5 weeks"])
    def test_no_length_of_time(
        self, tmp_path: Path, capsys: pytest.CaptureFixture[str], word: str
    ) -> None:
        out = str(tmp_path / "o.mcap")
        assert main(["record", "v.mp4", f"--segment={word}", "-o", out]) == 2
        assert "10min" in capsys.readouterr().err


class TestNetwork:
    def test_a_server_killed_twice(
        self, tmp_path: Path, serve: Any, free_port: int
    ) -> None:
        port = free_port
        out = tmp_path / "scene.mcap"
        told: list[str] = []
        first = serve(port, 0, 500)
        source = _opened(f"tcp://127.0.0.1:{port}")
        source.listen(told.append)
        done: list[Any] = []
        options = RecordOptions(detect="none")
        thread = Thread(target=lambda: done.append(record(source, out, options)))
        thread.start()
        dying = first
        for number in (1000, 2000):
            time.sleep(2)
            dying.kill()
            time.sleep(2.5)
            dying = serve(port, number, 500)
            _wait_for(
                lambda n=number: sum("connected again" in t for t in told) == n // 1000
            )
        time.sleep(2)
        source.stop()
        thread.join(timeout=30)
        assert done, "the recording has ended"
        found = numbers(out)
        parts = [[n for n in found if n // 1000 == k] for k in range(3)]
        for k, part in enumerate(parts):
            assert len(part) > 10
            # Joined in the middle, from a key frame on; then without a hole.
            assert part == list(range(part[0], part[0] + len(part)))
            assert part[0] - 1000 * k <= 75
        assert found == sorted(found)
        assert sum("connection lost" in line for line in told) == 2
        notes = json.loads(facts(out)["notes"])
        assert "the connection was lost 2 times" in notes
        gaps = [note for note in notes if note.startswith("a gap of")]
        assert len(gaps) == 2
        for gap in gaps:
            assert 2.0 < float(gap.split()[3]) < 12
        assert facts(out)["losses"] == "[]"

    def test_nobody_there(self, tmp_path: Path, free_port: int) -> None:
        address = f"tcp://admin:secret@127.0.0.1:{free_port}"
        done = cli("record", address, "-o", str(tmp_path / "o.mcap"))
        assert done.returncode == 1
        assert "cannot be reached" in done.stderr
        assert "secret" not in done.stderr
        assert not list(tmp_path.iterdir())

    def test_drops_are_counted_and_start_again_at_a_key_frame(
        self, serve: Any, free_port: int, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        monkeypatch.setattr(live_feed, "MOST_HELD_BYTES", 4_000)
        port = free_port
        serve(port, 0, 120, 50)
        source = _opened(f"tcp://127.0.0.1:{port}")
        told: list[str] = []
        source.listen(told.append)
        found: list[int] = []
        for frame in source.frames():
            if not found:
                time.sleep(1.5)
            assert frame.image is not None
            found.append(number_of(frame.image))
            if found[-1] >= 118:
                source.stop()
        source.digests()
        assert any("pictures are dropped" in line for line in told)
        (loss,) = source.losses
        dropped = int(loss.split()[0])
        assert dropped > 5
        holes = [(a, b) for a, b in pairwise(found) if b != a + 1]
        assert sum(b - a - 1 for a, b in holes) == dropped
        assert all(b % 5 == 0 for _, b in holes), "every fifth picture is a key frame"


class TestAddresses:
    @pytest.mark.parametrize(
        "word", ["gopher://host/x", "file:///etc/passwd", "concat:a|b://x", "://"]
    )
    def test_other_schemes_are_refused(self, word: str) -> None:
        with pytest.raises(UsageError, match="live sources are rtsp"):
            open_source(word)

    def test_passwords_are_not_told(self) -> None:
        assert safe_address("rtsp://a:b@c@host/x?y=1") == "rtsp://host/x?y=1"

    def test_a_rate_is_not_for_what_is_live(self, serve: Any, free_port: int) -> None:
        port = free_port
        serve(port, 0, 100)
        with pytest.raises(UsageError, match="have the times at which they come"):
            _opened(f"tcp://127.0.0.1:{port}", 25)


class TestTimes:
    """A stream's stamps and this computer's clock."""

    def times(self, *pairs: tuple[int, int], pipe: bool = False) -> list[int]:
        made = _Times(40 * MS)
        return [made.next(a * MS, b * MS, pipe) // MS for a, b in pairs]

    def test_stamps_count_however_late_they_come(self) -> None:
        assert self.times((0, 5), (40, 900), (80, 901), (120, 902)) == [0, 40, 80, 120]

    def test_an_outage_is_as_long_as_it_was(self) -> None:
        assert self.times((0, 0), (40, 40), (9000, 9000)) == [0, 40, 9000]

    def test_a_clock_that_was_set_forward(self) -> None:
        assert self.times((0, 0), (40, 40), (3_600_080, 80), (3_600_120, 120)) == [0, 40, 80, 120]  # fmt: skip

    def test_a_clock_that_was_set_back(self) -> None:
        assert self.times((50_000, 0), (50_040, 40), (10, 80), (50, 120)) == [
            0,
            40,
            80,
            120,
        ]

    def test_equal_stamps_still_increase(self) -> None:
        found = self.times((0, 0), (40, 40), (40, 80), (40, 120), (120, 160))
        assert found == [0, 40, 50, 60, 120]

    def test_a_pipe_has_its_stamps_alone(self) -> None:
        assert self.times((0, 0), (40, 0), (9000, 1), pipe=True) == [0, 40, 9000]


def _opened(address: str, fps: int | None = None) -> LiveSource:
    """The source, once its server listens."""
    until = time.monotonic() + 20
    while True:
        try:
            return LiveSource(address, fps, DEFAULT_LIMITS)
        except SourceError:
            if time.monotonic() > until:
                raise
            time.sleep(0.2)


def _wait_for(what: Any, seconds: float = 40) -> None:
    until = time.monotonic() + seconds
    while not what():
        assert time.monotonic() < until, "waited too long"
        time.sleep(0.02)


@pytest.mark.parametrize(
    ("number", "told"),
    [
        (errno.ENOENT, "no such camera: "),
        (errno.EACCES, "the group `video` is"),
        (errno.EBUSY, "another program uses the camera"),
        (errno.ENOTTY, "no camera that gives pictures"),
        (errno.EIO, "the camera cannot be opened"),
    ],
)
def test_a_camera_that_cannot_be_opened_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, number: int, told: str
) -> None:
    def refuse(*_: Any, **options: Any) -> None:
        assert options["format"] == "v4l2"
        raise OSError(number, os.strerror(number), "/dev/video7")

    monkeypatch.setattr("av.open", refuse)
    with pytest.raises(SourceError, match="/dev/video7: ") as failed:
        open_source("/dev/video7")
    assert told in str(failed.value)
