"""What the first reading says of how well bodies can be found in a recording."""

from __future__ import annotations

from dataclasses import dataclass

GOOD = "good"
MOST_FOREGROUND = 0.4
"""Where more of the picture than this is foreground, it is not bodies that change it."""


@dataclass(frozen=True)
class Measure:
    """One thing that was measured.

    Attributes:
        name: what.
        value: the figure.
        verdict: ``good``, or what is wrong and what to do.
    """

    name: str
    value: float
    verdict: str = GOOD


def measures(
    foreground: float, sightings: int, usual: bool, upright: bool, noisy: bool
) -> list[Measure]:
    """The measures of a first reading.

    Args:
        foreground: mean share of the picture that is foreground.
        sightings: how many bodies were seen clean.
        usual: the usual size of bodies was learnt.
        upright: the sizes of upright bodies on a plane were learnt.
        noisy: the camera's noise decides what is foreground.
    """
    changed = sized = shaped = grain = GOOD
    if foreground > MOST_FOREGROUND:
        changed = (
            f"{foreground:.0%} of the picture differs from its background: the camera moves, or"
            " light and colours change as a whole; record such spans apart, or give"
            " --detect onnx a model"
        )
    if foreground > 0 and not usual:
        sized = (
            f"only {sightings} bodies were seen clean: how large they are is not known, and their"
            " pieces stay apart; --detect onnx with a model, or --detect threshold for animals"
            " on an even ground, may do better"
        )
    if usual and not upright:
        shaped = (
            "bodies are not upright on one plane: merged ones are divided by area alone"
        )
    if noisy:
        grain = "noise decides what is foreground; pictures are smoothed"
    return [
        Measure("foreground_share", round(foreground, 6), changed),
        Measure("clean_sightings", float(sightings), sized),
        Measure("upright_bodies", float(upright), shaped),
        Measure("noise", float(noisy), grain),
    ]
