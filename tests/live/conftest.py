"""What serves streams to the tests."""

from __future__ import annotations

import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

SERVER = Path(__file__).with_name("tcp_server.py")


@pytest.fixture
def free_port() -> int:
    """A port that nobody listens on."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


@pytest.fixture
def serve() -> Iterator[Callable[..., subprocess.Popen[str]]]:
    """Starts a server of MPEG-TS over TCP: port, first number, pictures, rate; all are killed at
    the end.
    """
    running: list[subprocess.Popen[str]] = []

    def start(port: int, first: int, frames: int, fps: int = 25) -> subprocess.Popen[str]:
        words = [sys.executable, str(SERVER), *map(str, (port, first, frames, fps))]
        running.append(subprocess.Popen(words, stdout=subprocess.PIPE, text=True))
        return running[-1]

    yield start
    for one in running:
        one.kill()
        one.wait()
        if one.stdout is not None:
            one.stdout.close()
