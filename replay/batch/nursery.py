"""Each job in a process of its own that is forked from one that has everything loaded.

A job that needs too much memory, takes too long or crashes takes its own process with it and
nothing else. `Nursery` is the side of the engine; `serve`, in a process of its own, the other: it
reads a job as a line of JSON on stdin, forks, and writes the outcome as a line on stdout. When its
stdin ends, whoever asked has gone, and it ends the job and itself.
"""

from __future__ import annotations

import gc
import importlib
import os
import pkgutil
import resource
import select
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import msgspec

from recorders.closing import Closing
from recorders.stores import FolderStore, StoreError, is_uri, load_package
from replay.batch.jobs import Job, Outcome, Status, digest_of, stamp_of
from replay.batch.scratch import clear, work_of

COMMAND = "replay.cli:main"
"""What runs ``record`` and ``replay``: module and function, loaded in the nursery."""
_WHOLE = ("recorders", "replay.trackers", "replay.hindsight")
"""Packages of which every module is loaded there: they load what they hold when it is asked for."""
_LOADED = (
    "av",
    "cv2",
    "duckdb",
    "encodings.utf_8_sig",
    "networkx",
    "numpy.ma",
    "reasoning.questions.catalogue",
    "replay.annotated_writer",
    "replay.asking_configuration",
    "replay.assignment",
    "replay.batch.steps",
    "replay.cli.record",
    "replay.cli.replay",
    "replay.configuration",
    "replay.run",
    "replay.verification",
)
_MAIN = "from replay.batch.nursery import serve; serve()"
_MIB = 1 << 20
_LEAST_MIB = 64
"""What any recording needs, above the libraries."""


