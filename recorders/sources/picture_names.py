"""What the names of a folder's pictures say: their order, their numbers, their times."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from itertools import pairwise
from pathlib import Path

from recorders.errors import UsageError
from recorders.names import by_number

_DIGITS = re.compile(r"\d+")
_DECIMAL = re.compile(r"(\D*?)(\d{9,10}\.\d+)")
_EPOCHS = {13: 1_000_000, 16: 1_000, 19: 1}
"""Digits of an epoch time in milli-, micro- and nanoseconds, and the ns of its unit."""
_DATE = re.compile(
    r"(?<!\d)(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[T _-]?(\d\d)[-_:.h]?(\d\d)[-_:.m]?(\d\d)"
    r"(?:[-_.,]?(\d{3}|\d{6}|\d{9}))?(?!\d)"
)
_LEAST_STEP_NS = 2_000_000
_FROM_NS, _TO_NS = 946_684_800 * 10**9, 4_102_444_800 * 10**9  # the years 2000 to 2100
_BEST = (".png", ".tif", ".tiff", ".bmp", ".webp", ".avif", ".jpg", ".jpeg")


@dataclass(frozen=True)
class PictureNames:
    """A folder's pictures in order.

    Attributes:
        names: the pictures.
        numbers: the last number in each name, None where one has none.
        times_ns: since 1970, where all names are times; else None.
        doubled: pictures left out because another format holds the same one.
    """

    names: list[str]
    numbers: list[int] | None
    times_ns: list[int] | None
    doubled: list[str]


def ordered(names: list[str], folder: Path) -> PictureNames:
    """The pictures in the order that their names tell: of times, else of the numbers in them.

    Raises:
        UsageError: they are several series that were numbered each by itself.
    """
    kept, doubled = _one_of_each(names)
    times = _times(kept)
    if times is not None:
        order = sorted(range(len(kept)), key=lambda k: (times[k], kept[k]))
        return PictureNames(
            [kept[k] for k in order], None, [times[k] for k in order], doubled
        )
    kept = sorted(kept, key=by_number)
    _check_series(kept, folder)
    found = [_number(name) for name in kept]
    known = [n for n in found if n is not None]
    return PictureNames(kept, known if len(known) == len(kept) else None, None, doubled)


def _one_of_each(names: list[str]) -> tuple[list[str], list[str]]:
    """One picture for each name without its suffix: that of the format that loses least."""
    by_stem: dict[str, list[str]] = {}
    for name in sorted(names):
        by_stem.setdefault(Path(name).stem, []).append(name)
    kept = [
        min(group, key=lambda n: (_BEST.index(Path(n).suffix.lower()), n))
        for group in by_stem.values()
    ]
    chosen = set(kept)
    return kept, [name for name in sorted(names) if name not in chosen]


def _times(names: list[str]) -> list[int] | None:
    found = []
    for name in names:
        stem = Path(name).stem
        decimal = _DECIMAL.fullmatch(stem)
        digits = _DIGITS.findall(stem)
        dated = _dated(stem)
        if dated is not None:
            time = dated
        elif decimal is not None:
            time = int(Decimal(decimal[2]) * 10**9)
        elif len(digits) == 1 and len(digits[0]) in _EPOCHS:
            time = int(digits[0]) * _EPOCHS[len(digits[0])]
        else:
            return None
        if not _FROM_NS <= time < _TO_NS:
            return None
        found.append(time)
    if len(set(found)) != len(found) or len(found) < 2:
        return None
    order = sorted(found)
    steps = sorted(b - a for a, b in pairwise(order))
    # Behind a date three digits may as well count the pictures of a second.
    return found if steps[len(steps) // 2] >= _LEAST_STEP_NS else None


def _dated(stem: str) -> int | None:
    """The time that a name tells as a date with a time of day (``20260131_120000_040``), in ns since
    1970; names say no time zone, so it counts as UTC.
    """
    match = _DATE.search(stem)
    if match is None:
        return None
    try:
        moment = datetime(*map(int, match.groups()[:6]), tzinfo=UTC)  # type: ignore[misc,arg-type]
    except ValueError:
        return None
    return int(moment.timestamp()) * 10**9 + int((match[7] or "0").ljust(9, "0"))


def _number(name: str) -> int | None:
    digits = _DIGITS.findall(Path(name).stem)
    return int(digits[-1]) if digits else None


def _glob(pattern: str) -> str:
    return pattern if pattern.endswith("*") else f"{pattern}*"


def _check_series(names: list[str], folder: Path) -> None:
    """Names that differ in more than numbers, the same numbers in each: several cameras."""
    series: dict[str, set[int]] = {}
    for name in names:
        number = _number(name)
        if number is not None:
            series.setdefault(_DIGITS.sub("#", Path(name).stem), set()).add(number)
    large = {pattern: numbers for pattern, numbers in series.items() if len(numbers) > 1}
    counts = Counter(n for numbers in large.values() for n in numbers)
    if len(large) > 1 and max(counts.values()) > 1:
        patterns = [p.replace("#", "*") for p in sorted(large)]
        listed = ", ".join(
            f"{folder}/{_glob(pattern)} ({len(large[pattern.replace('*', '#')])})"
            for pattern in patterns
        )
        raise UsageError(
            f"{folder}: {len(large)} series of pictures with the same numbers: {listed};"
            " record each by itself, as: scenetrace record"
            f" '{folder}/{_glob(patterns[0])}' -o OUT"
        )
