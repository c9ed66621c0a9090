"""What a source says itself of when it was taken: its name, and its container's creation time.

It is offered, never taken: names are in some time zone, and clocks of cameras are often wrong.
"""

from __future__ import annotations

import re
from contextlib import suppress
from datetime import datetime
from pathlib import Path

from recorders.log.wire import MAGIC

_NAMED = re.compile(
    r"(?<!\d)((?:19|20)\d\d)[-_.]?([01]\d)[-_.]?([0-3]\d)[-_ T.]{0,3}([0-2]\d)[-_:.h]?([0-5]\d)"
    r"[-_:.m]?([0-5]\d)?(?!\d)"
)

_HEAD_BYTES = 4096


def own_clock(path: Path) -> list[tuple[str, str]]:
    """Times as RFC 3339 and where each is from; of a file's name the time zone is unknown and
    written as UTC.

    >>> own_clock(Path("cam2_2026-01-31_12-03-40.mp4"))
    [('2026-01-31T12:03:40Z', 'its name, if that is UTC')]
    """
    found = []
    named = _NAMED.search(path.stem)
    if named is not None:
        year, month, day, hour, minute, second = (int(part or 0) for part in named.groups())
        with suppress(ValueError):
            when = datetime(year, month, day, hour, minute, second)
            found.append((f"{when:%Y-%m-%dT%H:%M:%S}Z", "its name, if that is UTC"))
    created = _created(path)
    if created:
        found.append((created, "its container's creation time"))
    return found


def _may_be_container(path: Path) -> bool:
    """Not where a file is text or a log, for which the libraries of video need not be loaded."""
    try:
        with path.open("rb") as file:
            head = file.read(_HEAD_BYTES)
    except OSError:
        return False
    return b"\0" in head and not head.startswith(MAGIC)


def _created(path: Path) -> str:
    if not path.is_file() or not _may_be_container(path):
        return ""
    import av

    try:
        with av.open(str(path)) as container:
            text = container.metadata.get("creation_time", "")
    except (av.error.FFmpegError, OSError, ValueError):
        return ""
    match = re.fullmatch(r"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d)(?:\.\d+)?Z", text)
    # Some cameras write the beginning of their calendar.
    return f"{match[1]}Z" if match is not None and match[1] >= "1990" else ""
