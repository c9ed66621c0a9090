"""What the first reading says of how well bodies can be found in a recording."""

from __future__ import annotations

from collections.abc import Sequence

from recorders.quality import GOOD, QualityMeasure

MOST_FOREGROUND = 0.4
"""Where more of the picture than this is foreground, it is not bodies that change it."""
LEAST_FOREGROUND = 0.001
"""Where less of it is, on the mean, too little moves to say that bodies are not found."""
FOREGROUND, SIZES = "foreground_share", "clean_sightings"
SAID = (FOREGROUND, SIZES)
"""With a bad verdict on these most of what is found may be wrong, the first being the worse."""


def measures(
    foreground: float, sightings: int, usual: bool, upright: bool, noisy: bool
) -> list[QualityMeasure]:
    """The measures of a first reading; whether bodies are upright only where their size was learnt.

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
            " light and colours change as a whole, or leaves and water fill it; record such spans"
            " apart, give a region of interest (--regions FILE), or a detector (--detect onnx"
            " --model FILE)"
        )
    if foreground >= LEAST_FOREGROUND and not usual:
        sized = (
            f"{sightings} bodies were seen clean, too few to learn how large they are: their pieces"
            " stay apart; give a detector (--detect motion,onnx --model FILE), or for"
            " animals on an even ground --detect threshold"
        )
    if usual and not upright:
        shaped = (
            "bodies are not upright on one plane: merged ones are divided by area alone; where"
            " they overlap much, a detector (--detect motion,onnx --model FILE) tells them apart"
        )
    if noisy:
        grain = (
            "noise decides what is foreground: pictures are smoothed, and what is small or pale may"
            " be missed; a detector (--detect motion,onnx --model FILE) may find it"
        )
    return [
        QualityMeasure(FOREGROUND, round(foreground, 6), changed),
        QualityMeasure(SIZES, float(sightings), sized),
        *([QualityMeasure("upright_bodies", float(upright), shaped)] if usual else []),
        QualityMeasure("noise", float(noisy), grain),
    ]


def worst(measured: Sequence[QualityMeasure]) -> QualityMeasure | None:
    """What a person should be told of when it is measured, None where nothing is that wrong."""
    bad = {one.name: one for one in measured if one.bad}
    return next((bad[name] for name in SAID if name in bad), None)
