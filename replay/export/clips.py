"""A clip for each stretch of time in which something happened, and a list of what it was."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from recorders.annotated.reader import AnnotatedLog
from recorders.channels import NANOS
from recorders.messages import Event
from replay.export.output import whole_folder
from replay.export.subtitles import is_told
from replay.export.video import VideoOptions, write_video

BEFORE_S, AFTER_S = 1.0, 2.0
INDEX = "clips.csv"
_COLUMNS = ("clip", "clip_t", "t", "frame", "event", "kind", "subjects", "text")


def write_clips(
    log: AnnotatedLog,
    out: str | Path,
    options: VideoOptions | None = None,
    *,
    force: bool = False,
    progress: Callable[[str, int], None] | None = None,
) -> tuple[int, int]:
    """Write ``clip_0001.mp4`` and so on, and `INDEX` with every event, its clip and the second in
    it; returns how many clips and events.

    A clip reaches from `BEFORE_S` seconds before its first event to `AFTER_S` after its last;
    events whose stretches meet share one. Events that only a tracker cares for make none.

    Raises:
        OutputExistsError: the folder holds clips, and ``force`` is not set.
        UsageError: there are neither pictures nor a size.
    """
    options = options or VideoOptions()
    rows: list[list[object]] = []
    stretches = list(_stretches(_events(log, options)))
    old = [p.name for p in Path(out).glob("clip_*.mp4")] if Path(out).is_dir() else []
    with whole_folder(Path(out), INDEX, force=force, stale=old) as folder:
        for number, (start, end, events) in enumerate(stretches, 1):
            name = f"clip_{number:04d}.mp4"
            chosen = replace(options, from_ns=start, to_ns=end)
            write_video(log, folder / name, chosen, progress=progress)
            for time_ns, event in events:
                seconds = [round((time_ns - t) / NANOS, 3) for t in (start, log.start_ns)]
                subjects = " ".join(map(str, event.subjects))
                rows.append(
                    [
                        name,
                        *seconds,
                        event.frame,
                        event.id,
                        event.kind,
                        subjects,
                        event.text,
                    ]
                )
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows([_COLUMNS, *rows])
        (folder / INDEX).write_text(text.getvalue(), encoding="utf-8")
    return len(stretches), len(rows)


def _events(log: AnnotatedLog, options: VideoOptions) -> Iterator[tuple[int, Event]]:
    for frame in log.frames(("events",), options.from_ns, options.to_ns):
        for event in frame.events:
            if is_told(event) and options.draw.tells(event):
                yield frame.time_ns, event


def _stretches(
    events: Iterator[tuple[int, Event]],
) -> Iterator[tuple[int, int, list[tuple[int, Event]]]]:
    """Start, end and events of each clip."""
    before, after = round(BEFORE_S * NANOS), round(AFTER_S * NANOS)
    held: list[tuple[int, Event]] = []
    for time_ns, event in events:
        if held and time_ns - before > held[-1][0] + after:
            yield max(0, held[0][0] - before), held[-1][0] + after, held
            held = []
        held.append((time_ns, event))
    if held:
        yield max(0, held[0][0] - before), held[-1][0] + after, held
