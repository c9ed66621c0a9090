"""What two readings say of how well bodies can be found in a recording."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from recorders.pictures import Image
from recorders.quality import FAIR, GOOD, PIECES, POOR, QualityMeasure, graded
from recorders.segmentation.tally import Tally
from recorders.vision import cv2

MOST_FOREGROUND = 0.4
"""Where more of the picture than this is foreground, it is not bodies that change it."""
LEAST_FOREGROUND = 0.001
"""Where less of it is, on the mean, too little moves to say that bodies are not found."""
FOREGROUND, SIZES = "foreground_share", "clean_sightings"
UNEXPLAINED = "unexplained_share"
SAID = (FOREGROUND, SIZES, "unseen_share", PIECES, UNEXPLAINED, "flicker")
"""With a poor verdict on these most of what is found may be wrong, the first being the worst."""
STAYS_S, STAYS_SHARE = 10.0, 1 / 3
"""Something never moves if it rests for so long, and for this share of the recording."""
STANDS_S = 300.0
"""The background takes up what rests for about twice as long."""
SPECK = 0.01
"""A piece has at least this share of a body's area."""
DETECTOR = "a detector (--detect motion,onnx --model FILE)"


def measures(
    foreground: float,
    sightings: int,
    usual: bool,
    upright: bool,
    noisy: bool,
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
            f"{POOR}: {foreground:.0%} of the picture differs from its background: the camera"
            " moves, or light and colours change as a whole, or leaves and water fill it; record"
            " such spans apart, give a region of interest (--regions FILE), or a detector"
            " (--detect onnx --model FILE)"
        )
    if foreground >= LEAST_FOREGROUND and not usual:
        sized = (
            f"{POOR}: {sightings} bodies were seen clean, too few to learn how large they are:"
            f" their pieces stay apart; give {DETECTOR}, or for"
            " animals on an even ground --detect threshold"
        )
    if usual and not upright:
        shaped = (
            f"{FAIR}: bodies are not upright on one plane: merged ones are divided by area alone;"
            f" where they overlap much, {DETECTOR} tells them apart"
        )
    if noisy:
        grain = (
            f"{FAIR}: noise decides what is foreground: pictures are smoothed, and what is small"
            f" or pale may be missed; {DETECTOR} may find it"
        )
    return [
        QualityMeasure(FOREGROUND, round(foreground, 6), changed),
        QualityMeasure(SIZES, float(sightings), sized),
        *([QualityMeasure("upright_bodies", float(upright), shaped)] if usual else []),
        QualityMeasure("noise", float(noisy), grain),
    ]


def pieces_of(mask: Image, body_area: float) -> int:
    """How many regions of a mask are no specks beside a body of an area, px."""
    areas = cv2.connectedComponentsWithStats(mask, connectivity=8)[2][1:, cv2.CC_STAT_AREA]
    return int(np.count_nonzero(areas >= SPECK * body_area))


def of_masks(
    pieces: float, unexplained: float, waving: float, bodies: int
) -> list[QualityMeasure]:
    """The measures of the first reading's masks.

    Args:
        pieces: regions of the mask for each body that was found in it.
        unexplained: the share of the foreground that is in no body.
        waving: the share of the picture whose background changes by itself.
        bodies: how many were found.
    """
    told = []
    if bodies:
        broken = f"bodies lie in {pieces:.1f} pieces: they look like the ground; {DETECTOR} helps"
        loose = (
            f"{unexplained:.0%} of the foreground is in no body: shadows, specks or parts of"
            f" bodies are left out; {DETECTOR} helps"
        )
        told = [
            QualityMeasure(PIECES, round(pieces, 3), graded(pieces, 2.5, 8.0, broken)),
            QualityMeasure(
                UNEXPLAINED, round(unexplained, 4), graded(unexplained, 0.15, 0.3, loose)
            ),
        ]
    moving = (
        f"{waving:.0%} of the ground changes by itself (leaves, water, flicker, crowds): bodies"
        " before it may be missed; leave it out with a region of interest (--regions FILE)"
    )
    return [
        *told,
        QualityMeasure("waving_ground", round(waving, 4), graded(waving, 0.1, 0.3, moving)),
    ]


