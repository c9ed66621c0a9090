"""A headless browser driven by the W3C WebDriver protocol over plain HTTP (no package needed,
only chromedriver), and a small annotated log with pictures, written message by message.
"""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recorders import channels
from recorders.log import LogWriter
from recorders.messages import Detections, Event, Groups, Relation, Relations, Track, Tracks
from recorders.pictures import encode_jpeg

_READY = "return document.documentElement.dataset.ready === 'true'"


class Browser:
    """One session of headless Chromium."""

    def __init__(self, port: int, binary: str, profile: Path) -> None:
        self._base = f"http://127.0.0.1:{port}"
        offline = "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1"
        quiet = [
            "--headless=new",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--no-first-run",
        ]
        arguments = [*quiet, f"--user-data-dir={profile}", offline]
        wanted = {
            "goog:chromeOptions": {"binary": binary, "args": arguments},
            "goog:loggingPrefs": {"browser": "ALL"},
        }
        answer = self._call("POST", "/session", {"capabilities": {"alwaysMatch": wanted}})
        self._session = f"/session/{answer['sessionId']}"

    def _call(self, method: str, path: str, body: Any = None) -> Any:
        data = None if body is None else json.dumps(body).encode()
        request = urllib.request.Request(
            self._base + path, data, {"Content-Type": "application/json"}, method=method
        )
        try:
            with urllib.request.urlopen(request, timeout=60) as answer:
                return json.load(answer)["value"]
        except urllib.error.HTTPError as e:
            raise AssertionError(e.read().decode(errors="replace")[:500]) from e

    def open(self, page: Path) -> None:
        self.visit(page.resolve().as_uri())

    def visit(self, url: str) -> None:
        self._call("POST", f"{self._session}/url", {"url": url})
        self.wait(_READY)

    def run(self, script: str, *args: Any) -> Any:
        return self._call(
            "POST", f"{self._session}/execute/sync", {"script": script, "args": list(args)}
        )

    def wait(self, script: str, seconds: float = 30.0) -> None:
        end = time.monotonic() + seconds
        while not self.run(script):
            assert time.monotonic() < end, f"never true: {script}\n{self.console()}"
            time.sleep(0.05)

    def size(self, width: int, height: int, *, dark: bool = False) -> None:
        self.devtools(
            "Emulation.setDeviceMetricsOverride",
            {
                "width": width,
                "height": height,
                "deviceScaleFactor": 1,
                "mobile": width < 600,
            },
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.devtools("Emulation.setEmulatedMedia", {"features": [scheme]})

    def devtools(self, command: str, parameters: dict[str, Any]) -> Any:
        return self._call(
            "POST",
            f"{self._session}/goog/cdp/execute",
            {"cmd": command, "params": parameters},
        )

    def click_at(self, x: float, y: float) -> None:
        """A real click of the mouse, at a place in the window."""
        for kind, buttons in (("mouseMoved", 0), ("mousePressed", 1), ("mouseReleased", 0)):
            self.devtools(
                "Input.dispatchMouseEvent",
                {
                    "type": kind,
                    "x": x,
                    "y": y,
                    "button": "left",
                    "buttons": buttons,
                    "clickCount": 1,
                },
            )
            time.sleep(0.15)

    def console(self) -> list[str]:
        found = self._call("POST", f"{self._session}/se/log", {"type": "browser"})
        return [
            f"{m['level']}: {m['message']}"
            for m in found
            if m["level"] in ("SEVERE", "WARNING")
        ]

    def picture(self, out: Path) -> None:
        whole = {"captureBeyondViewport": True, "format": "png"}
        out.write_bytes(
            base64.b64decode(self.devtools("Page.captureScreenshot", whole)["data"])
        )

    def close(self) -> None:
        self._call("DELETE", self._session)


@pytest.fixture(scope="session")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    driver, binary = (
        shutil.which("chromedriver"),
        shutil.which("chromium") or shutil.which("google-chrome"),
    )
    if driver is None or binary is None:
        pytest.skip(
            "needs chromium and chromedriver (apt-get install chromium chromium-driver)"
        )
    folder = tmp_path_factory.mktemp("browser")
    with (folder / "driver.log").open("w") as told:
        process = subprocess.Popen(
            [driver, "--port=0"], stdout=subprocess.PIPE, stderr=told, text=True
        )
        try:
            port = 0
            assert process.stdout is not None
            for line in process.stdout:
                if "started successfully on port" in line:
                    port = int(line.rsplit(" ", 1)[1].rstrip(".\n"))
                    break
            session = Browser(port, binary, folder / "profile")
            try:
                yield session
            finally:
                session.close()
        finally:
            process.terminate()
            process.wait(timeout=20)
            if process.stdout is not None:
                process.stdout.close()


FRAME_NS = 100_000_000


def _track(i: int, n: int) -> Track:
    return Track(
        id=i, box=(10.0 + (n if i == 1 else 60 - n), 20.0, 10.0, 30.0), ellipse=None, velocity=(10.0, 0.0),
        shell_radius=15.0, mode="motion", confidence=1.0, present=True, observed=True, blob=-1, grouping=False,
        grouped=False, splitting=False, grouping_partners=[], grouped_partners=[], splitting_partners=[], group=None,
        scene="inside",
    )  # fmt: skip


def _write_yard(path: Path, output_digest: str = "abc") -> Path:
    with LogWriter(path, picture_topics=["/camera/image"]) as out:
        names = ("image", "detections", "tracks", "relations", "groups", "events")
        ids = {n: out.channel(channels.topic("camera", n), channels.schema(n), channels.message_encoding(n))
               for n in names}  # fmt: skip
        for n in range(50):
            t = n * FRAME_NS
            picture = encode_jpeg(np.full((60, 80, 3), 4 * n, np.uint8))
            related = (
                [Relation(1, 2, "INTERACTION", 15, 15 * FRAME_NS, False, False, False, 0.2)]
                if 15 <= n < 40
                else []
            )
            out.write(
                ids["image"], channels.compressed_image(picture, "jpeg", t, "camera"), t
            )
            out.write(
                ids["detections"], channels.encode("detections", Detections(n, 80, 60)), t
            )
            out.write(
                ids["tracks"],
                channels.encode("tracks", Tracks(n, [_track(1, n), _track(2, n)])),
                t,
            )
            out.write(
                ids["relations"], channels.encode("relations", Relations(n, related)), t
            )
            out.write(ids["groups"], channels.encode("groups", Groups(n)), t)
            if n == 15:
                evidence = {
                    "case": "II",
                    "after": "INTERACTION",
                    "shell_gap_px": -1.5,
                    "shell_gap_px_at_most": 0.0,
                    "safety_distance": 1.25,
                    "safety_distance_at_most": 1.0,
                }
                event = Event(
                    1,
                    "interaction_started",
                    [1, 2],
                    n,
                    t,
                    "SHELLS 2.3 case II",
                    evidence,
                    "\x1b[31mThey meet",
                )
                out.write(ids["events"], channels.encode("events", event), t)
        out.metadata(
            "scenetrace",
            {
                "tracker": "events",
                "configuration": '{"a": {"b": 1}}',
                "output_digest": output_digest,
            },
        )
    return path


@pytest.fixture(scope="session")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return _write_yard(tmp_path_factory.mktemp("commands") / "yard.mcap")


@pytest.fixture
def other_log(tmp_path: Path) -> Path:
    """The same scene as another recording."""
    return _write_yard(tmp_path / "garden.mcap", "def")
