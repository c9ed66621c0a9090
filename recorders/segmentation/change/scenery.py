"""The backgrounds of a recording: one for each view that its camera shows, learnt in hindsight or
on the way.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from recorders.pictures import Image
from recorders.segmentation.background import MIN_SAMPLES, Background, Samples
from recorders.segmentation.change.landmarks import (
    Ints,
    LandmarkSight,
    Reference,
    Shift,
    shifted,
)
from recorders.segmentation.change.steady import steady_view
from recorders.segmentation.change.views import (
    CameraPlace,
    ColourMode,
    Division,
    ViewSeen,
    aligned,
    divide,
    find,
    shows,
)
from recorders.segmentation.change.watch import Look, Watch
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.segmenter import as_image
from recorders.vision import cv2

LIVE_SAMPLES = 40
LIVE_WINDOW_S = 400.0
RELEARN = 8
"""Live, the background is learnt anew when this share, one in so many, of the samples is new."""
ENOUGH_SAMPLES = 10
"""A background that was made of another view's gives way to one of so many pictures of its own."""
GRAIN_PX = 3
"""A camera's noise is that of single pixels, whatever the picture's size."""
JUMP, JUMP_SHARE = 1.5, 0.01
"""Foreground jumps up if it grows by this factor and by this share of the picture."""
BETWEEN_SHARE = 0.1
"""Of pictures that lie one over another to a pixel at best there are more than this share."""
STABLE = 0.5
"""A landmark is kept if it is seen in this share of the pictures."""


def without_grain(picture: Image) -> Image:
    """A picture of a noisy camera without the noise of single pixels."""
    return as_image(cv2.GaussianBlur(picture, (GRAIN_PX, GRAIN_PX), 0))


@dataclass
class ViewBackground:
    """The background of one place, in colours or in grey.

    Attributes:
        background: as learnt so far.
        grainy: pictures are compared with it without their grain.
        past: pictures that it goes on learning from, None: it was learnt in hindsight.
        new: how many of them it does not know yet.
        borrowed: it was made of another view's.
        shaken: its pictures had to be moved to lie over one another, and do so to a pixel at best.
    """

    background: Background
    grainy: bool = False
    past: Samples | None = None
    new: int = 0
    borrowed: bool = False
    shaken: bool = False


@dataclass(frozen=True)
class View:
    """A place as one picture shows it."""

    place: CameraPlace
    ground: ViewBackground
    shift: Shift = (0, 0)
    whole: bool = True

    @property
    def background(self) -> Background:
        """What is behind the bodies."""
        return self.ground.background

    @property
    def inexact(self) -> bool:
        """Picture and background lie over one another to a pixel, and no better."""
        return self.ground.shaken or (any(self.shift) and not self.whole)

    def over_background(self, picture: Image) -> Image:
        """A picture moved to where the background lies, without grain where there is some."""
        here = without_grain(picture) if self.ground.grainy else picture
        if not any(self.shift):
            return here
        right, down = self.shift
        return shifted(here, (-right, -down), self.background.colour)

    def as_in_picture(self, mask: Image) -> Image:
        """A mask (H, W) of the background moved to where the picture lies."""
        return shifted(mask, self.shift, np.zeros_like(mask)) if any(self.shift) else mask

    def follow(self, picture: Image, still: Image) -> None:
        """The background follows a picture where it is still, (H, W) in the picture's place."""
        right, down = self.shift
        if right or down:
            still = shifted(still, (-right, -down), np.zeros_like(still))
        self.background.follow(self.over_background(picture), still)

    def found_again(self, picture: Image) -> View:
        """The same view as another picture, a moment later, shows it."""
        shift, sight = find(picture, self.place, self.shift)
        return View(self.place, self.ground, shift, sight.whole)


