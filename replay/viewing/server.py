"""HTTP on this machine's own address, behind a token that is part of every address.

Without the token there is nothing here, so no other page in the browser can read or write; a name
that is not this machine's own (a rebound one) is refused; nothing is written without ``edit``.
"""

from __future__ import annotations

import hmac
import re
import secrets
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import msgspec

from replay.viewing.asking import answer
from replay.viewing.desk import Desk

HOST = "127.0.0.1"
_MOST_BODY = 64 << 10
_BLOCK = 1 << 20
_TYPES = {"html": "text/html; charset=utf-8", "json": "application/json"}
_HEADERS = {
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    # What the page may do stands in it; this is what others may do with it.
    "Content-Security-Policy": "frame-ancestors 'none'",
}


class DeskServer(ThreadingHTTPServer):
    """Serves a desk.

    Args:
        desk: what is served.
        port: 0: any that is free.

    Attributes:
        url: where the page is; its last part is the token.

    Raises:
        OSError: the port is taken.
    """

    daemon_threads = True

    def __init__(self, desk: Desk, port: int = 0) -> None:
        super().__init__((HOST, port), _Handler)
        self.desk = desk
        self.token = secrets.token_urlsafe(24)
        self.hosts = {f"{name}:{self.server_port}" for name in (HOST, "localhost")}
        self.url = f"http://{HOST}:{self.server_port}/{self.token}/"

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that goes away in the middle of an answer is no error."""


class _Handler(BaseHTTPRequestHandler):
    server: DeskServer
    protocol_version = "HTTP/1.1"
    server_version = "scenetrace"
    sys_version = ""
    timeout = 60

    def log_message(self, format: str, *args: Any) -> None:  # noqa: A002
        """Say nothing: the token stands in every line."""

    def do_GET(self) -> None:
        """Look."""
        place = self._place()
        if place is None:
            return
        desk = self.server.desk
        if place == "":
            self._send(200, "html", desk.html().encode())
        elif match := re.fullmatch(r"frame/(\d{1,10})", place):
            self._json(desk.frame(int(match[1])))
        elif match := re.fullmatch(r"picture/(\d{1,10})\.jpg", place):
            data = desk.picture(int(match[1]))
            if data is None:
                self._json({"error": "no picture at this frame"}, 404)
            else:
                self._send(
                    200, "image/jpeg", data, {"Cache-Control": "private, max-age=3600"}
                )
        elif place == "recording.mcap":
            self._file(desk.path)
        else:
            self._json({"error": "there is nothing here"}, 404)

    do_HEAD = do_GET  # noqa: N815

    def do_POST(self) -> None:
        """Ask, or write."""
        place = self._place()
        if place is None:
            return
        desk = self.server.desk
        acts: dict[str, Callable[[Any], dict[str, Any]]] = {
            "note": desk.note,
            "correct": desk.correct,
            "query": self._query,
        }
        if place not in acts:
            self._json({"error": "there is nothing here"}, 404)
            return
        body = self._body()
        if body is not None:
            said = acts[place](body)
            refused = place != "query" and not desk.edit
            self._json(said, 403 if refused else 400 if "error" in said else 200)

    def _query(self, body: Any) -> dict[str, Any]:
        sql = body.get("sql") if isinstance(body, dict) else None
        if not isinstance(sql, str) or not sql.strip() or "\0" in sql:
            return {"error": "give one SELECT"}
        return answer(self.server.desk.path, sql)

    def _place(self) -> str | None:
        """What is asked for below the token; None where it was refused."""
        if self.headers.get("Host", "") not in self.server.hosts:
            self._json({"error": "this is for this machine alone"}, 403)
            return None
        own = {f"http://{host}" for host in self.server.hosts}
        if self.headers.get("Origin") not in (None, *own):
            self._json({"error": "not from another page"}, 403)
            return None
        token, slash, place = self.path.partition("?")[0].lstrip("/").partition("/")
        if not hmac.compare_digest(token.encode(), self.server.token.encode()) or not slash:
            self._json(
                {"error": "the address lacks its token: take it as it was printed"}, 403
            )
            return None
        return place

    def _body(self) -> Any:
        """The request's JSON; None where it was refused."""
        length = self.headers.get("Content-Length", "")
        kind = self.headers.get("Content-Type", "").partition(";")[0].strip().lower()
        if kind != "application/json" or not re.fullmatch(r"\d{1,6}", length):
            self._json({"error": "JSON with its length is wanted"}, 415)
        elif int(length) > _MOST_BODY:
            self._json({"error": f"over {_MOST_BODY} bytes"}, 413)
        else:
            try:
                return msgspec.json.decode(self.rfile.read(int(length)))
            except (msgspec.DecodeError, RecursionError):
                self._json({"error": "not JSON"}, 400)
        self.close_connection = True
        return None

    def _file(self, path: Path) -> None:
        """A file, or the range of it that is asked for."""
        size = path.stat().st_size
        span = _range(self.headers.get("Range", ""), size)
        if span is None:
            self._send(416, "json", b"", {"Content-Range": f"bytes */{size}"})
            return
        first, last, partial = span
        more = {"Accept-Ranges": "bytes", "Content-Disposition": "attachment"}
        if partial:
            more["Content-Range"] = f"bytes {first}-{last}/{size}"
        self._head(
            206 if partial else 200, "application/octet-stream", last - first + 1, more
        )
        if self.command == "HEAD":
            return
        with path.open("rb") as file:
            file.seek(first)
            left = last - first + 1
            while left > 0 and (block := file.read(min(_BLOCK, left))):
                self.wfile.write(block)
                left -= len(block)

    def _json(self, value: dict[str, Any], status: int = 200) -> None:
        self._send(status, "json", msgspec.json.encode(value))

    def _send(
        self, status: int, kind: str, data: bytes, more: dict[str, str] | None = None
    ) -> None:
        self._head(status, _TYPES.get(kind, kind), len(data), more or {})
        if self.command != "HEAD":
            self.wfile.write(data)

    def _head(self, status: int, kind: str, length: int, more: dict[str, str]) -> None:
        self.send_response(status)
        headers = {"Cache-Control": "no-store", **_HEADERS, **more}
        headers |= {"Content-Type": kind, "Content-Length": str(length)}
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()


def _range(text: str, size: int) -> tuple[int, int, bool] | None:
    """First and last byte, and whether that is a part; None where there is no such part.

    >>> _range("bytes=2-3", 10), _range("bytes=-3", 10), _range("", 10), _range("bytes=10-", 10)
    ((2, 3, True), (7, 9, True), (0, 9, False), None)
    """
    match = re.fullmatch(r"bytes=(\d{0,18})-(\d{0,18})", text.strip())
    if match is None or not (match[1] or match[2]):
        return 0, size - 1, False
    if not match[1]:
        first, last = max(0, size - int(match[2])), size - 1
    else:
        first, last = int(match[1]), min(int(match[2] or size - 1), size - 1)
    return (first, last, True) if first <= last and first < size else None