def of_tally(tally: Tally) -> list[QualityMeasure]:
    """The measures of a second reading."""
    still = tally.still_share(STAYS_S, STAYS_SHARE)
    rest = tally.longest_rest_s()
    stays = (
        f"{still:.0%} of what is found never moves: people who stand or sit, or shadows and rims;"
        " look at it, and leave it out with a region of interest (--regions FILE) if it is nobody"
    )
    stands = (
        f"something rests for {rest:.0f} s in one place: what rests for some {2 * STANDS_S:.0f} s"
        f" becomes background; {DETECTOR} keeps it"
    )
    flickers = (
        f"{tally.flicker:.0%} of the detections are not there in the frame before or after: specks,"
        f" or bodies that move far between frames; more frames per second, or {DETECTOR}"
    )
    return [
        QualityMeasure(
            "flicker", round(tally.flicker, 4), graded(tally.flicker, 0.15, 0.4, flickers)
        ),
        QualityMeasure("never_moves", round(still, 4), graded(still, 0.2, 0.7, stays)),
        QualityMeasure(
            "longest_rest_s", round(rest, 2), graded(rest, STANDS_S, 2 * STANDS_S, stands)
        ),
        *_of_changes(tally),
    ]


def _of_changes(tally: Tally) -> list[QualityMeasure]:
    """How often the picture changed as a whole."""
    low, high = tally.levels
    wander = max(high / max(low, 0.01) - 1, 0.0)
    shakes = (
        f"the camera shakes by up to {tally.largest_shift} pixels, in {tally.shaken:.0%} of the"
        " frames: compensated for in whole pixels; mount it more firmly"
    )
    light = (
        f"the light goes from {low:.0%} to {high:.0%} of what is usual: compensated for where it"
        " changes alike everywhere; a fixed exposure helps"
    )
    unseen = (
        f"{tally.unseen:.0%} of the frames show no view that is known: nothing is found in them;"
        " record each view by itself"
    )
    rows = [
        ("camera_shakes", tally.shaken, graded(tally.shaken, 0.02, 0.9, shakes)),
        ("light_wanders", wander, graded(wander, 0.2, 9.0, light)),
        ("unseen_share", tally.unseen, graded(tally.unseen, 0.001, 0.25, unseen)),
    ]
    for name, kinds, what in COUNTED:
        count = sum(tally.told[kind] for kind in kinds)
        times = "once" if count == 1 else f"{count} times"
        text = f"{what} {times}; the events scene_changed say when"
        rows.append((name, float(count), graded(count, 1, 50, text)))
    return [QualityMeasure(n, round(value, 4), verdict) for n, value, verdict in rows]


COUNTED = (
    ("light_changes", ("light",), "the light was switched or changed"),
    ("infrared_changes", ("infrared", "colour"), "the picture turned grey or coloured"),
    ("camera_moves", ("moved", "panned"), "the camera was moved or turned"),
    ("signal_losses", ("signal_lost", "frozen"), "the signal was lost or frozen"),
)
"""What is counted of the changes: its row, their kinds, in words."""


def of_detector(boxes: int, found: int) -> QualityMeasure:
    """How far a detector and the masks agree: of so many boxes so many have a body in the mask."""
    share = 1 - found / boxes if boxes else 0.0
    text = (
        f"{share:.0%} of the detector's boxes have no body in the masks: one of them misses bodies,"
        " or sees some where there are none; look at both"
    )
    return QualityMeasure("detector_alone", round(share, 4), graded(share, 0.4, 0.7, text))


def of_gaps(gaps: Sequence[int]) -> QualityMeasure:
    """How often nothing was recorded for a time: the gaps' lengths in ns."""
    longest = max(gaps, default=0) / 1e9
    times = "once" if len(gaps) == 1 else f"{len(gaps)} times"
    text = (
        f"nothing was recorded for a time, {times}, for {longest:.0f} s at most; who was there"
        " meanwhile is not known; the events scene_changed say when"
    )
    return QualityMeasure("gaps", float(len(gaps)), graded(len(gaps), 1, 50, text))


def overall(measured: Sequence[QualityMeasure]) -> QualityMeasure:
    """One verdict for the whole: as bad as the worst measure that speaks of most of what is found,
    else fair where anything is not good. Its value is how many measures are not good.
    """
    bad = [one for one in measured if one.bad]
    poor = [one for one in bad if one.grade == POOR and one.name in SAID]
    verdict = GOOD
    if bad:
        names = ", ".join(one.name for one in (poor or bad))
        verdict = f"{POOR if poor else FAIR}: see {names}"
    return QualityMeasure("overall", float(len(bad)), verdict)


def worst(measured: Sequence[QualityMeasure]) -> QualityMeasure | None:
    """What a person should be told of when it is measured, None where nothing is that wrong."""
    poor = {one.name: one for one in measured if one.grade == POOR}
    return next((poor[name] for name in SAID if name in poor), None)


def changes_told(tally: Tally) -> str:
    """In one line, how the picture changed as a whole; "" where it did not."""
    rows = [row for row in _of_changes(tally) if row.bad and row.name != "unseen_share"]
    return "; ".join(row.verdict.partition(": ")[2] for row in rows)
