"""The trackers by name: the one place that knows them all. A plug-in is a word here."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from importlib import import_module
from typing import TypeVar

from recorders.parameters import Parameters
from replay.trackers.tracker import TrackerFactory

_NAMES = ("events", "parts", "shells")
_T = TypeVar("_T")


class _Told(Mapping[str, _T]):
    """What the trackers' packages have under one name; a package is loaded when it is asked for."""

    def __init__(self, what: str) -> None:
        self._what = what

    def __getitem__(self, name: str) -> _T:
        if name not in _NAMES:
            raise KeyError(name)
        found: _T = getattr(import_module(f"replay.trackers.{name}"), self._what)
        return found

    def __iter__(self) -> Iterator[str]:
        return iter(_NAMES)

    def __len__(self) -> int:
        return len(_NAMES)

    def __contains__(self, name: object) -> bool:
        return name in _NAMES


TRACKERS: Mapping[str, TrackerFactory] = _Told("make")
TRACKER_SECTIONS: Mapping[str, Mapping[str, type[Parameters]]] = _Told("SECTIONS")
