"""The parameters of those who ask: of encounters, and of nothing that a replay was made with."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from pathlib import Path

from reasoning.encounters import EncounterParameters
from recorders.parameters import Parameters, as_plain, configure, named

ASKING_SECTIONS: dict[str, type[Parameters]] = {"encounters": EncounterParameters}


def sections_beside(file: str | Path | None) -> Collection[str]:
    """What else a configuration file may hold: who replays knows, and is asked only where there is
    a file.
    """
    if file is None:
        return ()
    from replay.configuration import all_sections

    return all_sections()


def encounter_config(
    file: str | Path | None = None, assignments: Iterable[str] = ()
) -> EncounterParameters:
    """The parameters of the commands that find encounters in annotated logs (`query`, `index`,
    `explain`).

    Raises:
        UsageError: an unknown parameter, or a value out of range.
    """
    others = sections_beside(file)
    found = configure(ASKING_SECTIONS, file, assignments, others=others)["encounters"]
    assert isinstance(found, EncounterParameters)
    return found


def chosen_encounters(
    file: str | Path | None = None, assignments: Iterable[str] = ()
) -> dict[str, float]:
    """Those parameters of encounters that a file or a ``--set`` names, with their values.

    Raises:
        UsageError: as `encounter_config`.
    """
    words = list(assignments)
    values = as_plain({"encounters": encounter_config(file, words)})["encounters"]
    return {name: float(values[name]) for name in named("encounters", file, words)}
