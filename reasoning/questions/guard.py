"""The last line of defence of a process that answers strangers' queries.

DuckDB looks for an interrupt between batches, not inside one call of a function, and a function's
own strings are not counted against its memory limit. So a process that runs one query bounds its
address space, and ends itself if a query has not stopped some time after it was told to.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from reasoning.questions.asking import QueryLimits

GRACE_S = 5.0
FAILED = 1
_MIB = 1024 * 1024


@contextmanager
def guarded(limits: QueryLimits) -> Iterator[None]:
    """Bound this process's address space and, ``GRACE_S`` after the time limit, its life."""
    with _address_space(2 * limits.memory_mib * _MIB):
        watch = threading.Timer(limits.seconds + GRACE_S, _end, [limits.seconds])
        watch.daemon = True
        watch.start()
        try:
            yield
        finally:
            watch.cancel()
            watch.join(1.0)


def _end(seconds: float) -> None:
    print(  # noqa: T201
        f"scenetrace: error: SQL: stopped after {seconds:g} s (--time-limit)",
        file=sys.stderr,
        flush=True,
    )
    os._exit(FAILED)


@contextmanager
def _address_space(more: int) -> Iterator[None]:
    try:
        import resource

        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    except (ImportError, OSError, ValueError):  # not Linux: DuckDB's own limits remain
        yield
        return
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    wanted = pages * resource.getpagesize() + more
    if soft != resource.RLIM_INFINITY:
        wanted = min(wanted, soft)
    resource.setrlimit(resource.RLIMIT_AS, (wanted, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))
