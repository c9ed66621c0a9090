"""One job from its source to its place in the case, in a process of its own.

Everything is made in a folder beside the case and put there at the end: logs, tables, and the
status last. What is put is a function of the source and the configuration, so that a job that is
done twice by two workers leaves what one would have left.
"""

from __future__ import annotations

import io
import os
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import msgspec

from recorders.errors import SceneTraceError, SourceError
from recorders.files import sha256
from recorders.stores import (
    NoSuchKeyError,
    RemoteStore,
    Store,
    StoreError,
    is_uri,
    open_store,
)
from replay.batch.jobs import (
    Job,
    Outcome,
    Status,
    digest_of,
    source_digest,
    split_uri,
    stamp_of,
)
from replay.batch.scratch import work_of

Command = Callable[[Sequence[str]], int]
_DONE, _LEFT_OUT = 0, 3


class StepFailedError(SceneTraceError):
    """A command of a job failed; its own message."""


def do(job: Job, command: Command) -> Outcome:
    """Do a job.

    Args:
        job: what to do.
        command: runs ``record`` and ``replay`` as the command line does: words to exit code.

    Returns:
        how it ended; its status lies in the case, unless the case cannot be written.
    """
    begun = time.monotonic()
    for path in reversed(job.paths):
        if path not in sys.path:
            sys.path.insert(0, path)
    steps = _Steps(job, command)
    known = again = False
    try:
        status = steps.run()
        known = steps.known
    except StoreError as error:
        status, again = steps.failed(error), True
    except SceneTraceError as error:
        status = steps.failed(error)
    except MemoryError:
        status = steps.failed(_out_of_memory(job))
    except OSError as error:
        what = f"{error.filename}: {error.strerror}" if error.filename else str(error)
        status, again = steps.failed(SceneTraceError(what)), True
    except (
        Exception
    ) as error:  # a plug-in's, or a fault of ours: told, and the batch goes on
        text = (str(error) or type(error).__name__).splitlines()[0]
        status = steps.failed(SceneTraceError(f"{type(error).__name__}: {text}"))
    return Outcome(status, known, again, time.monotonic() - begun)


def _out_of_memory(job: Job) -> SceneTraceError:
    return SceneTraceError(
        f"needs more than {job.limit.memory_mib} MiB of memory (--memory)"
    )


