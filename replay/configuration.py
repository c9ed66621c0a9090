"""The configuration of a replay: every section of every method, and what of the machine can
change a result.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec

from reasoning import reasoner
from recorders.corrections import Corrections
from recorders.errors import ConfigError, UsageError
from recorders.installed import version_of
from recorders.parameters import Config, Parameters, as_plain, configure
from replay import hindsight
from replay.trackers.catalogue import TRACKERS
from replay.trackers.choice import AnyTracker, TrackerChoice, choose

# Packages whose numbers, orders or encodings can reach a result.
DECISIVE_PACKAGES = (
    "av",
    "filterpy",
    "foxglove-schemas-protobuf",
    "msgspec",
    "networkx",
    "numpy",
    "opencv-python-headless",
    "protobuf",
    "scenetrace",
    "scipy",
)


def sections(tracker: AnyTracker) -> dict[str, type[Parameters]]:
    """The parameter sections that a replay with this tracker reads: its own and everybody's.

    Raises:
        UsageError: there is no such tracker, or it has a section of another's name.
    """
    choice = choose(tracker)
    shared = {**reasoner.SECTIONS, **hindsight.SECTIONS}
    for name, kind in choice.sections.items():
        if shared.get(name, kind) is not kind:
            raise UsageError(
                f"the tracker {choice.name} has a section {name!r}, which is scenetrace's"
                " own: call it otherwise"
            )
    return {**choice.sections, **shared}


def all_sections() -> dict[str, type[Parameters]]:
    """Every section of every command: what `scenetrace config` prints and a configuration file
    may hold.
    """
    from recorders.recording.sections import SECTIONS as RECORD_SECTIONS
    from replay.asking_configuration import ASKING_SECTIONS

    every = {**RECORD_SECTIONS, **ASKING_SECTIONS}
    for tracker in TRACKERS:
        every.update(sections(tracker))
    return every


def replay_config(
    tracker: AnyTracker,
    file: str | Path | None = None,
    assignments: Iterable[str] = (),
    values: Mapping[str, Mapping[str, Any]] | None = None,
) -> Config:
    """The whole configuration of a replay.

    Raises:
        UsageError: unknown tracker, parameter, or a value out of range.
    """
    # Others' sections are asked for where somebody may have named one.
    others = all_sections() if file is not None or values else ()
    return configure(sections(tracker), file, assignments, values, others)


def recorded_config(
    tracker: AnyTracker, values: Mapping[str, Mapping[str, Any]]
) -> tuple[Config, list[str]]:
    """The configuration that a log recorded, as far as today's parameters can hold it, and what
    they cannot.

    A parameter that is unknown now is left out, one whose value is out of today's range takes its
    default, one that is new has its default; each is said with both sides.
    """
    known = sections(tracker)
    now = as_plain(configure(known))
    kept: dict[str, dict[str, Any]] = {name: {} for name in known}
    notes: list[str] = []
    gone = [
        section
        for section in sorted(values)
        if section not in known and len(values[section]) > 1
    ]
    notes += [
        f"configuration: the section {s} was there, no parameter of it is read now"
        for s in gone
    ]
    for section, name in sorted(
        (s, field) for s, fields in values.items() if s not in gone for field in fields
    ):
        value = values[section][name]
        if section not in known or name not in now[section]:
            notes.append(
                f"configuration: {section}.{name} was {value!r}, there is no such parameter"
                " any more"
            )
            continue
        try:
            configure({section: known[section]}, values={section: {name: value}})
        except ConfigError as error:
            notes.append(
                f"configuration: {section}.{name} was {value!r}, is"
                f" {now[section][name]!r}: {error}"
            )
        else:
            kept[section][name] = value
    for section, fields in now.items():
        if section not in values and len(fields) > 1:
            notes.append(
                f"configuration: the section {section} was absent, its parameters have"
                " their defaults"
            )
            continue
        missing = [name for name in fields if name not in values.get(section, {})]
        notes += [
            f"configuration: {section}.{name} was absent, is {fields[name]!r}"
            for name in missing
        ]
    return configure(known, values=kept), notes


def package_versions() -> dict[str, str]:
    """Versions of the packages that can change a result, by name."""
    return {name: version_of(name) for name in sorted(DECISIVE_PACKAGES)}


def fingerprint(
    choice: TrackerChoice,
    config: Mapping[str, Parameters],
    corrections: Corrections | None = None,
) -> str:
    """SHA-256 of everything but the recording that a result depends on: a checkpoint of another
    one is refused.
    """
    facts = [choice.name, as_plain(config), package_versions()]
    if choice.version:
        facts.append(choice.version)
    if corrections is not None:
        facts.append({"corrections": corrections.digest})
    return hashlib.sha256(msgspec.json.encode(facts, order="deterministic")).hexdigest()
