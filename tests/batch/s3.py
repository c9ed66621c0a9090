"""An S3 server on loopback behind a door that can be shut."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any, Self

_START_S = 120.0


class Proxy:
    """Passes connections on to a port; shut, it ends them and every new one.

    Attributes:
        port: where it listens.
        refused: connections that were ended.
    """

    def __init__(self, to: int) -> None:
        self._to = to
        self._lock = threading.Lock()
        self._pairs: list[tuple[socket.socket, socket.socket]] = []
        self._is_open = True
        self._listener = socket.create_server(("127.0.0.1", 0), backlog=64)
        self.port = self._listener.getsockname()[1]
        self.refused = 0
        threading.Thread(target=self._serve, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.shut()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()

    def open(self) -> None:
        """Let connections through."""
        with self._lock:
            self._is_open = True

    def shut(self) -> None:
        """End every connection."""
        with self._lock:
            self._is_open = False
            pairs, self._pairs = self._pairs, []
            self.refused += len(pairs)
        for pair in pairs:
            _end(*pair)

    def _serve(self) -> None:
        while True:
            try:
                here, _ = self._listener.accept()
            except OSError:
                return
            if not self._take(here):
                _end(here)

    def _take(self, here: socket.socket) -> bool:
        """Whether a connection is passed on."""
        with self._lock:
            if not self._is_open:
                self.refused += 1
                return False
            try:
                there = socket.create_connection(("127.0.0.1", self._to))
            except OSError:
                return False
            self._pairs.append((here, there))
        for one, other in ((here, there), (there, here)):
            threading.Thread(target=self._pass, args=(one, other), daemon=True).start()
        return True

    def _pass(self, one: socket.socket, other: socket.socket) -> None:
        with suppress(OSError):
            while data := one.recv(1 << 16):
                other.sendall(data)
        with self._lock:
            self._pairs = [pair for pair in self._pairs if one not in pair]
        _end(one, other)


def _end(*ends: socket.socket) -> None:
    for end in ends:
        with suppress(OSError):
            end.shutdown(socket.SHUT_RDWR)
        end.close()


@contextmanager
def s3_server(folder: Path) -> Iterator[tuple[Proxy, dict[str, str]]]:
    """Run a server.

    Args:
        folder: gets what it prints.

    Yields:
        the door, and the environment of the server's clients.
    """
    with closing(socket.socket()) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with (folder / "server.txt").open("w") as log:
        server = subprocess.Popen(
            [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)],
            stdout=log,
            stderr=log,
            env={**os.environ, "PYTHONPATH": ""},
        )
    try:
        end = time.monotonic() + _START_S
        while not _answers(port):
            assert time.monotonic() < end, "the S3 server did not start"
            time.sleep(0.1)
        with Proxy(port) as proxy:
            names = {
                "AWS_ENDPOINT_URL": f"http://127.0.0.1:{proxy.port}",
                "AWS_ACCESS_KEY_ID": "of-nobody",
                "AWS_SECRET_ACCESS_KEY": "of-nobody",
            }
            yield proxy, names
    finally:
        server.terminate()
        server.wait()


def _answers(port: int) -> bool:
    with closing(socket.socket()) as tried:
        return tried.connect_ex(("127.0.0.1", port)) == 0


def bucket(environment: dict[str, str], name: str) -> Any:
    """The server's files, by fsspec, with a new bucket."""
    import s3fs

    files = s3fs.S3FileSystem(
        key=environment["AWS_ACCESS_KEY_ID"],
        secret=environment["AWS_SECRET_ACCESS_KEY"],
        client_kwargs={"endpoint_url": environment["AWS_ENDPOINT_URL"]},
        use_listings_cache=False,
    )
    files.mkdir(name)
    return files
