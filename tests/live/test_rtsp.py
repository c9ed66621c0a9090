"""A camera that speaks RTSP, by GStreamer's server, killed twice."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import pytest

from fixtures.streams import number_of, write_stream
from recorders.log import LogReader
from recorders.scene import SceneLog

PYTHON = "/usr/bin/python3"
SERVER = Path(__file__).with_name("gst_server.py")
MAIN = "import sys;from replay.cli import main;sys.exit(main(sys.argv[1:]))"


def _lacks() -> str:
    """What is not there of GStreamer's server; empty where all of it is."""
    if shutil.which(PYTHON) is None:
        return f"{PYTHON} is not there"
    code = "import gi; gi.require_version('GstRtspServer', '1.0')"
    done = subprocess.run(
        [PYTHON, "-W", "ignore", "-c", code], capture_output=True, check=False
    )
    return "" if done.returncode == 0 else "GStreamer's RTSP server is not installed"


def _serve(port: int, film: Path) -> subprocess.Popen[str]:
    words = [PYTHON, "-W", "ignore", str(SERVER), str(port), str(film)]
    server = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)
    assert server.stdout is not None
    assert server.stdout.readline() == "ready\n"
    return server


def _end(server: subprocess.Popen[str]) -> None:
    server.kill()
    server.wait()
    assert server.stdout is not None
    server.stdout.close()


def _wait_for_more(out: Path) -> None:
    """Until two seconds of pictures or so have come."""
    part, until = out.with_name(f"{out.name}.part"), time.monotonic() + 60
    before = part.stat().st_size if part.exists() else 0
    while not (part.exists() and part.stat().st_size > before + 100_000):
        assert time.monotonic() < until, "nothing comes"
        time.sleep(0.1)


@pytest.mark.slow
@pytest.mark.skipif(bool(_lacks()), reason=_lacks() or "-")
def test_a_camera_that_goes_away_twice(tmp_path: Path, free_port: int) -> None:
    film = write_stream(tmp_path / "film.mkv", "matroska", 1500, fps=25, gop=10)
    out = tmp_path / "scene.mcap"
    server = _serve(free_port, film)
    address = f"rtsp://me:secret@127.0.0.1:{free_port}/cam"
    words = ["record", address, "--detect", "none", "-o", str(out)]
    recording = subprocess.Popen(
        [sys.executable, "-c", MAIN, *words], stderr=subprocess.PIPE, text=True
    )
    for _ in range(2):
        _wait_for_more(out)
        _end(server)
        time.sleep(3)
        server = _serve(free_port, film)
    _wait_for_more(out)
    recording.send_signal(signal.SIGINT)
    _, said = recording.communicate(timeout=60)
    _end(server)
    assert recording.returncode == 0, said
    assert "secret" not in said
    assert said.count("connection lost") == 2
    assert said.count("connected again") == 2
    assert said.count("a gap of") == 2
    assert "secret" not in out.read_bytes().decode("latin-1")
    with SceneLog(out) as scene:
        frames = [
            (f.time_ns, number_of(f.image)) for f in scene.frames() if f.image is not None
        ]
    # Each connection plays the film from its start: what has come is there without a hole.
    breaks = [k for k, ((_, a), (_, b)) in enumerate(pairwise(frames)) if b != a + 1]
    assert len(breaks) == 2
    for k in breaks:
        assert frames[k + 1][1] <= 10, "from the film's start on"
        assert 2e9 < frames[k + 1][0] - frames[k][0] < 15e9
    steps = [
        b - a for k, ((a, _), (b, _)) in enumerate(pairwise(frames)) if k not in breaks
    ]
    assert max(steps) < 45_000_000
    with LogReader(out) as log:
        assert dict(log.metadata())["scenetrace"]["losses"] == "[]"
