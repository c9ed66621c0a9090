"""How soon a live picture is annotated: `record tcp://...` and `replay --follow` at a camera's rate,
latency of every frame and the processor that both take.

A film is sent in real time over TCP. Times in the log are this computer's clock when the picture
came, so that a frame's latency is when its message can be read from the growing log, less its own
time. *recorded*: in the scene log; *annotated*: in the annotated one. What a loaded machine does
to the clock, the processor's share does not know: both are printed.

Run: ``python tests/benchmarks/bench_follow.py [--seconds 120] [--last 40] [--fps 25] [--tracker events]``
"""

from __future__ import annotations

import argparse
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
PICTURES = (
    Path(os.environ.get("SCENETRACE_DATA", ROOT.parent / "shared" / "data"))
    / "pets09-s2l1"
    / "img1"
)
MAIN = "import sys;from replay.cli import main;sys.exit(main(sys.argv[1:]))"
TICKS = os.sysconf("SC_CLK_TCK")


def film(path: Path, seconds: int, fps: int) -> Path:
    """PETS to and fro (or numbered pictures where it is not there), as a camera encodes it."""
    import av
    import cv2

    from fixtures.streams import numbered

    names = sorted(PICTURES.glob("*.jpg"))
    with av.open(str(path), "w", format="mpegts") as out:
        options = {"bf": "0", "preset": "ultrafast", "tune": "zerolatency"}
        stream: Any = out.add_stream("libx264", rate=fps, options=options)
        stream.pix_fmt, stream.gop_size = "yuv420p", fps
        for k in range(seconds * fps):
            turn = k % max(1, 2 * len(names) - 2)
            at = turn if turn < len(names) else 2 * len(names) - 2 - turn
            image: Any = cv2.imread(str(names[at])) if names else numbered(k)
            if k == 0:
                stream.height, stream.width = image.shape[:2]
            out.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        out.mux(stream.encode(None))
    return path


def send(source: Path, port: int, fps: int) -> None:
    """The film's packets, each when its picture is taken."""
    import av

    address = f"tcp://127.0.0.1:{port}?listen=1"
    with av.open(str(source)) as film_, av.open(address, "w", format="mpegts") as out:
        stream = out.add_stream_from_template(film_.streams.video[0])
        began = time.monotonic()
        for number, packet in enumerate(film_.demux(film_.streams.video[0])):
            if packet.dts is None:
                continue
            packet.stream = stream
            time.sleep(max(0.0, began + number / fps - time.monotonic()))
            out.mux(packet)


def cli(*words: object) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", MAIN, *map(str, words)], stderr=subprocess.PIPE, text=True
    )


def processor_s(process: subprocess.Popen[str]) -> float:
    """What a process and its children that ended took so far."""
    try:
        fields = Path(f"/proc/{process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    except OSError:
        return 0.0
    return sum(map(int, fields[11:15])) / TICKS


class Arrivals(Thread):
    """When each message of a topic can be read from a growing log."""

    def __init__(self, path: Path, topic: str, stop: Event) -> None:
        super().__init__(daemon=True)
        self._path, self._topic, self._stopped = path, topic, stop
        self.late_s: list[float] = []

    def run(self) -> None:
        from recorders.log.growing import GrowingLog

        with GrowingLog(self._path, stop=self._stopped) as log:
            for message in log.messages([self._topic]):
                self.late_s.append(time.time() - message.log_time_ns / 1e9)


def line(name: str, late_s: list[float], last: int) -> str:
    """Latencies of the last frames: recording begins once its first 15 s were looked through, and
    then catches up with the camera.
    """
    late = np.array(late_s[-last:])
    if not late.size:
        return f"{name:10} nothing came"
    p50, p90, p99 = np.percentile(late, [50, 90, 99])
    within = np.mean(late < 1.0)
    return (
        f"{name:10} {late.size} frames: p50 {p50:.2f} s, p90 {p90:.2f} s, p99 {p99:.2f} s,"
        f" at most {late.max():.2f} s; within a second {within:.1%}"
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n\n")[0])
    parser.add_argument("--seconds", type=int, default=120)
    parser.add_argument(
        "--last", type=int, default=40, help="seconds at the end that are judged (40)"
    )
    parser.add_argument("--fps", type=int, default=25)
    parser.add_argument("--tracker", default="events")
    parser.add_argument("--detect", default="motion")
    parser.add_argument("--send", metavar="FILM:PORT:FPS", help="be the camera")
    args = parser.parse_args()
    sys.path.insert(0, str(ROOT))  # the film's numbered pictures lie beside the tests
    if args.send:
        source, port, fps = args.send.rsplit(":", 2)
        send(Path(source), int(port), int(fps))
        return 0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        path = film(folder / "film.ts", args.seconds, args.fps)
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            free = int(probe.getsockname()[1])
            camera = subprocess.Popen(
                [sys.executable, __file__, "--send", f"{path}:{free}:{args.fps}"]
            )
        time.sleep(1)
        scene, live = folder / "scene.mcap", folder / "live.mcap"
        recording = cli(
            "record", f"tcp://127.0.0.1:{free}", "--detect", args.detect, "-o", scene
        )
        following = cli("replay", scene, "--follow", "--tracker", args.tracker, "-o", live)
        stop = Event()
        recorded = Arrivals(scene, "/camera/detections", stop)
        annotated = Arrivals(live, "/camera/tracks", stop)
        recorded.start()
        annotated.start()
        began, before = time.monotonic(), (0.0, 0.0)
        while camera.poll() is None and time.monotonic() < began + 3 * args.seconds + 60:
            time.sleep(0.5)
            used = processor_s(recording), processor_s(following)
            before = used if any(used) else before
        stop_at = time.monotonic()
        camera.kill()
        camera.wait()
        recording.send_signal(signal.SIGINT)
        for process in (recording, following):
            process.communicate(timeout=600)
        stop.set()
        recorded.join(30)
        annotated.join(30)
    for name_, arrivals in (("recorded", recorded), ("annotated", annotated)):
        print(line(name_, arrivals.late_s, args.last * args.fps))
    span = stop_at - began
    print(
        f"processor: record {before[0] / span:.2f}, replay --follow {before[1] / span:.2f} of a"
        f" core at {args.fps}/s; load {os.getloadavg()[0]:.0f} on {os.cpu_count()} cores"
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
