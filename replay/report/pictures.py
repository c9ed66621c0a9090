"""Chosen frames of an annotated log with the scene drawn into them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from reasoning.questions import Case
from reasoning.questions.inputs import kind_of
from recorders.annotated.reader import AnnotatedFrame, AnnotatedLog
from recorders.errors import RecordingError, UsageError
from recorders.pictures import Image
from replay.draw import DrawOptions, draw_frame
from replay.export.video import frame_overlay

_GROUND = 96


def check_log(path: str | Path) -> None:
    """That pictures can be drawn from a file: that it is no index.

    Raises:
        UsageError: it is an index; names the logs that it was made of.
        RecordingError: it cannot be read.
    """
    kind = kind_of(Path(path))
    if kind == "log":
        return
    with Case([path]) as case:
        logs = [
            p
            for (p,) in case.rows(
                "SELECT DISTINCT path FROM recordings ORDER BY path LIMIT 4"
            )
        ]
    more = " ..." if len(logs) > 3 else ""
    if kind == "catalogue":
        logs = [str(Path(path) / p) for p in logs]
    what = (
        "holds many recordings, of which one is shown at a time"
        if kind == "catalogue"
        else "an index has no pictures"
    )
    raise UsageError(
        f"{path}: {what}; give the annotated log itself: {', '.join(logs[:3])}{more}"
    )


def chosen_frames(log: AnnotatedLog, wanted: Sequence[int]) -> list[AnnotatedFrame]:
    """The annotated frames of these numbers that the log has, in order."""
    numbers = set(wanted)
    last = max(numbers, default=-1)
    out = []
    for frame in log.frames():
        if frame.index in numbers:
            out.append(frame)
        if frame.index >= last:
            break
    return out


def drawn(
    log: AnnotatedLog,
    frames: Sequence[AnnotatedFrame],
    options: DrawOptions | None = None,
    *,
    bare: bool = False,
) -> Iterator[tuple[AnnotatedFrame, Image]]:
    """Each frame's picture with its overlay, (height, width, 3) uint8 BGR; a plain ground where
    there is no picture.

    Args:
        log: the log that the frames are of.
        frames: what `chosen_frames` gives.
        options: what is drawn, how large.
        bare: only the picture, nothing drawn.

    Raises:
        RecordingError: neither pictures nor their size.
    """
    options = options or DrawOptions()
    for frame in frames:
        image = _picture(log, frame)
        if bare:
            yield frame, image
            continue
        shown = frame
        if options.only is not None:
            keep = options.only
            shown = replace(
                frame,
                events=[
                    event for event in frame.events if keep.intersection(event.subjects)
                ],
            )
        yield frame, draw_frame(image, frame_overlay(log, shown), options)


def _picture(log: AnnotatedLog, frame: AnnotatedFrame) -> Image:
    if not log.has_pictures:
        size = log.size()
        if size is None:
            raise RecordingError("holds neither pictures nor their size", log.path)
        return np.full((size[1], size[0], 3), _GROUND, np.uint8)
    scene = log.scene
    at = None
    for recorded in scene.frames(frame.time_ns, frame.index):
        if recorded.time_ns > frame.time_ns:
            break
        at = recorded
        if recorded.image is not None:
            break
    return log.picture_of(at, frame.time_ns, frame.index)


def around(start: int, end: int, margin: int, last: int) -> list[int]:
    """Frames that tell an interval: before it, its start, its middle, its end, after it."""
    found = [start - margin, start, (start + end) // 2, end, end + margin]
    return sorted({min(max(f, 0), last) for f in found})
