"""Goes through all jobs: leaves out what is done, tries again what may succeed, sets aside what
cannot, and keeps count.
"""

from __future__ import annotations

import fcntl
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import msgspec

from reasoning.questions import catalogue
from recorders.errors import SceneTraceError, UsageError
from recorders.stores import FolderStore, Store, StoreError, open_store
from replay.batch.engines import JobEngine
from replay.batch.jobs import Job, Outcome, Status, stamp_of
from replay.batch.scratch import clear


@dataclass(frozen=True)
class BatchOptions:
    """How to go through them.

    Attributes:
        retries: how often a job is tried again that failed for reasons outside of its source.
        again: try those anew that an earlier run set aside.
    """

    retries: int = 2
    again: bool = False


@dataclass
class BatchSummary:
    """What became of the jobs.

    Attributes:
        done: statuses of those done now.
        known: how many had been done before.
        failed: statuses of those set aside, now or before.
        frames: recorded now.
        running: jobs that are being done.
        total: all of them.
    """

    done: list[Status] = field(default_factory=list)
    known: int = 0
    failed: list[Status] = field(default_factory=list)
    frames: int = 0
    running: int = 0
    total: int = 0

    @property
    def ended(self) -> int:
        """How many are done or set aside."""
        return len(self.done) + self.known + len(self.failed)


Told = Callable[[BatchSummary, Outcome | None], None]


def run_batch(
    jobs: Sequence[Job], engine: JobEngine, options: BatchOptions, told: Told | None = None
) -> BatchSummary:
    """Do all jobs of one case.

    Args:
        jobs: all with the same case.
        engine: where they run; closed at the end, whatever happens.
        options: how.
        told: called after each outcome, with what there is so far.

    Raises:
        UsageError: another batch is at the same folder.
        SceneTraceError: the case cannot be read or written.
    """
    tell = told or (lambda *_: None)
    store = open_store(jobs[0].case)
    with _alone(store):
        catalogue.check_schema(store, write=True)
        summary = BatchSummary(total=len(jobs))
        waiting = deque(_left(jobs, store, options, summary))
        tell(summary, None)
        try:
            _go_through(waiting, store, engine, options, summary, tell)
        finally:
            # Before another batch may take the case, and before it is tidied.
            engine.close()
    return summary


def _go_through(
    waiting: deque[Job],
    store: Store,
    engine: JobEngine,
    options: BatchOptions,
    summary: BatchSummary,
    tell: Told,
) -> None:
    tries: dict[str, int] = {}
    while waiting or summary.running:
        while waiting and summary.running < engine.room:
            engine.submit(waiting.popleft())
            summary.running += 1
        for job, ended in engine.outcomes():
            summary.running -= 1
            name = f"{job.source} {job.configuration}"
            tries[name] = tries.get(name, 0) + 1
            if _tried_again(ended, tries[name], options):
                waiting.append(job)
                continue
            outcome = _with_tries(ended, tries[name])
            if outcome.status.state == "failed" and not outcome.known:
                _set_aside(store, outcome.status)
            _count(outcome, summary)
            tell(summary, outcome)


def _with_tries(outcome: Outcome, tries: int) -> Outcome:
    if outcome.known:
        return outcome
    status = msgspec.structs.replace(outcome.status, tries=tries)
    return msgspec.structs.replace(outcome, status=status)


def _tried_again(outcome: Outcome, tries: int, options: BatchOptions) -> bool:
    if outcome.status.state == "done" or outcome.known:
        return False
    return outcome.again and tries <= options.retries


def _count(outcome: Outcome, summary: BatchSummary) -> None:
    if outcome.status.state == "failed":
        summary.failed.append(outcome.status)
    elif outcome.known:
        summary.known += 1
    else:
        summary.done.append(outcome.status)
        summary.frames += outcome.status.frames


def _set_aside(store: Store, status: Status) -> None:
    try:
        store.write(status.key, msgspec.json.format(msgspec.json.encode(status)))
    except StoreError as error:
        raise SceneTraceError(
            f"{error}; {status.source} failed: {status.reason}. The same command goes on where"
            " this one stopped"
        ) from error


def _left(
    jobs: Sequence[Job], store: Store, options: BatchOptions, summary: BatchSummary
) -> Iterator[Job]:
    """The jobs that an earlier run has not done, by the stamps of their sources."""
    before = {
        (status.source, status.stamp, status.configuration): status
        for status in statuses(store)
        if status.stamp
    }
    seen = {source for source, _, _ in before}
    for job in jobs:
        # To ask for a stamp is a call of the store: only of what an earlier run has met.
        stamp = stamp_of(job.source) if job.source in seen else ""
        status = before.get((job.source, stamp, job.configuration))
        if status is None:
            yield msgspec.structs.replace(job, again=options.again)
        elif status.state == "done":
            summary.known += 1
        elif options.again:
            yield msgspec.structs.replace(job, again=True)
        else:
            summary.failed.append(status)


def statuses(store: Store) -> list[Status]:
    """The statuses of a case, by key; one that cannot be read is none."""
    found = []
    for data in store.read_many(
        key for key in store.keys("status") if key.endswith(".json")
    ):
        try:
            found.append(msgspec.json.decode(data, type=Status))
        except msgspec.MsgspecError:
            continue
    return found


@contextmanager
def _alone(store: Store) -> Iterator[None]:
    """Hold a local case against a second batch, and clear what one left that was ended."""
    if not isinstance(store, FolderStore):
        yield
        return
    place = store.workplace()
    with (store.folder / ".lock").open("w") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise UsageError(
                f"{store.uri}: another batch is at it; `scenetrace batch --status {store.uri}`"
                " shows how far"
            ) from error
        # Workers of a driver that was killed may be taking away the same at this moment.
        clear(place)
        try:
            yield
        finally:
            shutil.rmtree(place, ignore_errors=True)


def status_summary(store: Store) -> dict[str, Any]:
    """Counts and failures of a case, for people and machines.

    Raises:
        RecordingError: its tables are of another version.
    """
    found = statuses(store)
    done = [status for status in found if status.state == "done"]
    # A source that was mended, or whose worker was lost, is done under another digest.
    there = {(status.source, status.configuration) for status in done}
    failed = [
        status
        for status in found
        if status.state != "done" and (status.source, status.configuration) not in there
    ]
    return {
        "done": len(done),
        "failed": len(failed),
        "frames": sum(status.frames for status in done),
        "left_out": sum(status.left_out for status in done),
        "failures": [
            {"source": s.source, "step": s.step, "reason": s.reason, "tries": s.tries}
            for s in failed
        ],
    }
