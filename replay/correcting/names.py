"""Who a track is after some corrections: for every id, from which frame on it is called what."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Iterable
from typing import NamedTuple

from recorders.corrections import Correction


class NamedStretch(NamedTuple):
    """From a frame on a track is called ``name``, None: it is nobody; ``label``, where it was
    given one.
    """

    first: int
    name: int | None
    label: str = ""


class Names:
    """What corrections make of every id, frame by frame.

    >>> merge = Correction(1, "merge", [3, 7], "Jo", "same coat", frame=87)
    >>> split = Correction(2, "split", [3, 7], "Jo", "no, another", frame=87)
    >>> Names([merge]).at(7, 90).name, Names([merge]).at(7, 80).name
    (3, 7)
    >>> [(s.first, s.name) for s in Names([merge, split]).changed[3]]
    [(0, 3), (87, 7)]
    """

    def __init__(self, rows: Iterable[Correction] = ()) -> None:
        self._of: dict[int, list[NamedStretch]] = {}
        for row in rows:
            self._take(row)

    def at(self, track: int, frame: int) -> NamedStretch:
        """What a track is in a frame."""
        stretches = self._of.get(track)
        if stretches is None:
            return NamedStretch(0, track)
        return stretches[bisect_right(stretches, frame, key=lambda s: s.first) - 1]

    @property
    def changed(self) -> dict[int, list[NamedStretch]]:
        """The ids that are called otherwise in some frame, with all their stretches."""
        return {
            track: stretches
            for track, stretches in sorted(self._of.items())
            if any(s.name != track or s.label for s in stretches)
        }

    @property
    def touched(self) -> set[int]:
        """The ids that another is called, or that are called otherwise, in some frame."""
        found: set[int] = set()
        for track, stretches in self.changed.items():
            found |= {track, *(s.name for s in stretches if s.name is not None)}
        return found

    def _take(self, row: Correction) -> None:
        start = row.frame or 0
        a, b = [*row.tracks, -1, -1][:2]
        if row.do == "merge":
            self._turn({b: a}, start)
        elif row.do == "split":
            self._turn({a: b}, start)
        elif row.do == "swap":
            self._turn({a: b, b: a}, start)
        elif row.do == "rename":
            self._turn({a: b}, 0)
        elif row.do == "delete":
            self._turn({a: None}, start, row.until_frame)
        elif row.do == "label":
            self._turn({a: a}, start, label=row.text)

    def _turn(
        self,
        names: dict[int, int | None],
        start: int,
        end: int | None = None,
        label: str = "",
    ) -> None:
        """From a frame to another (excluded) whoever is called so is called otherwise."""
        for name in names:
            self._of.setdefault(name, [NamedStretch(0, name)])
        for track, stretches in self._of.items():
            cut = _cut(_cut(stretches, start), end)
            made = [
                NamedStretch(s.first, names[s.name], label or s.label)
                if s.name in names and start <= s.first and (end is None or s.first < end)
                else s
                for s in cut
            ]
            self._of[track] = [
                s for k, s in enumerate(made) if k == 0 or s[1:] != made[k - 1][1:]
            ]


def _cut(stretches: list[NamedStretch], frame: int | None) -> list[NamedStretch]:
    """The same with a stretch that begins at a frame."""
    if frame is None:
        return stretches
    place = bisect_right(stretches, frame, key=lambda s: s.first)
    before = stretches[place - 1]
    if before.first == frame:
        return stretches
    return [*stretches[:place], before._replace(first=frame), *stretches[place:]]
