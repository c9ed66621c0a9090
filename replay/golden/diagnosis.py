"""Why two replays of one scene differ: chance or the clock, shared state, the order of a set, a
state too small.
"""

from __future__ import annotations

import inspect
import itertools
import sys
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from recorders.annotated.provenance import provenance_of
from recorders.errors import SceneTraceError
from recorders.log import LogReader
from replay.compare.bytewise import compare_bytes
from replay.golden.job import GoldenJob, hash_seed

_PLAIN = (
    bool,
    int,
    float,
    str,
    bytes,
    list,
    tuple,
    dict,
    set,
    frozenset,
    deque,
    itertools.count,
)
_MOST = 3
_SEEDS_TRIED = 8
Memory = dict[str, str]


def shared_state(job: GoldenJob) -> Memory:
    """What the tracker's class and module hold outside its instances, as text by name."""
    factory: Any = job.tracker.factory
    module = sys.modules.get(getattr(factory, "__module__", ""))
    own = (
        []
        if module is None
        else [var for _, var in sorted(vars(module).items()) if inspect.isclass(var)]
    )
    classes = [c for c in own if c.__module__ == getattr(module, "__name__", None)]
    if inspect.isclass(factory):
        classes += [c for c in factory.__mro__ if c not in classes and c is not object]
    found: Memory = {}
    for owner in classes:
        found |= {
            f"{owner.__name__}.{name}": repr(var)[:200]
            for name, var in vars(owner).items()
            if _is_plain(name, var)
        }
    if module is not None:
        found |= {
            name: repr(var)[:200]
            for name, var in vars(module).items()
            if _is_plain(name, var)
        }
    return found


def _is_plain(name: str, value: Any) -> bool:
    return not name.startswith("__") and isinstance(value, _PLAIN)


def first_difference(a: Path, b: Path) -> str:
    """Where two annotated logs of one scene differ first, with both values."""
    with LogReader(a) as left, LogReader(b) as right:
        raw = compare_bytes(
            left, right, provenance_of(left).camera, provenance_of(right).camera
        )
    for name, first in raw.channels.items():
        return (
            f"frame {first.frame}, {name}, {first.field}: {first.a} in the first, {first.b}"
            " in the second"
        )
    return "one has frames that the other has not"


def same_process(
    job: GoldenJob, folder: Path, first: Path, second: Path, before: Memory, after: Memory
) -> str:
    """Two replays in one process differ."""
    head = (
        f"{job.name} is not deterministic: two replays of {job.scene.name} in one process,"
        f" each with a fresh instance, differ.\n  {first_difference(first, second)}"
    )
    changed = [f"{name} was {before.get(name, 'absent')}, then {after[name]}" for name in after
               if before.get(name) != after[name]]  # fmt: skip
    try:
        one, seen = job.elsewhere(folder / "one.mcap", 1, watched=True)
        two, _ = job.elsewhere(folder / "two.mcap", 1)
    except SceneTraceError as error:
        one, two, seen = "", "", {"clock": {}, "calendar": {}, "chance": {}}
        head += f"\n  (In a process of its own it could not be tried: {str(error).splitlines()[0]})"
    if one != two or seen["clock"] or seen["chance"]:
        return f"{head}\n{_asked(seen)}"
    words = (
        _listed(changed)
        if changed
        else "something outside the instance that the first replay leaves behind"
    )
    return (
        f"{head}\n  It looks like state that instances share: two processes give the same"
        f" result, a second instance in one process does not.\n  {words}\n  Keep everything"
        " in the instance: counters and caches in __init__, none in the class or the"
        " module."
    )


def other_process(
    job: GoldenJob, folder: Path, here: Path, digests: Mapping[int, str], odd: int
) -> str:
    """Two replays in one process agree, one in another process with another hash seed does not.

    Args:
        job: what was replayed.
        folder: the log of the replay with the hash seed N is in it as ``seed-N.mcap``.
        here: this process's log.
        digests: hash seed of each other process to its output digest.
        odd: the seed whose digest is not this process's.
    """
    head = (
        f"{job.name} is not deterministic: a replay of {job.scene.name} in another process"
        f" differs.\n  {first_difference(here, seed_log(folder, odd))}"
    )
    again, seen = job.elsewhere(folder / "again.mcap", odd, watched=True)
    if again != digests[odd]:
        return f"{head}\n{_asked(seen)}"
    if _follows_the_seed(job, folder, digests, odd):
        return (
            f"{head}\n  It follows the hash seed (PYTHONHASHSEED): it looks like a loop"
            " over a set, or another order that comes from hashes.\n  Loop over"
            " sorted(...), or keep a dict or a list in its place."
        )
    return (
        f"{head}\n  Other processes agree with one another whatever the hash seed, so it"
        " looks like something that was left behind in this one: a class variable, a"
        " cache, a module's variable, or an environment variable.\n  Keep everything in"
        " the instance."
    )


def seed_log(folder: Path, seed: int) -> Path:
    """Where the replay with a hash seed is written to."""
    return folder / f"seed-{seed}.mcap"


def _follows_the_seed(
    job: GoldenJob, folder: Path, digests: Mapping[int, str], odd: int
) -> bool:
    """Whether processes differ by their hash seeds alone.

    A set of two has but two orders, and half of all seeds share one: so many are tried, this
    process's own first, which alone tells apart what it has left behind.
    """
    if len({*digests.values()}) > 1:
        return True
    own = hash_seed()
    if own is not None:
        alike, _ = job.elsewhere(folder / "alike.mcap", own)
        return alike != digests[odd]
    tried = (
        seed for seed in range(1, _SEEDS_TRIED + len(digests) + 1) if seed not in digests
    )
    return any(
        job.elsewhere(seed_log(folder, seed), seed)[0] != digests[odd] for seed in tried
    )


def calendar(job: GoldenJob, asked: Mapping[str, int]) -> str:
    """Replays agree today, and the tracker asks what day or second it is."""
    return (
        f"{job.name} asks the clock while it replays {job.scene.name}:"
        f" {_listed(list(asked))}.\n  Replays agree now and need not tomorrow. Take the"
        " time from the frame: frame.time_ns (to measure speed: time.perf_counter())."
    )


def restored(job: GoldenJob, whole: Path, part: Path) -> str:
    """A replay from the middle, out of state() and restore(), goes another way."""
    return (
        f"{job.name}: a replay that starts from state() in the middle of {job.scene.name}"
        f" goes another way than one from the start.\n  {first_difference(whole, part)}\n "
        " state() must hold everything that the next frame's answer depends on, and"
        " restore() take all of it up."
    )


def _asked(seen: dict[str, Any]) -> str:
    if seen["clock"]:
        return (
            f"  It looks like the clock: {_listed(list(seen['clock']))}.\n"
            "  Take the time from the frame: frame.time_ns."
        )
    if seen["chance"]:
        return (
            f"  It looks like chance: {_listed(list(seen['chance']))}.\n  Use no"
            " randomness, or a generator of the instance with a seed from its parameters,"
            " kept in state()."
        )
    return (
        "  Two processes with the same hash seed differ as well: it looks like chance, the"
        " clock, memory addresses (id(), hash() of an object) or threads."
    )


def _listed(words: list[str]) -> str:
    shown = "; ".join(words[:_MOST])
    return shown + (f"; and {len(words) - _MOST} more" if len(words) > _MOST else "")
