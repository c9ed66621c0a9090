"""One replay of a scene for a golden test, here or in another process."""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import json
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from recorders import plugins
from recorders.errors import SceneTraceError
from recorders.parameters import Config, as_plain
from replay.annotated_writer import replay
from replay.configuration import replay_config
from replay.run import ReplayOptions
from replay.trackers.choice import AnyTracker, TrackerChoice
from replay.trackers.tracker import TrackerFactory

Values = Mapping[str, Mapping[str, Any]]


@dataclass(frozen=True)
class GoldenJob:
    """What is replayed: a scene, through a tracker, with a configuration."""

    scene: Path
    tracker: TrackerChoice
    config: Config

    @property
    def name(self) -> str:
        """The tracker's name, for sentences."""
        return self.tracker.title

    def options(self, **more: Any) -> ReplayOptions:
        """The replay's options."""
        return ReplayOptions(
            tracker=self.tracker,
            config=self.config,
            annotations_only=True,
            force=True,
            **more,
        )

    def run(self, out: Path, **more: Any) -> str:
        """Replay here, with a fresh instance; the output digest."""
        return replay(self.scene, out, self.options(**more)).output_digest

    def elsewhere(
        self, out: Path, hash_seed: int, watched: bool = False
    ) -> tuple[str, dict[str, Any]]:
        """Replay in a new process with another hash seed; the output digest, and what was seen if
        ``watched``.

        Raises:
            SceneTraceError: the process failed; the text ends with its last words.
            NotImportableError: the tracker cannot be found from another process.
        """
        order = {
            "scene": str(self.scene.resolve()),
            "out": str(out.resolve()),
            "tracker": _address(self.tracker),
            "config": as_plain(self.config),
            "watched": watched,
        }
        path = os.pathsep.join([p or str(Path.cwd()) for p in sys.path])
        done = subprocess.run(
            [sys.executable, "-m", "replay.golden.child_process"],
            input=json.dumps(order),
            capture_output=True,
            text=True,
            check=False,
            env={**os.environ, "PYTHONHASHSEED": str(hash_seed), "PYTHONPATH": path},
        )
        if done.returncode:
            raise SceneTraceError(
                f"{self.name} fails in a process of its own:\n{done.stderr.strip()[-2000:]}"
            )
        answer = json.loads(done.stdout.splitlines()[-1])
        return str(answer["digest"]), answer


def hash_seed() -> int | None:
    """The hash seed of this process, None where it was drawn by chance."""
    seed = os.environ.get("PYTHONHASHSEED", "random")
    return int(seed) if seed.isdigit() else None


class NotImportableError(SceneTraceError):
    """A tracker has no place from which another process could import it."""


def _address(tracker: TrackerChoice) -> str | dict[str, str]:
    """What leads another process to the tracker: a name that is known there, or module, file and
    class.
    """
    factory = tracker.factory
    if not tracker.foreign or tracker.name in plugins.names(plugins.TRACKERS):
        return tracker.name
    name = getattr(factory, "__qualname__", "")
    try:
        file = inspect.getsourcefile(factory)
    except TypeError:
        file = None
    if not name or "<" in name or file is None:
        raise NotImportableError(
            f"{tracker.title} is not at the top level of a module, so no other"
            " process can import it"
        )
    return {"module": str(getattr(factory, "__module__", "")), "file": file, "name": name}


def imported(address: str | Mapping[str, str]) -> str | TrackerFactory:
    """The tracker at an address that `_address` made: by its name, its module's name, or its
    file.
    """
    if isinstance(address, str):
        return address
    try:
        module = importlib.import_module(address["module"])
    except ImportError:
        module = None
    if (
        module is None
        or Path(getattr(module, "__file__", None) or "").resolve()
        != Path(address["file"]).resolve()
    ):
        spec = importlib.util.spec_from_file_location(address["module"], address["file"])
        if spec is None or spec.loader is None:
            raise NotImportableError(f"{address['file']}: not a Python module")
        module = importlib.util.module_from_spec(spec)
        sys.modules[address["module"]] = module
        spec.loader.exec_module(module)
    found: Any = module
    for part in address["name"].split("."):
        found = getattr(found, part)
    factory: TrackerFactory = found
    return factory


def configured(tracker: AnyTracker, values: Values | Config | None) -> Config:
    """A configuration from plain values or parameters; what is not named has its default."""
    plain = {
        section: (
            dict(fields)
            if isinstance(fields, Mapping)
            else as_plain({section: fields})[section]
        )
        for section, fields in (values or {}).items()
    }
    return replay_config(tracker, values=plain)