class Scenery:
    """The backgrounds, and which of them a picture shows.

    Attributes:
        look: how the last picture was looked at.
    """

    def __init__(self, parameters: SegmentationParameters, fps: float) -> None:
        self._p = parameters
        self._fps = fps
        self._grounds: dict[tuple[int, bool], ViewBackground] = {}
        self._division = Division()
        self._watch = Watch([], fps, colours=ColourMode())
        self._foreground = 0
        self._size = 1
        self.look = Look(None)

    @property
    def grainy(self) -> bool:
        """Noise decides what is foreground in some view."""
        return any(ground.grainy for ground in self._grounds.values())

    @property
    def waving(self) -> float:
        """The largest share of a background that changes by itself."""
        shares = [ground.background.waving for ground in self._grounds.values()]
        return max(shares, default=0.0)

    def asks_less(self) -> None:
        """Less of a difference is foreground, see `Background.asks_less`."""
        for ground in self._grounds.values():
            ground.background.asks_less()

    # -- in hindsight --------------------------------------------------------------------------

    def learn(self, pictures: list[Image]) -> bool:
        """Learn the views and their backgrounds from pictures, (H, W, 3) uint8 in Y, Cr, Cb, spread
        over the whole recording; False where no view is seen in enough of them.
        """
        division = divide(pictures)
        counts = Counter((seen.place, seen.coloured) for seen in division.seen)
        views = [
            view
            for view in dict.fromkeys((s.place, s.coloured) for s in division.seen)
            if view[0] is not None and counts[view] >= MIN_SAMPLES
        ]
        if not views:
            return False
        self._division = division
        for number, coloured in views:
            these = [
                (picture, seen)
                for picture, seen in zip(pictures, division.seen, strict=True)
                if (seen.place, seen.coloured) == (number, coloured)
            ]
            shown = [(picture, seen.shift) for picture, seen in these]
            between = sum(not seen.whole for _, seen in these)
            assert number is not None
            ground = self._in_hindsight(shown)
            moved = len({s for _, s in shown}) > 1
            ground.shaken = moved and between > BETWEEN_SHARE * len(shown)
            self._grounds[number, coloured] = ground
            if counts[number, coloured] >= counts[number, not coloured]:
                _know_by(division.places[number], ground.background, shown)
        known = [p for p in division.places if any(n == p.number for n, _ in views)]
        steady = len({(s.place, s.shift) for s in division.seen}) == 1
        colours = [s.coloured for s in division.seen if s.place is not None]
        self._watch = Watch(
            known,
            self._fps,
            division.flat,
            steady=steady,
            colours=ColourMode(colours[0], division.colours) if any(colours) else None,
            noise=division.noise,
        )
        return True

    def _in_hindsight(self, shown: list[tuple[Image, Shift]]) -> ViewBackground:
        """The background of pictures of one view, each with its shift.

        Where noise decides what is foreground the grain goes before the pictures are put in one
        light: of single noisy pixels no light can be told.
        """
        shifts = [shift for _, shift in shown]
        return self._learnt([p for p, _ in shown], lambda these: aligned(these, shifts))

    def _learnt(
        self, pictures: list[Image], together: Callable[[list[Image]], list[Image]] = list
    ) -> ViewBackground:
        """The background of pictures that are put ``together``; where noise alone decides what is
        foreground, that of pictures without their grain.
        """
        background = self._background(together(pictures))
        if not background.noisy:
            return ViewBackground(background)
        smooth = together([without_grain(picture) for picture in pictures])
        return ViewBackground(self._background(smooth), grainy=True)

    def _background(self, stack: list[Image]) -> Background:
        return Background.learn(stack, self._p.threshold_levels, self._p.spread_weight)

    def of_sample(self, number: int) -> View | None:
        """The view that a picture of those that were learnt from shows."""
        seen = self._division.seen[number]
        return None if seen.place is None else self._view(seen)

    def _view(self, seen: ViewSeen | Look) -> View | None:
        assert seen.place is not None
        ground = self._grounds.get((seen.place, seen.coloured))
        if ground is None:
            return None
        place = next(p for p in self._watch.places if p.number == seen.place)
        return View(place, ground, seen.shift, seen.whole)

    # -- frame by frame ------------------------------------------------------------------------

    def at(self, picture: Image, *, jumped: bool = False) -> View | None:
        """The view that the next picture shows, None where none is known; with ``jumped``, the last
        picture looked at again.
        """
        self._size = picture.shape[0] * picture.shape[1]
        before = self.look
        self.look = self._watch.look(picture, jumped=jumped)
        if self.look.place is None:
            self._foreground = 0
            return None
        if (self.look.place, self.look.coloured) != (before.place, before.coloured):
            self._foreground = self._size
        self._go_on_learning(picture, self.look, again=jumped)
        return self._view(self.look)

    def jumped(self, foreground: int) -> bool:
        """Whether there is so much more foreground, px, than in the frame before, that the picture
        must be looked at, if it was not.
        """
        before, self._foreground = self._foreground, foreground
        grown = foreground > JUMP * before and foreground - before > JUMP_SHARE * self._size
        return grown and not self._watch.looked

    def _go_on_learning(self, picture: Image, look: Look, *, again: bool) -> None:
        assert look.place is not None
        key = look.place, look.coloured
        ground = self._grounds.get(key)
        if ground is None:
            ground = self._grounds[key] = self._begun(picture, key)
        elif ground.past is None or again:
            return
        assert ground.past is not None
        if ground.past.wants_next() and any(look.shift):
            right, down = look.shift
            picture = shifted(picture, (-right, -down), ground.background.colour)
            ground.shaken |= not look.whole
        if not ground.past.add(picture):
            return
        ground.new += 1
        if ground.borrowed and len(ground.past.kept) < ENOUGH_SAMPLES:
            return
        if RELEARN * ground.new > len(ground.past.kept):
            learnt = self._learnt(ground.past.kept)
            ground.background, ground.grainy = learnt.background, learnt.grainy
            ground.new, ground.borrowed = 0, False
            place = next(p for p in self._watch.places if p.number == look.place)
            luma = as_image(cv2.extractChannel(ground.background.colour, 0))
            place.reference = Reference(luma)

    def _begun(self, picture: Image, key: tuple[int, bool]) -> ViewBackground:
        """The ground of a view that nothing was learnt of: of the same place in colours, else
        whatever the picture shows.
        """
        past = Samples(
            most=LIVE_SAMPLES,
            max_stride=max(1, round(LIVE_WINDOW_S * self._fps / LIVE_SAMPLES)),
        )
        coloured = self._grounds.get((key[0], True))
        if coloured is not None:
            grey = coloured.background.in_grey()
            return ViewBackground(grey, coloured.grainy, past, borrowed=True)
        return ViewBackground(
            Background(picture, np.zeros(picture.shape[:2], np.uint8)), past=past
        )


