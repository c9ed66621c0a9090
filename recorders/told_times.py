"""Times as people say them: ``1:20`` from the start, ``12:03:40`` by the clock, and clock times to
read.

A recording whose log time begins within a year of 1970 was made without a clock; its times of day
are unknown, and ``1:02:03`` is then an hour, two minutes and three seconds from its start.
"""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from typing import NamedTuple
from zoneinfo import ZoneInfo

from recorders.errors import UsageError

NANOS = 1_000_000_000
CLOCKED_NS = 365 * 86_400 * NANOS
"""Log times before this are counted from a recording's start, not told by a clock."""
_COLONS = re.compile(r"(?:(\d{1,3}):)?(\d{1,2}):(\d{2}(?:\.\d{1,9})?)")


class ColonTime(NamedTuple):
    """A time of minutes and seconds, or of hours too, which may be the time of day."""

    seconds: float
    of_day: bool


def colon_time(text: str) -> ColonTime | None:
    """What ``1:20`` or ``12:03:40`` say, None where the text is no such time.

    >>> colon_time("1:20.5"), colon_time("12:03:40")
    (ColonTime(seconds=80.5, of_day=False), ColonTime(seconds=43420.0, of_day=True))
    """
    match = _COLONS.fullmatch(text.strip())
    if match is None or float(match[3]) >= 60 or (match[1] and int(match[2]) >= 60):
        return None
    seconds = int(match[1] or 0) * 3600 + int(match[2]) * 60 + float(match[3])
    return ColonTime(seconds, match[1] is not None and int(match[1]) < 24)


def time_zone(name: str) -> ZoneInfo:
    """A time zone of that name.

    Raises:
        UsageError: there is none.
    """
    try:
        return ZoneInfo(name)
    except (KeyError, ValueError, OSError) as error:
        raise UsageError(
            f"--timezone {name}: there is none of that name; like Europe/Vienna or UTC"
        ) from error


def after_start(of_day: float, start_ns: int, zone: str) -> float:
    """Seconds from a recording's start to the first time of day like that at or after it."""
    if start_ns < CLOCKED_NS:
        return of_day
    whole, rest = divmod(start_ns, NANOS)
    start = datetime.fromtimestamp(whole, UTC).astimezone(time_zone(zone))
    wanted = datetime.combine(start.date(), datetime.min.time(), start.tzinfo)
    found = wanted + timedelta(seconds=of_day)
    # To the millisecond, as times are shown.
    if round(of_day, 3) < round(_of_day(start) + rest / NANOS, 3):
        found += timedelta(days=1)
    return (found.astimezone(UTC) - start.astimezone(UTC)).total_seconds() - rest / NANOS


def clock_text(time_ns: int, zone: str = "UTC") -> str:
    """The clock's time at a log time as RFC 3339, to the millisecond; empty where there was none.

    >>> clock_text(1_700_000_000_250_000_000, "Europe/Vienna")
    '2023-11-14T23:13:20.250+01:00'
    """
    if time_ns < CLOCKED_NS:
        return ""
    whole, milli = divmod(round(time_ns / 1_000_000), 1000)
    when = datetime.fromtimestamp(whole, UTC).astimezone(time_zone(zone))
    offset = _offset(when)
    return f"{when:%Y-%m-%dT%H:%M:%S}.{milli:03d}{offset}"


def _of_day(when: datetime) -> float:
    return when.hour * 3600.0 + when.minute * 60 + when.second


def _offset(when: datetime) -> str:
    text = f"{when:%z}"
    return f"{text[:3]}:{text[3:5]}" if when.utcoffset() else "Z"
