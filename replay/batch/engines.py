"""Where jobs run: processes of this machine, or a Ray cluster.

Both hand a job to a `Nursery` and give back its outcome, in whatever order they come. What is
written is the same. A job carries names alone: no picture passes from process to process.
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from queue import SimpleQueue
from typing import Any, Protocol

from recorders.errors import UsageError
from replay.batch.jobs import Job, Outcome
from replay.batch.nursery import Nursery, failed


class JobEngine(Protocol):
    """Does jobs. At most ``room`` are given to it at a time, so that the list of what is to be
    done stays with the driver.
    """

    room: int

    def submit(self, job: Job) -> None:
        """Begin a job as soon as a worker is free."""
        ...

    def outcomes(self) -> Iterator[tuple[Job, Outcome]]:
        """What has ended since; waits for at least one of those that run."""
        ...

    def close(self) -> None:
        """End what runs, and let go of the workers."""
        ...


class LocalEngine:
    """Processes of this machine, one a worker."""

    def __init__(self, workers: int) -> None:
        self.room = workers
        self._pool = ThreadPoolExecutor(workers, thread_name_prefix="batch")
        self._free: SimpleQueue[Nursery] = SimpleQueue()
        self._nurseries = [Nursery() for _ in range(workers)]
        for nursery in self._nurseries:
            self._free.put(nursery)
        self._running: dict[Future[Outcome], Job] = {}

    def submit(self, job: Job) -> None:
        """See `JobEngine`."""
        self._running[self._pool.submit(self._do, job)] = job

    def _do(self, job: Job) -> Outcome:
        nursery = self._free.get()
        try:
            return nursery.do(job)
        finally:
            self._free.put(nursery)

    def outcomes(self) -> Iterator[tuple[Job, Outcome]]:
        """See `JobEngine`."""
        done, _ = wait(self._running, return_when=FIRST_COMPLETED)
        for future in done:
            yield self._running.pop(future), future.result()

    def close(self) -> None:
        """See `JobEngine`."""
        for nursery in self._nurseries:
            nursery.close()
        self._pool.shutdown(wait=True, cancel_futures=True)


@dataclass(frozen=True)
class RayOptions:
    """How a Ray cluster is used.

    Attributes:
        address: ``auto``, ``ray://host:port``, or None: one on this machine.
        workers: jobs at a time; None: as many as the cluster has processors.
        wheel: this package as a wheel, for nodes that do not have it.
        ship: folders with code of the user's own.
    """

    address: str | None = None
    workers: int | None = None
    wheel: str | None = None
    ship: tuple[str, ...] = ()


class RayEngine:
    """Tasks of a Ray cluster: a processor and the job's memory each."""

    def __init__(self, options: RayOptions, memory_mib: int) -> None:
        try:
            import ray
        except ImportError as error:
            raise UsageError(
                "--engine ray: needs Ray: pip install 'scenetrace[ray]'"
            ) from error
        self._ray: Any = ray
        modules = [*options.ship, *([options.wheel] if options.wheel else [])]
        environment = {"py_modules": modules} if modules else {}
        if not ray.is_initialized():
            try:
                ray.init(
                    address=options.address,
                    runtime_env=environment,
                    log_to_driver=False,
                    include_dashboard=False,
                    configure_logging=False,
                    logging_level=logging.ERROR,
                )
            except (ConnectionError, ValueError, RuntimeError) as error:
                first = str(error).splitlines()[0]
                raise UsageError(
                    f"--address {options.address or '(this machine)'}: no Ray cluster: {first}"
                ) from error
        processors = int(self._ray.cluster_resources().get("CPU", 1))
        # Some more than can run, so that a worker which ends one has the next at hand; Ray adds
        # nodes, where it may, for what waits.
        self.room = options.workers or 2 * processors
        # Failures are counted and tried again by the driver, which alone knows which of them help.
        needs = {"num_cpus": 1, "max_retries": 0, "memory": memory_mib << 20}
        self._task = self._ray.remote(**needs)(_in_nursery)
        self._running: dict[Any, Job] = {}

    def submit(self, job: Job) -> None:
        """See `JobEngine`."""
        self._running[self._task.remote(job)] = job

    def outcomes(self) -> Iterator[tuple[Job, Outcome]]:
        """See `JobEngine`."""
        done, _ = self._ray.wait(list(self._running), num_returns=1)
        for reference in done:
            job = self._running.pop(reference)
            try:
                yield job, self._ray.get(reference)
            except self._ray.exceptions.RayError as error:
                kind = type(error).__name__
                yield (
                    job,
                    failed(job, f"the worker or its node was lost ({kind})", again=True),
                )

    def close(self) -> None:
        """See `JobEngine`."""
        for reference in self._running:
            self._ray.cancel(reference, force=True)
        self._running.clear()
        self._ray.shutdown()


_nursery: Nursery | None = None


def _in_nursery(job: Job) -> Outcome:
    """A job in a Ray worker, whose nursery stays for the next one."""
    global _nursery  # noqa: PLW0603 - one a worker process
    if _nursery is None:
        _nursery = Nursery()
    return _nursery.do(job)
