"""The views of a recording: which of its pictures show one place, in colours or in grey.

A bumped or shaken camera shows its view shifted; infrared light shows it in grey; a camera that
was turned shows another one. Each view has a background of its own.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.change.landmarks import (
    NO_SIGHT,
    Ints,
    LandmarkSight,
    Reference,
    Shift,
    noise_of,
    shifted,
)
from recorders.segmentation.change.light import coloured_share, light_of, one_colour_share
from recorders.segmentation.change.steady import steady_view
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

KNOWN_AGAIN = 0.35
"""A picture shows a view if this share of the view's landmarks is seen."""
SURE = 0.75
"""Nothing better is looked for where this part of the share of landmarks that is usual is seen:
windows in a row are like one another a few pixels aside as well.
"""
CLEARLY_MORE = 1.25
"""Under a shift that shows the view well another one is better only if it shows so many times as
many landmarks: bodies that cover some of them look like others by chance, a pixel aside.
"""
MOST_STEPS = 3
"""Searches nearby that go on from where the one before came to."""
LOST = 0.2
"""A view is lost when fewer of its landmarks are seen, or 0.4 of the usual share if that is less."""
ONE_COLOUR, MORE_OF_IT = 0.8, 0.2
"""The signal is lost if so much of the picture has one colour, and so much more than usual."""
COLOURED, TURNS_COLOURED, TURNS_GREY = 0.25, 0.625, 0.0625
"""The first picture has colours from this share of coloured cells on; a grey view turns coloured, a
coloured one grey, at these, or at three quarters of what it had before: something coloured that passes is no
change of the whole."""
FEWEST_PICTURES = 5
"""A background is learnt from so many pictures at least."""


@dataclass
class CameraPlace:
    """Where a camera looks.

    Attributes:
        number: from 0, in the order in which they are first seen.
        reference: how it is known again.
        usual: the share of its landmarks that is usually seen.
        steady: row and column of the patches that alone may be landmarks, None: any.
    """

    number: int
    reference: Reference
    usual: float = 1.0
    steady: Ints | None = None

    @property
    def least(self) -> float:
        """With fewer of its landmarks it is lost."""
        return min(LOST, 0.4 * self.usual)

    def surely(self, sight: LandmarkSight) -> bool:
        """Whether a sight is as good as any can be expected to be."""
        return shows(sight) and sight.still and sight.share >= SURE * self.usual


@dataclass(frozen=True)
class ViewSeen:
    """What one picture shows.

    Attributes:
        place: the place's number, None where it shows none that was seen before or after.
        shift: against the place's reference.
        coloured: it has colours.
        whole: it lies over the place's reference to a fraction of a pixel.
    """

    place: int | None
    shift: Shift = (0, 0)
    coloured: bool = True
    whole: bool = True


@dataclass
class Division:
    """Pictures by what they show.

    Attributes:
        places: in the order of their first pictures.
        seen: of each picture.
        flat: the share of them that has one colour, usually.
        colours: the share of their cells that has colours, where there are some.
        noise: see `noise_of`.
    """

    places: list[CameraPlace] = field(default_factory=list)
    seen: list[ViewSeen] = field(default_factory=list)
    flat: float = 0.0
    colours: float = 1.0
    noise: float = 0.0


def one_colour_from(usual: float) -> float:
    """The share of a picture that has one colour, from which on it shows nothing; ``usual``: the
    share that is usual in its recording.
    """
    return max(ONE_COLOUR, usual + MORE_OF_IT)


class ColourMode:
    """Whether pictures have colours, one after another, by the share of their cells that have.

    Attributes:
        coloured: the last one had; None: there was none yet.
        usual: the share while there were colours.
    """

    def __init__(self, coloured: bool | None = None, usual: float = 1.0) -> None:
        self.coloured = coloured
        self.usual = usual

    def step(self, share: float) -> bool:
        """Take the next picture's share."""
        if self.coloured is None:
            self.coloured = share >= COLOURED
        elif self.coloured:
            self.coloured = share > TURNS_GREY
        else:
            self.coloured = share >= min(TURNS_COLOURED, 0.75 * self.usual)
        if self.coloured and share >= COLOURED:
            self.usual = share
        return self.coloured


def find(picture: Image, place: CameraPlace, shift: Shift) -> tuple[Shift, LandmarkSight]:
    """The shift under which a picture shows a place, looked for from the last one on; not at all
    where it would be too large.
    """
    reference = place.reference
    best = shift, reference.sight(picture, shift)
    for _ in range(MOST_STEPS):
        if place.surely(best[1]):
            return best
        found = reference.near(picture, best[0])
        if found[0] == best[0] or not _clearly_better(found[1], best[1]):
            break
        if not reference.within(found[0]):
            return shift, NO_SIGHT
        best = found
    if not place.surely(best[1]):
        found = reference.around(picture, shift)
        if found[1].score > best[1].score and _clearly_better(found[1], best[1]):
            best = found
    return best


def _clearly_better(found: LandmarkSight, best: LandmarkSight) -> bool:
    if not (shows(best) and best.still):
        return True
    return found.share >= CLEARLY_MORE * best.share


