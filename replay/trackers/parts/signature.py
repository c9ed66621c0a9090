"""A compact form of a target's colours for the hindsight step."""

from __future__ import annotations

from replay.trackers.parts.features import PartsModel

_SIDES = ((1, 2), (3, 4))
_HSV = 3


def signature(model: PartsModel, row: int) -> list[int]:
    """H, S and V histograms of torso and legs, 96 counts; [] where nothing is known of one of
    them.
    """
    out: list[int] = []
    for left, right in _SIDES:
        both = model.colours[row, left, :_HSV] + model.colours[row, right, :_HSV]
        if not both.any():
            return []
        out += both.ravel().tolist()
    return out
