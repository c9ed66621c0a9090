"""Who was socially together: encounters between two targets, from their boxes alone, in hindsight or live."""

from reasoning.encounters.encounters import (
    KINDS,
    Encounter,
    EncounterParameters,
    Phase,
    find_encounters,
)
from reasoning.encounters.pair import History
from reasoning.encounters.states import Stretch, near, still

__all__ = [
    "KINDS",
    "Encounter",
    "EncounterParameters",
    "History",
    "Phase",
    "Stretch",
    "find_encounters",
    "near",
    "still",
]
