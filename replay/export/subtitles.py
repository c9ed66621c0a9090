"""Events as subtitles (SubRip, ``.srt``), for any player beside the video."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from recorders.annotated.reader import AnnotatedLog
from recorders.channels import NANOS
from recorders.messages import EVENT_LEVELS, Event
from replay.export.output import whole_file

SHOWN_S = 2.0
MOST_LINES = 4


def write_srt(log: AnnotatedLog, out: str | Path, *, force: bool = False) -> int:
    """Write every event that the log's lines have as INFO or above; returns how many.

    A text stays for `SHOWN_S` seconds; texts that are there at one time stand below one another,
    the latest `MOST_LINES` of them. Times count from the recording's start.

    Raises:
        OutputExistsError: ``out`` exists and ``force`` is not set.
    """
    with whole_file(out, force=force) as file:
        count = 0

        def told() -> Iterator[tuple[int, str]]:
            nonlocal count
            for frame in log.frames(("events",)):
                for event in frame.events:
                    if is_told(event):
                        count += 1
                        yield frame.time_ns - log.start_ns, event.text

        for number, (start, end, lines) in enumerate(_cues(told()), 1):
            text = "\n".join(" ".join(line.split()) for line in lines)
            file.write(f"{number}\n{_time(start)} --> {_time(end)}\n{text}\n\n".encode())
        return count


def is_told(event: Event) -> bool:
    """Whether an event is more than what a tracker says of itself."""
    return EVENT_LEVELS.get(event.kind, "INFO") != "DEBUG"


def _cues(told: Iterator[tuple[int, str]]) -> Iterator[tuple[int, int, list[str]]]:
    """Start, end and lines of each subtitle: they change where a text comes or goes."""
    shown: list[tuple[int, str]] = []
    now = 0
    for time_ns, text in told:
        yield from _until(shown, now, time_ns)
        now = time_ns
        shown.append((time_ns + round(SHOWN_S * NANOS), text))
        del shown[:-MOST_LINES]
    yield from _until(shown, now, 1 << 63)


def _until(
    shown: list[tuple[int, str]], start: int, end: int
) -> Iterator[tuple[int, int, list[str]]]:
    """The subtitles between two times, as texts go one after another."""
    while shown and start < end:
        stop = min(shown[0][0], end)
        if stop > start:
            yield start, stop, [text for _, text in shown]
        start = stop
        while shown and shown[0][0] <= start:
            shown.pop(0)


def _time(time_ns: int) -> str:
    """A time as SubRip writes it.

    >>> _time(3_723_004_000_000)
    '01:02:03,004'
    """
    seconds, ms = divmod(max(0, time_ns) // 1_000_000, 1000)
    minutes, seconds = divmod(seconds, 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours:02d}:{minutes:02d}:{seconds:02d},{ms:03d}"