def shows(sight: LandmarkSight) -> bool:
    """Whether a picture shows a view, unmoved but for the shift."""
    return sight.share >= KNOWN_AGAIN and sight.even


def reference_of(picture: Image, noise: float) -> Reference:
    """What a view is known by after one picture of it, (H, W, 3) uint8 with Y first; ``noise``: see
    `noise_of`.
    """
    return Reference(as_image(cv2.extractChannel(picture, 0)), noise=noise)


def divide(pictures: list[Image]) -> Division:
    """Divide pictures, (H, W, 3) uint8 in Y, Cr, Cb in the order of time, by what they show."""
    made = Division()
    shifts: list[Shift] = []
    last = 0
    colours = ColourMode()
    flat = [one_colour_share(picture)[0] for picture in pictures]
    made.flat = sorted(flat)[len(flat) // 2]
    made.noise = noise_of(pictures)
    for picture, share in zip(pictures, flat, strict=True):
        number, whole = _known(picture, made.places, shifts, last)
        if number is None and share >= one_colour_from(made.flat):
            made.seen.append(ViewSeen(None))
            continue
        coloured = colours.step(coloured_share(picture))
        if number is None:
            reference = reference_of(picture, made.noise)
            if made.places and not reference.known:
                made.seen.append(ViewSeen(None, coloured=coloured))
                continue
            number = len(made.places)
            made.places.append(CameraPlace(number, reference))
            shifts.append((0, 0))
        last = number
        made.seen.append(ViewSeen(number, shifts[number], coloured, whole))
    made.seen = _at_rest(made.seen)
    made.colours = colours.usual
    if len(made.places) > 1:
        _take_together(made, pictures)
    return made


def _take_together(made: Division, pictures: list[Image]) -> None:
    """Pictures that show what is steady, unmoved, are of one place, whatever leaves do there."""
    shown = [k for k, seen in enumerate(made.seen) if seen.place is not None]
    view = steady_view([pictures[k] for k in shown])
    if view is None:
        return
    luma, steady = view
    reference = Reference(luma, among=steady)
    for k in shown:
        sight = reference.sight(pictures[k], (0, 0))
        if shows(sight) and sight.still and (reference.known or reference.lit(pictures[k])):
            made.seen[k] = replace(made.seen[k], place=-1, shift=(0, 0))
    here = CameraPlace(-1, reference, steady=steady)
    every = {place.number: place for place in (here, *made.places)}
    order = [
        number for number in dict.fromkeys(s.place for s in made.seen) if number is not None
    ]
    made.seen = [
        s if s.place is None else replace(s, place=order.index(s.place)) for s in made.seen
    ]
    made.places = [replace(every[number], number=k) for k, number in enumerate(order)]


def _known(
    picture: Image, places: list[CameraPlace], shifts: list[Shift], last: int
) -> tuple[int | None, bool]:
    """The number of the place that a picture shows, and whether it is shifted by a whole number of
    pixels; its shift goes into ``shifts``.
    """
    order = sorted(places, key=lambda place: (place.number != last, -place.number))
    for place in order:
        shift, sight = find(picture, place, shifts[place.number])
        if shows(sight):
            shifts[place.number] = shift
            return place.number, sight.whole
    for place in order:
        shift, sight = place.reference.anywhere(picture)
        if shows(sight):
            shifts[place.number] = shift
            return place.number, sight.whole
    agreeing = (p.number for p in order if p.reference.agrees(picture))
    return next(agreeing, None), True


def _at_rest(seen: list[ViewSeen]) -> list[ViewSeen]:
    """The same with each place's most usual shift as its zero; of equal ones the first."""
    zero: dict[int | None, Shift] = {}
    for place in dict.fromkeys(s.place for s in seen):
        shifts = [s.shift for s in seen if s.place == place]
        zero[place] = max(shifts, key=shifts.count)
    return [
        replace(s, shift=(s.shift[0] - zero[s.place][0], s.shift[1] - zero[s.place][1]))
        for s in seen
    ]


def aligned(pictures: list[Image], shifts: list[Shift]) -> list[Image]:
    """Pictures of one view, each moved to where its reference lies and put in one light."""
    whole = _whole(pictures, shifts)
    moved = [
        shifted(picture, (-shift[0], -shift[1]), whole) if any(shift) else picture
        for picture, shift in zip(pictures, shifts, strict=True)
    ]
    levels = [light_of(picture, whole).level for picture in moved]
    usual = moved[int(np.argsort(levels, kind="stable")[len(levels) // 2])]
    lights = [light_of(picture, usual) for picture in moved]
    return [
        light.off(picture) if light.gain != 1.0 else picture
        for picture, light in zip(moved, lights, strict=True)
    ]


def _whole(pictures: list[Image], shifts: list[Shift]) -> Image:
    """The view as far as any of the pictures shows it: what the first of each shift shows, those of
    the usual shifts over the others.
    """
    whole = pictures[0]
    for shift in sorted(dict.fromkeys(shifts), key=shifts.count):
        picture = pictures[shifts.index(shift)]
        whole = shifted(picture, (-shift[0], -shift[1]), whole)
    return whole
