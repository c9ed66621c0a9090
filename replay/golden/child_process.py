"""A replay in a process of its own: reads an order as JSON, prints the digest, and, watched, whom
the tracker asked.

Run by `replay.golden.job`; a result must not depend on this process being another one.
"""

from __future__ import annotations

import datetime
import json
import random
import sys
import sysconfig
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np

from recorders import errors
from replay.golden.job import GoldenJob, configured, imported
from replay.trackers.choice import choose

_CLOCK = "the clock"
_CALENDAR = "the calendar"
_CHANCE = "chance"
_TIMES = frozenset(
    {
        "time", "time_ns", "monotonic", "monotonic_ns", "perf_counter", "perf_counter_ns", "process_time",
        "process_time_ns", "thread_time", "thread_time_ns", "localtime", "gmtime", "ctime",
    }
)  # fmt: skip
# What moves so slowly that two replays agree by chance; asked by the tracker's own code, not by a
# logger's.
_CALENDAR_TIMES = frozenset({"time", "time_ns", "localtime", "gmtime", "ctime"})
_OWN = Path(__file__).resolve().parent.parent
_FOREIGN = tuple(
    str(Path(place).resolve())
    for place in (
        sysconfig.get_path("stdlib"),
        sysconfig.get_path("platstdlib"),
        str(Path(errors.__file__).parent),
    )
)


class ClockWatch:
    """Notes from where clocks and sources of chance are asked, through the interpreter's
    profiling hook.
    """

    def __init__(self) -> None:
        self.asked: dict[str, dict[str, int]] = {_CLOCK: {}, _CALENDAR: {}, _CHANCE: {}}

    def __call__(self, frame: FrameType, event: str, function: Any) -> None:
        """A profile event."""
        if event != "c_call":
            return
        kind = _kind(function)
        if kind is not None:
            caller, direct = _caller(frame)
            if caller is not None:
                words = f"{caller} calls {_name(function)}()"
                self._note(kind, words)
                slow = function.__name__ in _CALENDAR_TIMES or isinstance(
                    function.__self__, type
                )
                if kind == _CLOCK and direct and slow:
                    self._note(_CALENDAR, words)

    def _note(self, kind: str, words: str) -> None:
        self.asked[kind][words] = self.asked[kind].get(words, 0) + 1


def _kind(function: Any) -> str | None:
    name, owner = function.__name__, getattr(function, "__self__", None)
    if getattr(owner, "__name__", "") == "time" and name in _TIMES:
        return _CLOCK
    if (
        isinstance(owner, type)
        and issubclass(owner, datetime.date)
        and name in ("now", "utcnow", "today")
    ):
        return _CLOCK
    if (
        isinstance(owner, random.Random) and name in ("random", "getrandbits")
    ) or name == "urandom":
        return _CHANCE
    return None


def _name(function: Any) -> str:
    """A built-in function by the name that one writes: bound methods do not say their module."""
    owner, name = getattr(function, "__self__", None), function.__name__
    if isinstance(owner, type):
        return f"{owner.__module__}.{owner.__qualname__}.{name}"
    if isinstance(owner, random.Random):
        # The module's functions are methods of an instance that it keeps.
        return (
            f"random.{name}"
            if type(owner) is random.Random
            else f"{type(owner).__qualname__}.{name}"
        )
    return f"{'os' if name == 'urandom' else getattr(owner, '__name__', None) or function.__module__}.{name}"


def _caller(frame: FrameType | None) -> tuple[str | None, bool]:
    """The nearest place in the tracker's own code, None where the call is the machinery's;
    whether it called itself.
    """
    direct = True
    while frame is not None:
        file = Path(frame.f_code.co_filename).resolve()
        inside = file.is_relative_to(_OWN) and not file.is_relative_to(_OWN / "trackers")
        if inside:
            return None, False
        if (
            not str(file).startswith(_FOREIGN)
            and "site-packages" not in file.parts
            and file.exists()
        ):
            return f"{file.name}:{frame.f_lineno}", direct
        frame = frame.f_back
        direct = False
    return None, False


def main() -> int:
    """Replay once."""
    order = json.load(sys.stdin)
    tracker = choose(imported(order["tracker"]))
    job = GoldenJob(Path(order["scene"]), tracker, configured(tracker, order["config"]))
    watch = ClockWatch()
    before = random.getstate(), str(np.random.get_state(legacy=False))  # noqa: NPY002
    if order["watched"]:
        sys.setprofile(watch)
    try:
        digest = job.run(Path(order["out"]))
    finally:
        sys.setprofile(None)
    if str(np.random.get_state(legacy=False)) != before[1]:  # noqa: NPY002
        watch.asked[_CHANCE]["numpy's global random state was used"] = 1
    asked = {
        "clock": watch.asked[_CLOCK],
        "calendar": watch.asked[_CALENDAR],
        "chance": watch.asked[_CHANCE],
    }
    print(json.dumps({"digest": digest, **asked}))  # noqa: T201
    return 0


if __name__ == "__main__":
    sys.exit(main())
