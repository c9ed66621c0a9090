"""What a person types into a question: durations, moments, ids, names; and SQL literals of them."""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from urllib.parse import quote

from recorders.errors import UsageError
from recorders.told_times import CLOCKED_NS, colon_time, time_zone

_UNITS = {"ms": 0.001, "s": 1.0, "sec": 1.0, "m": 60.0, "min": 60.0, "h": 3600.0}
_DURATION = re.compile(r"(\d+(?:\.\d*)?|\.\d+)\s*([a-z]*)")
_NANOS = 1_000_000_000
_LARGEST = 2**31 - 1


def duration(text: str) -> float:
    """Seconds of ``30``, ``30s``, ``500ms``, ``2min``, ``1.5h``, ``1:20``.

    >>> duration("2min")
    120.0

    Raises:
        UsageError: it is no duration.
    """
    told = colon_time(text)
    if told is not None:
        return told.seconds
    match = _DURATION.fullmatch(text.strip().lower())
    if match is None or match[2] not in ("", *_UNITS):
        raise UsageError(
            f"duration {text!r}: must be a number, not negative, with ms, s, min or h,"
            " like 30s"
        )
    seconds = float(match[1]) * _UNITS[match[2] or "s"]
    if seconds > 1e9:
        raise UsageError(f"duration {text!r}: must be at most 1e9 s")
    return seconds


def identity(text: str) -> int:
    """A track id, group label or event number.

    Raises:
        UsageError: it is none.
    """
    if not re.fullmatch(r"\d{1,10}", text) or int(text) > _LARGEST:
        raise UsageError(
            f"id {text!r}: must be a number from 0 to {_LARGEST}, as the table tracks"
            " gives it"
        )
    return int(text)


def literal(value: str | float) -> str:
    """A SQL literal."""
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    return repr(value)


@dataclass(frozen=True)
class Recordings:
    """Which recordings a question is asked of: those whose names lie from ``first`` to ``last``,
    both included.
    """

    first: str
    last: str

    def sql(self) -> str:
        """A condition on the column ``recording``."""
        if self.first == self.last:
            return f"recording = {literal(self.first)}"
        return f"recording BETWEEN {literal(self.first)} AND {literal(self.last)}"


def only(name: str | None) -> Recordings | None:
    """One recording, or all of them."""
    return None if name is None else Recordings(name, name)


def zone_word(zone: str) -> str:
    """A zone's name within a reference, without blanks or commas: as ``url_encode`` writes it in
    SQL.
    """
    return quote(zone, safe="")


def zone_reference(track: int, frame: int, zone: str) -> str:
    """What names a target's stay in a zone to `explain`.

    >>> zone_reference(4, 160, "bus stop")
    'zone:4@160:bus%20stop'
    """
    return f"zone:{track}@{frame}:{zone_word(zone)}"


@dataclass(frozen=True)
class Moment:
    """A moment in a recording: seconds from its start, a frame, a wall time (``since_ns``: ns
    since 1970), or a time of day (``of_day``: seconds since midnight in ``zone``), which in a
    recording without a clock is one from its start.
    """

    seconds: float | None = None
    frame: int | None = None
    since_ns: int | None = None
    of_day: float | None = None
    zone: str = "UTC"

    def text(self) -> str:
        """As a person would write it."""
        if self.frame is not None:
            return f"frame:{self.frame}"
        if self.seconds is not None:
            return f"{self.seconds:g}"
        if self.of_day is not None:
            return f"{timedelta(seconds=self.of_day)} ({self.zone})"
        return f"{datetime.fromtimestamp((self.since_ns or 0) // _NANOS, UTC):%Y-%m-%dT%H:%M:%SZ}"

    def sql(self, row: str) -> str:
        """Seconds from the start of the recording that the row (an alias with a ``recording``)
        belongs to.

        The inner alias is one that no caller's row has: of two of one name the inner would be
        compared with itself.
        """
        if self.seconds is not None:
            return repr(self.seconds)
        if self.frame is not None:
            found, table, which = "m_.t", "frames", f" AND m_.frame = {self.frame}"
        elif self.of_day is not None:
            found, table, which = self._from_midnight(), "recordings", ""
        else:
            found, table, which = f"({self.since_ns} - m_.start_ns) / 1e9", "recordings", ""
        return (
            f"(SELECT {found} FROM {table} m_ WHERE m_.recording = {row}.recording{which})"
        )

    def _from_midnight(self) -> str:
        """Seconds from the start of ``m_`` to the first such time of day at or after it."""
        zone, micros = literal(self.zone), round((self.of_day or 0.0) * 1_000_000)
        start = f"timezone({zone}, make_timestamptz(m_.start_ns // 1000))"
        that = f"date_trunc('day', {start}) + to_microseconds({micros})"
        late = f"{that} + to_milliseconds(1) <= {start}"
        found = f"CASE WHEN {late} THEN {that} + INTERVAL 1 DAY ELSE {that} END"
        return (
            f"if(m_.start_ns < {CLOCKED_NS}, {self.of_day!r},"
            f" (epoch_us(timezone({zone}, {found})) - m_.start_ns / 1000) / 1e6)"
        )


def moment(text: str, zone: str = "UTC") -> Moment:
    """``12.5`` (or ``12.5s``), ``1:20``, ``12:03:40`` (a time of day in ``zone``), ``frame:300``,
    or RFC 3339.

    Raises:
        UsageError: it is none of them.
    """
    if match := re.fullmatch(r"frame:(\d{1,10})", text):
        return Moment(frame=identity(match[1]))
    if _DURATION.fullmatch(text.lower()):
        return Moment(seconds=duration(text))
    told = colon_time(text)
    if told is not None:
        return (
            Moment(of_day=told.seconds, zone=time_zone(zone).key)
            if told.of_day
            else Moment(seconds=told.seconds)
        )
    try:
        when = datetime.fromisoformat(text.replace("Z", "+00:00").replace("z", "+00:00"))
        if when.tzinfo is None:
            raise ValueError(text)
    except ValueError:
        raise UsageError(
            f"time {text!r}: must be seconds from the start (12.5), minutes and seconds"
            " (1:20), a time of day (12:03:40), frame:300, or RFC 3339"
            " (2026-01-31T12:00:00Z)"
        ) from None
    whole = int(when.replace(microsecond=0).timestamp())
    return Moment(since_ns=whole * _NANOS + when.microsecond * 1000)