def _know_by(
    place: CameraPlace, background: Background, shown: list[tuple[Image, Shift]]
) -> None:
    """Know a place by its background, and by the landmarks there that are mostly seen; where these
    do not tell all of its pictures, as they are leaves, by the patches that are steady.
    """
    luma = as_image(cv2.extractChannel(background.colour, 0))
    place.reference = _stable(luma, shown, place.steady)
    if place.steady is None and not all(shows(s) for s in _sights(place.reference, shown)):
        view = steady_view([picture for picture, _ in shown])
        if view is not None:
            luma, place.steady = view
            place.reference = _stable(luma, shown, place.steady)
    shares = sorted(sight.share for sight in _sights(place.reference, shown))
    place.usual = shares[len(shares) // 2]


def _stable(
    luma: Image, shown: list[tuple[Image, Shift]], steady: Ints | None
) -> Reference:
    """A reference, of landmarks that are seen in `STABLE` of some pictures, each with its shift."""
    reference = Reference(luma, among=steady)
    if not reference.known:
        return reference
    times = np.sum([sight.seen for sight in _sights(reference, shown)], axis=0)
    return Reference(luma, times >= STABLE * len(shown), steady)


def _sights(reference: Reference, shown: list[tuple[Image, Shift]]) -> list[LandmarkSight]:
    return [reference.sight(picture, shift) for picture, shift in shown]
