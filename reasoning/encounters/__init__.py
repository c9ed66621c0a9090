"""Who was socially together: encounters between two targets, from their boxes alone, in hindsight
or live.
"""

from reasoning.encounters.encounters import Encounter, find_encounters
from reasoning.encounters.pair import History
from reasoning.encounters.parameters import EncounterParameters
from reasoning.encounters.phases import KINDS, PHASES, SAME_WAY, Abrupt, Phase
from reasoning.encounters.states import Stretch, near, still

__all__ = [
    "KINDS",
    "PHASES",
    "SAME_WAY",
    "Abrupt",
    "Encounter",
    "EncounterParameters",
    "History",
    "Phase",
    "Stretch",
    "find_encounters",
    "near",
    "still",
]
