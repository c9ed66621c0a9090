"""Zones and lines that are drawn after the fact: what a person types, and the rows it makes.

They work on whatever was recorded, without a new replay: the tables hold where everybody stood.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from reasoning.geometry import Area
from reasoning.questions.standing import (
    OPPOSITE,
    Point,
    Steps,
    crossings,
    positive_side,
    stays,
)
from recorders.errors import UsageError
from recorders.message_checks import LARGEST
from recorders.sources.regions import beyond, checked

_ZONE = "--zone NAME=x,y,x,y,x,y"
_LINE = "--line NAME=x1,y1,x2,y2"
_SHORTEST = 1.0


@dataclass(frozen=True)
class DrawnZone:
    """A named polygon, in pixels of the recording."""

    name: str
    polygon: tuple[Point, ...]


@dataclass(frozen=True)
class DrawnLine:
    """A named line from ``start`` to ``end``, in pixels of the recording."""

    name: str
    start: Point
    end: Point

    @property
    def directions(self) -> tuple[str, str]:
        """The two ways over it, in the picture."""
        word = positive_side(self.start, self.end)
        return word, OPPOSITE[word]


@dataclass(frozen=True)
class Drawn:
    """All that was drawn."""

    zones: tuple[DrawnZone, ...] = ()
    lines: tuple[DrawnLine, ...] = ()

    def __bool__(self) -> bool:
        return bool(self.zones or self.lines)

    @property
    def names(self) -> list[str]:
        """All names, those of zones first."""
        return [*(zone.name for zone in self.zones), *(line.name for line in self.lines)]

    def check_names(self) -> None:
        """That no two have one name.

        Raises:
            UsageError: they have.
        """
        twice = next((name for name in self.names if self.names.count(name) > 1), None)
        if twice is not None:
            raise UsageError(
                f"{twice!r} is drawn twice; every zone and line has its own name"
            )

    def line(self, name: str) -> DrawnLine | None:
        """The line of that name."""
        return next((line for line in self.lines if line.name == name), None)

    def check_size(self, recording: str, size: tuple[int, int]) -> None:
        """That all of it is seen in a recording's picture; (0, 0) is a size that nobody knows.

        Raises:
            UsageError: something lies wholly beyond it.
        """
        named = [(f"zone {z.name!r}", list(z.polygon)) for z in self.zones]
        named += [(f"line {x.name!r}", [x.start, x.end]) for x in self.lines]
        for name, points in named if size[0] > 0 and size[1] > 0 else ():
            if beyond(points, size):
                raise UsageError(
                    f"{name} lies wholly beyond the picture of {recording!r}, which is"
                    f" {size[0]}x{size[1]} pixels"
                )

    def zone_rows(self, track: int, steps: Steps) -> Iterator[tuple[Any, ...]]:
        """A target's rows of the table ``zones``, without the recording."""
        for zone in self.zones:
            for interval, belief in stays(Area([zone.polygon]), steps):
                yield track, zone.name, *interval, *belief

    def crossing_rows(self, track: int, steps: Steps) -> Iterator[tuple[Any, ...]]:
        """A target's rows of the table ``crossings``, without the recording."""
        for line in self.lines:
            for crossing in crossings(line.start, line.end, steps):
                yield (
                    track,
                    line.name,
                    crossing.frame,
                    crossing.t,
                    crossing.direction,
                    crossing.x,
                    crossing.y,
                    *crossing.belief,
                )


def drawn(zones: list[str] | None = None, lines: list[str] | None = None) -> Drawn:
    """What the words of ``--zone`` and ``--line`` draw.

    Raises:
        UsageError: a word draws nothing, or two have one name.
    """
    made = Drawn(tuple(map(zone, zones or ())), tuple(map(line, lines or ())))
    made.check_names()
    return made


def zone(text: str) -> DrawnZone:
    """A zone of ``door=10,20,60,20,60,90``: the corners in order; of two, opposite corners of an
    upright rectangle.

    >>> zone("door=10,20,60,90").polygon
    ((10.0, 20.0), (60.0, 20.0), (60.0, 90.0), (10.0, 90.0))

    Raises:
        UsageError: it is none.
    """
    name, points = _points(text, _ZONE)
    if len(points) == 2:
        (x0, y0), (x1, y1) = points
        points = [(x0, y0), (x1, y0), (x1, y1), (x0, y1)]
    fault, outline = checked(points, f"zone {name!r}")
    if fault:
        raise UsageError(f"--zone {text}: {fault}; {_ZONE}")
    return DrawnZone(name, tuple(outline))


def line(text: str) -> DrawnLine:
    """A line of ``gate=10,20,60,90``.

    Raises:
        UsageError: it is none.
    """
    name, points = _points(text, _LINE)
    if len(points) != 2:
        raise UsageError(f"--line {text}: {len(points)} points, two are wanted: {_LINE}")
    if math.dist(*points) < _SHORTEST:
        raise UsageError(f"--line {text}: its ends are one point; {_LINE}")
    return DrawnLine(name, points[0], points[1])


def _points(text: str, wanted: str) -> tuple[str, list[Point]]:
    name, equals, rest = text.rpartition("=")
    flag = wanted.split(maxsplit=1)[0]
    if not equals or not name.strip() or name == "scene":
        raise UsageError(f"{flag} {text}: wanted {wanted}, in pixels")
    try:
        numbers = [float(word) for word in rest.replace(";", ",").replace(" ", ",").split(",")
                   if word]  # fmt: skip
        if len(numbers) % 2 or not all(abs(number) <= LARGEST for number in numbers):
            raise ValueError(rest)
    except ValueError:
        raise UsageError(
            f"{flag} {text}: {rest!r} are no pairs x,y of pixels; wanted {wanted}"
        ) from None
    return name.strip(), list(zip(numbers[::2], numbers[1::2], strict=True))