class _Steps:
    """A job's steps; knows at which one it stands."""

    def __init__(self, job: Job, command: Command) -> None:
        self.job = job
        self.known = False
        self._command = command
        self._step = "source"
        # Until the source was read, its name stands for it.
        self._digest = digest_of(f"name {job.source}", job.configuration)
        self._stamp = ""
        self._said: list[str] = []
        self._left_out = False
        self._place: Path | None = None
        self._copy: Path | None = None

    def failed(self, error: SceneTraceError) -> Status:
        job = self.job
        return Status(
            "failed", self._digest, job.source, self._stamp, job.configuration,
            reason=self._told(str(error).splitlines()[0]), step=self._step,
            said=[self._told(line) for line in self._said],
        )  # fmt: skip

    def run(self) -> Status:
        job = self.job
        store = open_store(job.case)
        with tempfile.TemporaryDirectory(
            prefix=work_of(os.getpid()), dir=store.workplace(), ignore_cleanup_errors=True
        ) as folder:
            place = Path(folder)
            self._place = place
            source = self._found(place / "source")
            self._digest = digest_of(source_digest(source), job.configuration)
            before = read_status(store, self._digest)
            if before is not None and (before.state == "done" or not job.again):
                self.known = True
                return before
            name = f"{_plain(job.source)}-{self._digest[:8]}"
            # The annotated log names its scene log: as it will be called in the case.
            scene = self._recorded(source, place / "scene" / f"{name}.mcap")
            annotated = self._replayed(scene, place / "annotated" / f"{name}.mcap")
            return self._published(store, place, name, scene, annotated)

    def _found(self, place: Path) -> Path:
        """The source here: itself, or a copy of a remote one."""
        source = self.job.source
        try:
            self._stamp = stamp_of(source)
            if not is_uri(source):
                return Path(source)
            self._copy = _fetched(source, place)
        except NoSuchKeyError as error:
            hint = "" if source.endswith("/") else f"; a folder has a slash: {source}/"
            raise SourceError(f"there is no such file{hint}", source) from error
        return self._copy

    def _told(self, line: str) -> str:
        """A message without the temporary folder's name: the same job says the same."""
        if self._copy is not None:
            line = line.replace(str(self._copy), self.job.source)
        return line if self._place is None else line.replace(f"{self._place}/", "")

    def _recorded(self, source: Path, scene: Path) -> Path:
        if _is_ours(source):
            return source
        self._step = "record"
        scene.parent.mkdir()
        self._run(["record", str(source), "-o", str(scene), *self.job.record])
        return scene

    def _replayed(self, scene: Path, annotated: Path) -> Path:
        self._step = "replay"
        annotated.parent.mkdir()
        if _is_annotations_alone(scene):
            shutil.copyfile(scene, annotated)
            self._said.append(f"{scene.name}: without detections, so it is taken as it is")
            return annotated
        self._run(["replay", str(scene), "-o", str(annotated), *self.job.replay])
        return annotated

    def _run(self, words: Sequence[str]) -> None:
        said, nothing = io.StringIO(), io.StringIO()
        try:
            with redirect_stderr(said), redirect_stdout(nothing):
                code = self._command(words)
        finally:
            lines = [line for line in said.getvalue().splitlines() if line.strip()]
            self._said += lines
        if code not in (_DONE, _LEFT_OUT):
            told = [line for line in lines if "error:" in line] or lines
            raise StepFailedError(
                told[-1].partition("error: ")[2] or told[-1]
                if told
                else f"{words[0]} failed with exit code {code}"
            )
        self._left_out |= code == _LEFT_OUT

    def _published(
        self, store: Store, place: Path, name: str, scene: Path, annotated: Path
    ) -> Status:
        from reasoning.questions import catalogue

        self._step = "tables"
        job, kept = self.job, self.job.keep
        key = f"annotated/{name}.mcap"
        shown = job.source if kept == "tables" else key
        made = catalogue.write_tables(
            annotated, place, name=name, digest=self._digest, shown_path=shown
        )
        self._step = "publish"
        outputs: dict[str, str] = {}

        def put(path: Path, key: str) -> None:
            outputs[key] = sha256(path)
            store.put(path, key)

        made_here = scene.is_relative_to(place / "scene")
        if kept == "all" and made_here:
            put(scene, f"scene/{name}.mcap")
        if kept != "tables":
            put(annotated, key)
        for table in catalogue.tables_in_order():
            for piece, _ in made:
                put(place / piece.key(table), piece.key(table))
        status = Status(
            "done", self._digest, job.source, self._stamp, job.configuration,
            recordings=[facts.recording for _, facts in made], outputs=outputs,
            frames=sum(facts.frames for _, facts in made), left_out=self._left_out,
            said=[self._told(line) for line in self._said],
        )  # fmt: skip
        store.write(status.key, msgspec.json.format(msgspec.json.encode(status)))
        return status


def _fetched(source: str, place: Path) -> Path:
    """A copy of a remote source, under its own name."""
    parent, name = split_uri(source)
    out = place / (name or parent.rpartition("/")[2])
    place.mkdir()
    store = open_store(parent)
    if name:
        store.fetch(name, out)
    else:
        assert isinstance(store, RemoteStore)
        store.fetch_all(out)
    return out


def read_status(store: Store, digest: str) -> Status | None:
    """A job's status in a case, None where there is none (or none that can be read)."""
    key = f"status/{digest}.json"
    if not store.exists(key):
        return None
    try:
        return msgspec.json.decode(store.read(key), type=Status)
    except msgspec.MsgspecError:
        return None


def _is_ours(path: Path) -> bool:
    """Whether a file is a scene log or an annotated log, which need no recording."""
    if not path.is_file() or path.suffix.lower() != ".mcap":
        return False
    from recorders.format_version import RECORDS
    from recorders.log import LogReader

    with LogReader(path) as log:
        return any(name in RECORDS for name, _ in log.metadata())


def _is_annotations_alone(path: Path) -> bool:
    """Whether a log has tracks and no detections to replay (`replay --annotations-only`)."""
    from recorders.log import LogReader

    with LogReader(path) as log:
        names = {channel.topic.rpartition("/")[2] for channel in log.channels}
    return "tracks" in names and "detections" not in names


def _plain(source: str) -> str:
    """A source's name for people: its stem, with what no file name should hold left out."""
    stem = source.rstrip("/").rpartition("/")[2]
    stem = stem.rpartition(".")[0] or stem
    return re.sub(r"[^\w.-]+", "-", stem).strip("-.")[:80] or "recording"
