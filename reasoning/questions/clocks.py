"""Wall clock beside seconds: answers with the clock's time for each of their times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from reasoning.questions.asking import Answer
from reasoning.questions.case import Case
from recorders.told_times import CLOCKED_NS, clock_text, time_zone

NANOS = 1_000_000_000


def starts(case: Case) -> dict[str, int]:
    """Log time of frame 0 of each recording that was made with a clock."""
    return dict(
        case.rows(
            f"SELECT recording, start_ns FROM recordings WHERE start_ns >= {CLOCKED_NS}"
        )
    )


def with_clocks(answer: Answer, begun: Mapping[str, int], zone: str = "UTC") -> Answer:
    """The answer with a column ``clock`` beside ``t``, ``start_clock`` beside ``start_t`` and so
    on: RFC 3339, NULL for a recording without a clock. The answer itself where none has one, or
    where it has such columns or does not say of which recording its rows are.
    """
    times = [name for name in answer.columns if _is_time(name)]
    clocks = {name: f"{name[:-1]}clock" for name in times}
    if (
        not begun
        or "recording" not in answer.columns
        or set(clocks.values()) & set(answer.columns)
    ):
        return answer
    time_zone(zone)
    columns, types = [], []
    for name, kind in zip(answer.columns, answer.types, strict=True):
        columns.append(name)
        types.append(kind)
        if name in clocks:
            columns.append(clocks[name])
            types.append("VARCHAR")
    return Answer(columns, types, _rows(answer, begun, zone))


def _is_time(name: str) -> bool:
    return name == "t" or name.endswith("_t")


def _rows(answer: Answer, begun: Mapping[str, int], zone: str) -> Iterator[tuple[Any, ...]]:
    recording = answer.columns.index("recording")
    timed = [_is_time(name) for name in answer.columns]
    for row in answer.rows:
        start = begun.get(row[recording])
        out: list[Any] = []
        for value, is_time in zip(row, timed, strict=True):
            out.append(value)
            if is_time:
                known = start is not None and isinstance(value, int | float)
                out.append(
                    clock_text(start + round(value * NANOS), zone)
                    if known and start is not None
                    else None
                )
        yield tuple(out)
