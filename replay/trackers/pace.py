"""Time lapse: what is held in seconds for a film is held in pictures where those are rare.

A recording of a picture in ten seconds can be tracked at all only because what moves in it moves
by few of its own sizes from picture to picture. To such a scene a second means little; the step
from one picture to the next is what counts. So from `LONGEST_S` between pictures on, parameters in
seconds are stretched, and rates slowed, as if pictures came every `LONGEST_S`.

>>> from replay.trackers.events.parameters import EventsParameters
>>> lapse = paced(EventsParameters(keep_s=4.0), frame_ns=3_000_000_000)
>>> round(lapse.keep_s)
12
>>> stretch(500_000_000)  # two pictures a second are a film
1.0
"""

from __future__ import annotations

import copy
import dataclasses
from typing import TypeVar

from recorders.parameters import Parameters

LONGEST_S = 1.0
"""A film, however slow, has a picture at least this often: people in it are followed by their speed."""

AnyParameters = TypeVar("AnyParameters", bound=Parameters)


def _power(unit: str) -> int:
    """With which power of a second's length a parameter of this unit grows."""
    if unit == "s":
        return 1
    return -2 if unit.endswith("/s^2") else -1 if unit.endswith("/s") else 0


def stretch(frame_ns: int) -> float:
    """How many times longer than a film's a recording's second is, whose pictures are ``frame_ns``
    apart; 1 for films.
    """
    return max(1.0, frame_ns * 1e-9 / LONGEST_S)


def paced(parameters: AnyParameters, frame_ns: int) -> AnyParameters:
    """Parameters as they hold for a recording: those in seconds, and rates, stretched.

    What the configuration's ranges allow is not asked again: they are meant for films.
    """
    by = stretch(frame_ns)
    if by == 1.0:
        return parameters
    out = copy.copy(parameters)
    for field in dataclasses.fields(parameters):
        power = _power(field.metadata["unit"])
        if power:
            object.__setattr__(out, field.name, getattr(out, field.name) * by**power)
    return out