class Nursery(Closing):
    """A process that does jobs one after another; started anew when it is gone."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None

    def close(self) -> None:
        """End it, and the job that it is at."""
        process, self._process = self._process, None
        if process is None:
            return
        assert process.stdin is not None
        with suppress(OSError):
            process.stdin.close()
        try:
            process.wait(10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        assert process.stdout is not None
        process.stdout.close()

    def do(self, job: Job) -> Outcome:
        """Do a job; one whose process ends without a word has failed."""
        if self._process is None or self._process.poll() is not None:
            self.close()
            self._process = subprocess.Popen(
                [sys.executable, "-c", _MAIN],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(p for p in sys.path if p)},
                # Ctrl-C is for the driver, which ends its jobs itself.
                start_new_session=True,
            )
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(msgspec.json.encode(job) + b"\n")
            process.stdin.flush()
            line = process.stdout.readline()
        except (OSError, ValueError):
            line = b""
        if not line:
            return failed(job, "the worker ended: killed from outside", again=True)
        return msgspec.json.decode(line, type=Outcome)


def failed(job: Job, reason: str, *, again: bool, seconds: float = 0.0) -> Outcome:
    """The outcome of a job that could not say it itself."""
    status = Status(
        "failed",
        digest_of(f"name {job.source}", job.configuration),
        job.source,
        # Without a stamp the next run tries it again.
        "" if again else _stamp_of(job.source),
        job.configuration,
        reason=reason,
        step="worker",
    )
    return Outcome(status, again=again, seconds=seconds)


def _stamp_of(source: str) -> str:
    try:
        return stamp_of(source)
    except StoreError:
        return ""


def load() -> None:
    """Import what a job needs, once for all of them."""
    from recorders import vision  # noqa: F401 - before OpenCV is loaded by anyone else

    inner = [
        module.name
        for room in map(importlib.import_module, _WHOLE)
        for module in pkgutil.walk_packages(room.__path__, f"{room.__name__}.")
    ]
    for name in (*_LOADED, *inner, COMMAND.partition(":")[0]):
        with suppress(ImportError):
            importlib.import_module(name)


def serve() -> None:
    """Read jobs, do them, write outcomes, until stdin ends."""
    load()
    # Only the protocol goes to stdout, whatever a library prints.
    out = os.dup(1)
    os.dup2(2, 1)
    # What a job leaves that is killed goes with its scratch folder.
    with (
        _kept(),
        tempfile.TemporaryDirectory(
            prefix="scenetrace-batch-", ignore_cleanup_errors=True
        ) as scratch,
    ):
        tempfile.tempdir = os.environ["TMPDIR"] = scratch
        for job in _asked():
            for place in filter(is_uri, (job.source, job.case)):
                load_package(place)
            outcome = _forked(job)
            if outcome is None:
                return
            os.write(out, msgspec.json.encode(outcome) + b"\n")
            clear(Path(scratch))


@contextmanager
def _kept() -> Iterator[None]:
    """What is loaded stays: no job has to look through it for garbage, nor to copy its pages for
    that.
    """
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()  # libraries take what is left at the end for lost


def _asked() -> Iterator[Job]:
    """The jobs that come in on stdin."""
    buffer = b""
    while True:
        while b"\n" not in buffer:
            read = os.read(0, 1 << 16)
            if not read:
                return
            buffer += read
        line, _, buffer = buffer.partition(b"\n")
        yield msgspec.json.decode(line, type=Job)


def _forked(job: Job) -> Outcome | None:
    """Do a job in a child; None: nobody wants its outcome any more."""
    begun = time.monotonic()
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        _child(job, writing)
    os.close(writing)
    said = b""
    end = begun + job.limit.seconds if job.limit.seconds else None
    try:
        while True:
            left = None if end is None else max(0.0, end - time.monotonic())
            ready, _, _ = select.select([reading, 0], [], [], left)
            if reading in ready:
                read = os.read(reading, 1 << 16)
                if not read:
                    break
                said += read
            elif 0 in ready:  # a second job is never sent before the first one's outcome
                return None
            else:
                hours = f"took longer than {job.limit.seconds:g} s (--time-limit)"
                return failed(job, hours, again=False, seconds=time.monotonic() - begun)
    finally:
        os.close(reading)
        if not said or said[-1:] != b"\n":
            # One that has no group of its own yet is ended by its number.
            for kill in (os.killpg, os.kill):
                with suppress(ProcessLookupError):
                    kill(child, signal.SIGKILL)
        _, waited = os.waitpid(child, 0)
        if not is_uri(job.case):
            clear(FolderStore(Path(job.case)).parts, f"{work_of(child)}*")
    if said[-1:] == b"\n":
        return msgspec.json.decode(said, type=Outcome)
    code = os.waitstatus_to_exitcode(waited)
    how = (
        f"ended by {signal.Signals(-code).name}" if code < 0 else f"ended with code {code}"
    )
    killed = code == -signal.SIGKILL
    why = (
        "the worker's process was killed from outside, or the machine is out of memory"
        if killed
        else f"the worker's process {how}: more than {job.limit.memory_mib} MiB of memory"
        " (--memory), or a fault in a library"
    )
    return failed(job, why, again=killed, seconds=time.monotonic() - begun)


def _child(job: Job, writing: int) -> None:
    """What the forked process does; never returns."""
    code = 1
    try:
        os.setsid()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        nothing = os.open(os.devnull, os.O_RDONLY)
        os.dup2(nothing, 0)
        too_little = _limit_memory(job.limit.memory_mib)
        outcome = failed(job, too_little, again=False) if too_little else _done(job)
        said = msgspec.json.encode(outcome) + b"\n"
        while said:
            said = said[os.write(writing, said) :]
        code = 0
    finally:
        os._exit(code)


def _done(job: Job) -> Outcome:
    from replay.batch.steps import do

    module, _, name = COMMAND.partition(":")
    return do(job, getattr(importlib.import_module(module), name))


def _limit_memory(most_mib: int) -> str:
    """Bound this process; why not, where it has more already (a thread that starts without any
    memory waits for ever).
    """
    if not most_mib:
        return ""
    with suppress(OSError):
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        here = pages * os.sysconf("SC_PAGE_SIZE") // _MIB
        if here + _LEAST_MIB > most_mib:
            return (
                f"needs more than {most_mib} MiB of memory (--memory): the libraries alone"
                f" take {here}"
            )
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or most_mib * _MIB < hard:
        resource.setrlimit(resource.RLIMIT_AS, (most_mib * _MIB, hard))
    return ""
