"""The configuration of a replay: every section of every method, and what of the machine can change a result."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from importlib import metadata
from pathlib import Path
from typing import Any

import msgspec

from reasoning import reasoner
from recorders import recording
from recorders.errors import UsageError
from recorders.parameters import Config, Parameters, as_plain, configure
from recorders.vision import cv2
from replay import hindsight
from replay.trackers.catalogue import TRACKER_SECTIONS, TRACKERS

DEFAULT_TRACKER = "events"
# Packages whose numbers or orders can reach a result.
DECISIVE_PACKAGES = ("scenetrace", "numpy", "opencv-python-headless", "scipy", "networkx", "filterpy", "av")
_BUILD_FACTS = ("Version control", "CPU/HW features", "Baseline", "JPEG", "PNG", "Intel IPP", "Parallel framework")


def sections(tracker: str) -> dict[str, type[Parameters]]:
    """The parameter sections that a replay with this tracker reads."""
    if tracker not in TRACKERS:
        raise UsageError(f"unknown tracker {tracker!r}; there are: {', '.join(TRACKERS)}")
    return {**TRACKER_SECTIONS[tracker], **reasoner.SECTIONS, **hindsight.SECTIONS}


def all_sections() -> dict[str, type[Parameters]]:
    """Every section of every command: what `scenetrace config` prints and a configuration file may hold."""
    every = dict(recording.SECTIONS)
    for tracker in TRACKERS:
        every.update(sections(tracker))
    return every


def replay_config(
    tracker: str,
    file: str | Path | None = None,
    assignments: Iterable[str] = (),
    values: Mapping[str, Mapping[str, Any]] | None = None,
) -> Config:
    """The whole configuration of a replay.

    Raises:
        UsageError: unknown tracker, parameter, or a value out of range.
    """
    return configure(sections(tracker), file, assignments, values, all_sections())


def package_versions() -> dict[str, str]:
    """Versions of the packages that can change a result, by name."""
    found = {}
    for name in sorted(DECISIVE_PACKAGES):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "absent"
    return found


def opencv_build() -> str:
    """The lines of OpenCV's build information that say which kernels it may pick."""
    lines = []
    for line in cv2.getBuildInformation().splitlines():
        key, _, value = line.strip().partition(":")
        if key in _BUILD_FACTS and value.strip():
            lines.append(f"{key}: {' '.join(value.split())}")
    return "; ".join(lines)


def fingerprint(tracker: str, config: Mapping[str, Parameters]) -> str:
    """SHA-256 of everything but the recording that a result depends on: a checkpoint of another one is refused."""
    facts = [tracker, as_plain(config), package_versions()]
    return hashlib.sha256(msgspec.json.encode(facts, order="deterministic")).hexdigest()


def uses_hindsight(tracker: str, config: Mapping[str, Parameters]) -> bool:
    """Whether the hindsight step follows the forward pass: the tracker's own switch, off where it has none."""
    return bool(getattr(config.get(tracker), "hindsight", False))
