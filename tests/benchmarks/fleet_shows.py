"""What a fleet must bear, shown on this machine: `bench_fleet.py show NAME...`.

    engines   local processes and a Ray cluster of two nodes make the same files
    node      one of the two nodes is killed in the middle
    driver    the driver is killed in the middle, of local processes and of a Ray cluster
    store     sources and case in an S3 server that cannot be reached for a while
    poison    five sources that no recording can be made of, among the others

Every file is compared, by SHA-256, with that of a batch of local processes which nothing
disturbed. A batch is a process of its own, as `scenetrace batch` is. What needs Ray is skipped
without it (pip install ray), and `store` without its server (pip install s3fs moto flask flask-cors).
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

from fleet_meter import Meter
from fleet_sources import ROOT, poison, write_list

_BATCH = [
    sys.executable,
    "-c",
    "import sys, scenetrace; sys.exit(scenetrace.main())",
    "batch",
]
_POISONS = 5
_PATIENCE_S = 3600.0
_BUCKET = "unit"


class NotShownError(Exception):
    """It is not so."""


def _check(holds: bool, what: str) -> None:
    if not holds:
        raise NotShownError(what)


def digests(case: Path, *, statuses: bool = True) -> dict[str, str]:
    """Every file of a case and its SHA-256."""
    from tests.batch import files

    return files.digests(case, statuses=statuses)


def _ended(case: Path) -> int:
    return len(list((case / "status").glob("*.json")))


def _wait_until(holds: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + _PATIENCE_S
    while not holds():
        _check(time.monotonic() < end, f"{what}: not within {_PATIENCE_S:.0f} s")
        time.sleep(0.05)


@dataclass(frozen=True)
class Batch:
    """A batch that runs."""

    process: subprocess.Popen[str]

    def finish(self) -> tuple[int, dict[str, Any]]:
        """Exit code and the summary."""
        out, _ = self.process.communicate()
        lines = out.splitlines()
        _check(bool(lines), f"the batch said nothing, exit {self.process.returncode}")
        return self.process.returncode, json.loads(lines[-1])


class Stage:
    """Sources, and the case that is right.

    Attributes:
        folder: everything is in it.
        lines: of a list of all sources.
        workers: recordings at a time.
        cut_s: how long the store cannot be reached.
        used_s: seconds of processor, of local processes.
        ray_s: the same of a Ray cluster.
    """

    def __init__(
        self, folder: Path, lines: list[str], workers: int, cut_s: float = 20.0
    ) -> None:
        self.folder = folder
        self.lines = lines
        self.workers = workers
        self.cut_s = cut_s
        self.used_s = self.ray_s = 0.0
        self.all = write_list(folder / "in", self.lines, "all.txt")

    @property
    def count(self) -> int:
        """How many sources."""
        return len(self.lines)

    def start(
        self, case: Path | str, *words: str, sources: Path | None = None,
        environment: Mapping[str, str] | None = None,
    ) -> Batch:  # fmt: skip
        """Begin a batch in a process of its own."""
        listed = f"@{sources or self.all}"
        return Batch(
            subprocess.Popen(
                [*_BATCH, listed, "-o", str(case), "--json-lines", *words],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
                env={**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})},
            )
        )

    @property
    def local(self) -> tuple[str, ...]:
        """The words of local processes."""
        return ("--workers", str(self.workers))

    @cached_property
    def right(self) -> dict[str, str]:
        """What nothing disturbed."""
        case = self.folder / "right"
        begun = time.monotonic()
        with Meter() as meter:
            code, summary = self.start(case, *self.local).finish()
        self.used_s = meter.seconds
        _check(code == 0, f"the undisturbed batch ended with {code}: {summary}")
        _check(summary["done"] == self.count, f"not all done: {summary}")
        found = digests(case)
        print(
            f"reference: {self.count} recordings, {len(found)} files, local,"
            f" {self.used_s:.1f} s of processor, {time.monotonic() - begun:.0f} s"
        )
        return found

    def same(self, case: Path) -> str:
        """That a case is the right one, file by file."""
        found = digests(case)
        wrong = sorted(found.items() ^ self.right.items())
        _check(not wrong, f"{len(wrong)} files differ, the first {wrong[:1]}")
        return f"{len(found)} files, every SHA-256 equal"


@contextmanager
def _cluster() -> Iterator[tuple[Any, list[Any]]]:
    """A head without processors and two nodes of one each."""
    import ray
    from ray.cluster_utils import Cluster

    made: Any = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    try:
        nodes = [made.add_node(num_cpus=1, memory=8 << 30) for _ in range(2)]
        made.wait_for_nodes()
        yield made, nodes
    finally:
        ray.shutdown()
        made.shutdown()


def _ray_words(cluster: Any) -> tuple[str, ...]:
    return ("--engine", "ray", "--address", str(cluster.address))


def engines(stage: Stage) -> str:
    """Two nodes of a Ray cluster make what local processes make."""
    case = stage.folder / "engines"
    _ = stage.right
    with _cluster() as (cluster, _), Meter() as meter:
        code, summary = stage.start(case, *_ray_words(cluster)).finish()
    _check(code == 0, f"exit {code}: {summary}")
    stage.ray_s = meter.seconds
    more = meter.seconds / stage.used_s - 1
    return (
        f"{stage.same(case)}; {meter.seconds:.1f} s of processor, {more:+.1%} over local"
        " processes"
    )


def node(stage: Stage) -> str:
    """A node is lost, with what runs on it."""
    case = stage.folder / "node"
    _ = stage.right
    with _cluster() as (cluster, nodes):
        batch = stage.start(case, *_ray_words(cluster))
        _wait_until(lambda: _ended(case) >= stage.count // 4, "a quarter done")
        at = _ended(case)
        cluster.remove_node(nodes[0], allow_graceful=False)
        code, summary = batch.finish()
    _check(code == 0, f"exit {code}: {summary}")
    return f"killed after {at} of {stage.count}; {stage.same(case)}"


def driver(stage: Stage) -> str:
    """The driver is lost, and the same command is given again."""
    local = _driver_killed(stage, stage.folder / "driver-local", stage.local)
    with _cluster() as (cluster, _):
        words = _ray_words(cluster)
        remote = _driver_killed(stage, stage.folder / "driver-ray", words)
    return f"local: {local}\n{'':10}Ray: {remote}"


def _driver_killed(stage: Stage, case: Path, words: tuple[str, ...]) -> str:
    _ = stage.right
    batch = stage.start(case, *words)
    _wait_until(lambda: _ended(case) >= stage.count // 3, "a third done")
    batch.process.send_signal(signal.SIGKILL)
    batch.process.communicate()
    at = _ended(case)
    half = sorted(digests(case).items() - stage.right.items())
    _check(not half, f"half of a file lies in the case: {half[:1]}")
    code, summary = stage.start(case, *words).finish()
    _check(code == 0, f"exit {code}: {summary}")
    _check(summary["known"] >= at, f"finished work was done twice: {summary}")
    return f"killed after {at} of {stage.count}; {summary['known']} were there; {stage.same(case)}"


def store(stage: Stage) -> str:
    """Sources and case lie in an object store, which is cut off in the middle."""
    import flask_cors  # noqa: F401 - of the server
    import moto  # noqa: F401
    import s3fs  # noqa: F401

    from tests.batch.s3 import bucket, s3_server

    _ = stage.right
    case = f"s3://{_BUCKET}/case"
    with s3_server(stage.folder) as (proxy, environment):
        files = bucket(environment, _BUCKET)
        files.put(f"{stage.folder / 'in'}/", f"{_BUCKET}/in/", recursive=True)
        lines = [_remote(line, stage.folder / "in") for line in stage.lines]
        listed = write_list(stage.folder, lines, "remote.txt")
        batch = stage.start(case, *stage.local, sources=listed, environment=environment)

        def ended() -> int:
            there = files.glob(f"{_BUCKET}/case/status/*.json")
            return len(there)

        _wait_until(lambda: ended() >= stage.count // 4, "a quarter done")
        at = ended()
        proxy.shut()
        time.sleep(stage.cut_s)
        proxy.open()
        code, summary = batch.finish()
        _check(code == 0, f"exit {code}: {summary}")
        copy = stage.folder / "store"
        files.get(f"{_BUCKET}/case/", f"{copy}/", recursive=True)
    # A status names the source, and that lies elsewhere.
    found = digests(copy, statuses=False)
    right = {k: v for k, v in stage.right.items() if not k.startswith("status/")}
    wrong = sorted(found.items() ^ right.items())
    _check(not wrong, f"{len(wrong)} files differ, the first {wrong[:1]}")
    return (
        f"cut off for {stage.cut_s:.0f} s after {at} of {stage.count} ({proxy.refused} calls"
        f" refused); {len(found)} files, every SHA-256 equal"
    )


def _remote(line: str, folder: Path) -> str:
    """A line of a list, its source in the bucket; a folder is named with a slash."""
    name, _, options = line.partition(" ")
    slash = "/" if (folder / name).is_dir() else ""
    return f"s3://{_BUCKET}/in/{name}{slash} {options}"


def poisoned(stage: Stage) -> str:
    """Poison among the sources is named, and hurts nobody else."""
    good = stage.lines[: stage.count - _POISONS]
    bad = poison(stage.folder / "in")
    step = max(1, len(good) // _POISONS)
    lines = [
        line
        for k, line in enumerate(good)
        for line in [line, *bad[k // step : k // step + (k % step == 0)]]
    ]
    listed = write_list(stage.folder / "in", lines, "poisoned.txt")
    case = stage.folder / "poison"
    words = ("--time-limit", "60", "--memory", "2048")
    code, summary = stage.start(case, *stage.local, *words, sources=listed).finish()
    _check(code == 3, f"exit {code}: {summary}")
    _check(summary["done"] == len(good), f"not all that are good: {summary}")
    failed = [
        status
        for path in sorted((case / "status").glob("*.json"))
        if (status := json.loads(path.read_bytes()))["state"] == "failed"
    ]
    _check(len(failed) == len(bad), f"{len(failed)} named, not {len(bad)}")
    unlike = digests(case).items() - stage.right.items()
    wrong = [key for key, _ in unlike if not _is_failure(case / key)]
    _check(not wrong, f"{len(wrong)} files differ, the first {wrong[:1]}")
    named = "\n".join(
        f"{'':12}{one['source'].rpartition('/')[2]}: {one['reason']}" for one in failed
    )
    return f"{len(good)} right, {len(failed)} named, exit {code}\n{named}"


def _is_failure(path: Path) -> bool:
    return (
        path.parent.name == "status" and json.loads(path.read_bytes())["state"] == "failed"
    )


SHOWS: dict[str, Callable[[Stage], str]] = {
    "engines": engines,
    "node": node,
    "driver": driver,
    "store": store,
    "poison": poisoned,
}


def show(names: list[str], stage: Stage) -> int:
    """Show them; 1 if one of them is not so."""
    bad = 0
    for name in names or list(SHOWS):
        begun = time.monotonic()
        try:
            found = SHOWS[name](stage)
        except NotShownError as error:
            bad, found = 1, f"NOT SHOWN: {error}"
        except ImportError as error:
            found = f"skipped: {error}"
        print(f"{name:9} {found} ({time.monotonic() - begun:.0f} s)", flush=True)
    return bad
