"""What comes at more recordings than one machine can try, reckoned with rates measured on it.

A unit of 400 cameras makes 10^5 recordings of an hour in a month, so a camera's day has eight. Times
of a store are those of a local disk; an object store answers a listing of 1000 names in about 0.1 s,
which is more.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

from bench_index import questions
from fleet_catalogue import fill
from msgspec import Struct, structs

from reasoning.questions import Case, QueryLimits
from reasoning.questions.schema import TABLES
from recorders.stores import FolderStore
from replay.batch.driver import statuses

_HOUR = 3600 * 25
_A_DAY = 1e5 / 30 / 400
"""Recordings of a camera on a day."""
_COUNTS = (10**3, 10**5, 10**7)
_PROCESSORS = 100
_OWN_FILES = 3  # scene log, annotated log, status
_ASKED = "left-with 7"
"""The question in the middle of those that `bench_index.py` asks."""


class Rates(Struct, frozen=True):
    """What was measured.

    Attributes:
        boxes_fps: frames a second of a processor, boxes alone.
        pictures_fps: the same of pixels; 0: no recording was there.
        frame_bytes: of logs and tables, boxes alone, a frame.
        hour_rows: rows of all tables, an hour.
        status_s: to read one status.
        open_s: to list and open a recording's file (or a compacted one).
        file_s: of a question, for a file.
        row_s: of a question, for a row of relations.
    """

    boxes_fps: float
    pictures_fps: float
    frame_bytes: float
    hour_rows: float
    status_s: float
    open_s: float
    file_s: float
    row_s: float


class _Bound(Struct, frozen=True):
    """Something that grows with the recordings, what it may come to, and what then."""

    name: str
    unit: str
    of: Callable[[float], float]
    most: float
    then: str


def catalogue_rates() -> dict[str, float]:
    """What a question costs for each file and each row, by three small catalogues."""

    def asked(folder: Path, recordings: int, rows: int) -> tuple[float, float]:
        case = folder / f"{recordings}-{rows}"
        fill(case, recordings, rows)
        make, few = questions()[_ASKED]
        opened, took = [], []
        for _ in range(3):
            begun = time.process_time()
            with Case([case], QueryLimits(600, 2048, 2)) as whole:
                opened.append(time.process_time() - begun)
                list(whole.by_recording(make, None, keeps_few=few).rows)
            took.append(time.process_time() - begun - opened[-1])
        return min(opened), min(took)

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        small = asked(folder, 100, 200_000)
        more_files = asked(folder, 1000, 200_000)
        more_rows = asked(folder, 100, 2_000_000)
    return {
        "open_s": max(0.0, more_files[0] - small[0]) / 90,
        "file_s": max(0.0, more_files[1] - small[1]) / 90,
        "row_s": max(0.0, more_rows[1] - small[1]) / 1_800_000,
    }


def status_rate(case: Path) -> float:
    """Seconds to read a status of a case."""
    store = FolderStore(case)
    begun = time.process_time()
    count = len(statuses(store))
    return (time.process_time() - begun) / max(1, count)


def _bounds(rates: Rates) -> list[_Bound]:
    def files(count: float) -> float:
        return count * (len(TABLES) + _OWN_FILES)

    def of_all(count: float) -> float:
        rows = count * rates.hour_rows / 10  # one in ten is a relation
        return rates.open_s * count + rates.file_s * count + rates.row_s * rows

    return [
        _Bound(
            "files, as they are made", "", files, 1e8, "compact each day, a case a month"
        ),
        _Bound(
            "a batch's start, reading statuses",
            "s",
            lambda count: rates.status_s * count,
            300,
            "a case a month",
        ),
        _Bound(
            "opening for a question of all, not compacted",
            "s",
            lambda count: rates.open_s * count,
            10,
            "compact; then a table format that lists files and their bounds in a manifest"
            " (Iceberg by pyiceberg, Delta by delta-rs)",
        ),
        _Bound(
            "opening, compacted by camera and day",
            "s",
            lambda count: rates.open_s * count / _A_DAY,
            10,
            "compact by camera and month, or such a table format",
        ),
        _Bound(
            f"a question of all ({_ASKED})",
            "s",
            of_all,
            60,
            "ask by --camera and --date; several machines for the rest",
        ),
        _Bound(
            "the list of what is compacted",
            "MB",
            lambda count: count * 35 / 1e6,
            100,
            "a case a month",
        ),
    ]


def told(rates: Rates) -> Iterator[str]:
    """Lines: the rates, what comes, and what breaks first."""
    for name, value in structs.asdict(rates).items():
        yield f"{name:14}{value:14.4g}"
    heads = "".join(f"{f'10^{len(str(count)) - 1}':>12}" for count in _COUNTS)
    yield f"{'recordings of an hour':48}{heads}"

    def line(what: str, of: Callable[[float], float]) -> str:
        return f"{what:48}" + "".join(f"{of(count):12.4g}" for count in _COUNTS)

    for kind, fps in (("boxes", rates.boxes_fps), ("pictures", rates.pictures_fps)):
        if fps:
            days = f"days on {_PROCESSORS} processors, {kind}"
            yield line(days, partial(_days, fps))
    yield line("TB, boxes alone", lambda n: n * _HOUR * rates.frame_bytes / 1e12)
    yield line("rows of all tables", lambda n: n * rates.hour_rows)
    yield line(
        "files of tables, compacted by camera and day", lambda n: n / _A_DAY * len(TABLES)
    )
    yield line(
        "a question of one camera and day, s",
        lambda n: (
            _A_DAY * (rates.open_s + rates.file_s)
            + rates.row_s * _A_DAY * rates.hour_rows / 10
        ),
    )
    bounds = _bounds(rates)
    for bound in bounds:
        yield line(f"{bound.name}{', ' if bound.unit else ''}{bound.unit}", bound.of)
    yield "what breaks first, and what then:"
    for bound in sorted(bounds, key=_breaks_at):
        at = _breaks_at(bound)
        yield (
            f"  {at:8.1e} recordings: {bound.name} over {bound.most:g} {bound.unit}".rstrip()
            + f" -> {bound.then}"
        )


def _days(fps: float, count: float) -> float:
    return count * _HOUR / fps / 86400 / _PROCESSORS


def _breaks_at(bound: _Bound) -> float:
    """All of them grow in proportion."""
    one = bound.of(1.0)
    return bound.most / one if one > 0 else float("inf")
