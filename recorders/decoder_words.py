"""What libjpeg says of a picture: it writes to the process's stderr and decodes on.

OpenCV gives no other way to hear of it. The words are caught for the time of one decoding and
judged: bytes of padding are harmless, everything else means that part of the picture is made up.
What others wrote meanwhile is passed on.
"""

from __future__ import annotations

import os
import re
from collections.abc import Callable
from contextlib import suppress
from tempfile import TemporaryFile
from threading import Lock
from typing import IO, Any

_WORDS = re.compile(
    rb"(Corrupt JPEG data|Premature end of JPEG|Unsupported marker|Inconsistent"
    rb" progression|Warning: unknown JFIF|Unknown Adobe|Invalid)[^\n]*\n?"
)
_PADDING = re.compile(rb"Corrupt JPEG data: (\d+) extraneous bytes before marker")
_MOST_PADDING = 64
"""Cameras pad a picture to a round length by a few bytes; more than that was meant to be decoded."""
_STDERR = 2


class _Catcher:
    def __init__(self) -> None:
        self._lock = Lock()
        self._file: IO[bytes] | None = None

    def run(self, decode: Callable[[], Any]) -> tuple[Any, list[bytes]]:
        """What ``decode`` gives, and what it made libjpeg say."""
        with self._lock:
            try:
                stderr = os.dup(_STDERR)
            except OSError:  # There is none: nobody could see the words.
                return decode(), []
            try:
                if self._file is None:
                    self._file = TemporaryFile(buffering=0)  # noqa: SIM115 - open as long as we are
                os.dup2(self._file.fileno(), _STDERR)
                try:
                    image = decode()
                finally:
                    os.dup2(stderr, _STDERR)
                return image, self._heard(self._file, stderr)
            finally:
                os.close(stderr)

    @staticmethod
    def _heard(file: IO[bytes], stderr: int) -> list[bytes]:
        if not file.seek(0, os.SEEK_END):
            return []
        file.seek(0)
        said = file.read()
        file.seek(0)
        file.truncate()
        others = _WORDS.sub(b"", said)
        if others:
            with suppress(OSError):
                os.write(stderr, others)
        return [found.group(0).strip() for found in _WORDS.finditer(said)]


_catcher = _Catcher()


def _again() -> None:
    global _catcher  # noqa: PLW0603 - a child must not share its parent's file and lock
    _catcher = _Catcher()


os.register_at_fork(after_in_child=_again)


def decoded_in_silence(decode: Callable[[], Any]) -> tuple[Any, str]:
    """What ``decode`` gives, and libjpeg's first word of damage ("" where there was none)."""
    image, words = _catcher.run(decode)
    for word in words:
        if word.startswith((b"Warning", b"Unknown")):
            continue
        padding = _PADDING.match(word)
        if padding is None or int(padding.group(1)) > _MOST_PADDING:
            return image, word.decode("ascii", "replace").removeprefix(
                "Corrupt JPEG data: "
            )
    return image, ""
