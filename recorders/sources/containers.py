"""What a video's container says, and what it lacks: its streams, its index, how it is shown."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from recorders.errors import SourceError, UsageError

# Only containers that hold their pictures themselves: playlists would reach for other files, and
# FFmpeg draws plain text as video where nothing forbids it.
CONTAINERS = "avi,mov,mp4,m4a,3gp,3g2,mj2,matroska,webm,mpeg,mpegvideo,mpegts,h264,hevc,m4v,mjpeg,flv,asf,ogg,dv,mxf,gif,nut,ivf,dhav,yuv4mpegpipe"  # noqa: E501
_WITHOUT_TIMES = frozenset({"h264", "hevc", "m4v", "mjpeg", "mpegvideo"})
_MOST_BOXES = 100_000
_UPRIGHT = {
    (1, 0, 0, 1): 1,
    (-1, 0, 0, 1): 2,
    (-1, 0, 0, -1): 3,
    (1, 0, 0, -1): 4,
    (0, 1, 1, 0): 5,
    (0, 1, -1, 0): 6,
    (0, -1, -1, 0): 7,
    (0, -1, 1, 0): 8,
}
"""A display matrix (a, b, c, d), x' = ax + cy and y' = bx + dy, as EXIF's orientation."""


def is_elementary(container: Any) -> bool:
    """Whether the file is a bare stream: it has no times, and FFmpeg assumes a rate."""
    return container.format.name in _WITHOUT_TIMES


def streams(container: Any, path: Path) -> list[Any]:
    """The video streams, without the cover pictures of the file.

    Raises:
        SourceError: there is none.
    """
    from av.stream import Disposition

    if not container.streams.video:
        raise SourceError("holds no video stream", path)
    found = [
        s for s in container.streams.video if not s.disposition & Disposition.attached_pic
    ]
    if not found:
        raise SourceError("holds a cover picture, but no video stream", path)
    return found


def chosen(found: list[Any], number: int | None, path: Path) -> Any:
    """The stream of that number among the video streams, the first where none is named.

    Raises:
        UsageError: there is no such stream; lists those that there are.
    """
    if number is None:
        return found[0]
    if not 0 <= number < len(found):
        raise UsageError(
            f"--stream {number}: {path} has {len(found)} video streams, numbered from 0:"
            f" {described(found)}"
        )
    return found[number]


def described(found: list[Any]) -> str:
    """Size and codec of each stream."""
    names = [
        f"{index}: {s.width}x{s.height} {getattr(s.codec_context, 'name', '?')}"
        for index, s in enumerate(found)
    ]
    return ", ".join(names)


def orientation(frame: Any) -> int:
    """EXIF's orientation of how a frame is to be shown, by its display matrix; 1 for upright."""
    for data in frame.side_data:
        if getattr(data.type, "name", "") == "DISPLAYMATRIX" and data.buffer_size >= 36:
            a, b, _, c, d = struct.unpack("<5i", bytes(data)[:20])
            known = _UPRIGHT.get(tuple(round(v / 65536) for v in (a, b, c, d)))
            if known is not None:
                return known
    return {0: 1, 1: 8, 2: 3, 3: 6}[round(frame.rotation / 90) % 4]


def lacks_index(path: Path) -> bool:
    """Whether an MP4 holds its pictures but not the index (moov) that says where they are."""
    found = set()
    with path.open("rb") as file:
        size = file.seek(0, 2)
        at = 0
        for _ in range(_MOST_BOXES):
            file.seek(at)
            head = file.read(16)
            if len(head) < 8:
                break
            length, kind = struct.unpack_from(">I4s", head)
            if length == 1 and len(head) == 16:
                (length,) = struct.unpack_from(">Q", head, 8)
            found.add(kind)
            at += length if length >= 8 else size
            if at >= size:
                break
    return b"mdat" in found and b"moov" not in found and b"moof" not in found


def pixel_aspect(stream: Any) -> str:
    """How much wider than high a pixel is, in words; empty where it is square or not said."""
    ratio = stream.sample_aspect_ratio
    if not ratio or ratio == 1 or ratio <= 0:
        return ""
    shown = round(stream.width * ratio)
    return (
        f"pixels are {ratio.numerator}:{ratio.denominator} as wide as high: players show"
        f" {shown}x{stream.height}, places and sizes are in stored pixels"
    )


def stated_seconds(container: Any, stream: Any) -> float | None:
    """How long the file says that the stream is; None where it does not say it of this one."""
    if stream.duration and stream.time_base:
        return float(stream.duration * stream.time_base)
    if container.duration and len(container.streams) == 1:
        return float(container.duration) / 1e6
    return None
