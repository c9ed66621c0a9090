"""Motion: whatever differs from the background, without its shadow (EVENTS 2, SHELLS 2.1, PARTS 2).

Each pixel's difference from the background is evidence for or against foreground; a weighted
median over a small window decides (SHELLS 2.1: the weighted median reconnects the parts of an
object). The weighted median of two labels is the label with the larger sum of weights: the sign
of the blurred signed evidence.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import msgspec
import numpy as np

from recorders.messages import Blob, Box, Detections, SceneChange
from recorders.pictures import Image
from recorders.quality import QualityMeasure
from recorders.segmentation.background import MIN_SAMPLES, Background, Samples
from recorders.segmentation.bodies import FoundBodies
from recorders.segmentation.change.light import Light, light_of
from recorders.segmentation.change.scenery import Scenery, View
from recorders.segmentation.change.standstill import Standstill
from recorders.segmentation.change.telling import Teller
from recorders.segmentation.darkness import Darkness
from recorders.segmentation.evidence import (
    NEUTRAL,
    Foreground,
    Shadows,
    foreground_of,
    window_of,
)
from recorders.segmentation.parameters import SegmentationParameters
from recorders.segmentation.quality import (
    changes_told,
    measures,
    of_masks,
    of_tally,
    pieces_of,
)
from recorders.segmentation.segmenter import Segmented, as_image, neighbours
from recorders.segmentation.tally import Tally
from recorders.vision import cv2

SLOW_FOREGROUND = 10
"""The background follows what is held to be foreground this many times slower: a wrong background
heals.
"""


class MotionSegmenter:
    """Background subtraction against a background in hindsight, or without `prepare` one learnt
    on the way.

    Attributes:
        quality: what the first reading measured.
        sampled: the bodies that it found, by the numbers of the pictures that it was given.
    """

    def __init__(
        self, parameters: SegmentationParameters, width: int, height: int, fps: float
    ) -> None:
        self._p = parameters
        self._min_area = parameters.min_area * width * height
        self._window = window_of(parameters, height)
        fps = fps if fps > 0 else 25.0
        self._bodies = FoundBodies(parameters.size_model, width, height, fps)
        self._follow_every = max(1, round(parameters.adaptation_s * fps))
        self._observe_every = max(1, round(fps / 2))
        self._steps = 0
        self._before: Image | None = None
        self._scenery = Scenery(parameters, fps)
        self._teller = Teller(fps)
        self._standstill = Standstill()
        self._tally = Tally(fps)
        self._live = True
        self._told: tuple[SceneChange, ...] = ()
        self._shadows = Shadows(parameters, width, height)
        self._neutral = np.full((height, width), NEUTRAL, np.uint8)
        self.quality: list[QualityMeasure] = []
        self.sampled: dict[int, list[Box]] = {}

    def prepare(self, frames: Iterable[Image]) -> None:
        """Learn the background and the bodies' size from pictures spread over the whole
        recording.
        """
        self.prepare_twice(neighbours(frames))

    def prepare_twice(self, pairs: Iterable[tuple[Image, Image]]) -> None:
        """The same from pairs of pictures, a moment apart, spread over the whole recording."""
        samples = Samples()
        for pair in pairs:
            if samples.wants_next():
                samples.add(
                    np.stack([as_image(cv2.cvtColor(p, cv2.COLOR_BGR2YCrCb)) for p in pair])
                )
            else:
                samples.skip()
        if len(samples.kept) < MIN_SAMPLES:
            return
        if not self._scenery.learn([pair[0] for pair in samples.kept]):
            return
        self._live = False
        masks = self._learn_usual(samples.kept)
        if self._bodies.torn:
            # Clothes like the background: what the background leaves undisturbed tells them.
            self._scenery.asks_less()
            masks = self._learn_usual(samples.kept)
        if self._shadows.learn_grey(self._darkness(samples.kept).shadow_keeps()):
            masks = self._learn_usual(samples.kept)
        found = [self._bodies.measured_in(now, self._min_area) for now, _ in masks]
        for blobs in found:
            self._bodies.observe(blobs)
        self._bodies.learn()
        known = [
            number * samples.stride
            for number in range(len(samples.kept))
            if self._scenery.of_sample(number) is not None
        ]
        self.sampled = {
            number: [blob.box for blob in blobs]
            for number, blobs in zip(known, found, strict=True)
        }
        self.quality = self._measured(masks, found)

    def _learn_usual(self, pairs: list[Image]) -> list[tuple[Foreground, Foreground]]:
        """Learn how large bodies usually are from pairs of pictures, (2, H, W, 3) uint8 in Y, Cr,
        Cb; the foreground of those that show a known view.
        """
        masks = []
        for number, (now, later) in enumerate(pairs):
            view = self._scenery.of_sample(number)
            if view is not None:
                after = view.found_again(later)
                # Both in one place: what moves there does so itself, and not with the camera.
                masks.append(
                    (self._found(now, view)[0], self._found(later, after, view)[0])
                )
        self._bodies.learn_usual_of(masks, self._min_area)
        return masks

    def _darkness(self, pairs: list[Image]) -> Darkness:
        """How dark bodies are in the first of pairs of pictures, where there are no colours."""
        seen = Darkness()
        for number, (now, _) in enumerate(pairs):
            view = self._scenery.of_sample(number)
            if view is None or view.background.coloured or self._bodies.usual is None:
                continue
            here = view.over_background(now)
            light = light_of(here, view.background.colour)
            found = self._foreground(here, view.background, light, view.inexact)
            _, labels, blobs = self._bodies.found_in(found.mask, self._min_area)
            behind = light.over(view.background.colour)
            seen.observe(here[..., 0], behind[..., 0], labels, blobs)
        return seen

    def _measured(
        self, pairs: list[tuple[Foreground, Foreground]], found: list[list[Blob]]
    ) -> list[QualityMeasure]:
        """What the first reading says of the recording."""
        masks = [now.mask for now, _ in pairs]
        areas = [int(np.count_nonzero(mask)) for mask in masks]
        bodies = sum(map(len, found))
        explained = sum(blob.area for blobs in found for blob in blobs)
        pieces = [pieces_of(mask, explained / max(1, bodies)) for mask in masks]
        return [
            *measures(
                sum(areas) / max(1, sum(mask.size for mask in masks)),
                self._bodies.sightings,
                self._bodies.usual is not None and not self._bodies.guessed,
                self._bodies.model is not None,
                self._scenery.grainy,
            ),
            *of_masks(
                sum(pieces) / max(1, bodies),
                max(0.0, 1 - explained / max(1, sum(areas))),
                self._scenery.waving,
                bodies,
            ),
        ]

    def measured(self) -> list[QualityMeasure]:
        """What both readings say of the recording so far."""
        return [*self.quality, *of_tally(self._tally)]

    def changed(self) -> str:
        """In one line, how the picture changed as a whole so far; "" where it did not."""
        return changes_told(self._tally)

    def segment(self, index: int, image: Image) -> Segmented:
        """Segment the next frame."""
        mask, detect = self.begin(index, image)
        return Segmented(mask, detect())

    def changes(self) -> tuple[SceneChange, ...]:
        """What is told of the whole picture with the last frame that was begun."""
        return self._told

    def begin(self, index: int, image: Image) -> tuple[Image, Callable[[], Detections]]:
        """The next frame's foreground, and what detects the bodies in it: that alone learns and
        asks their sizes.
        """
        picture = as_image(cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb))
        before = self._scenery.look
        raw, view, light = self._seen(picture)
        moved = self._scenery.look.further_than(before)
        self._standstill.step(picture, bool(raw.mask.any()))
        look, since = self._scenery.look, self._standstill.frames
        self._told = tuple(self._teller.step(index, look, light, since))
        self._tally.see(look, light, self._told)
        mask, labels, blobs = self._bodies.found_in(
            raw.mask, self._min_area, self._before, raw.weak
        )
        self._before = mask
        self._steps += 1
        if view is not None and self._steps % self._follow_every == 0:
            everywhere = self._steps % (self._follow_every * SLOW_FOREGROUND) == 0
            still = np.full_like(mask, 255) if everywhere else cv2.bitwise_not(mask)
            # Its own light is the background's: else a passing change of the light stays in it.
            view.follow(light.off(picture), as_image(still))
        learn = self._live and self._steps % self._observe_every == 0

        def detect() -> Detections:
            if learn:
                self._bodies.observe(blobs)
                self._bodies.learn_when_due()
            found = self._bodies.detect(index, mask, labels, blobs)
            self._tally.count(found)
            return msgspec.structs.replace(found, light=light.factors, moved=moved)

        return mask, detect

    def _seen(self, picture: Image) -> tuple[Foreground, View | None, Light]:
        """A picture's foreground, the view that it shows, and its light; no foreground where it
        shows none that is known.
        """
        view = self._scenery.at(picture)
        if view is None:
            return _nothing(picture), None, Light(known=False)
        found, light = self._found(picture, view)
        if self._scenery.jumped(int(np.count_nonzero(found.mask))):
            again = self._scenery.at(picture, jumped=True)
            if again is None:
                return _nothing(picture), None, Light(known=False)
            if again.ground is not view.ground or again.shift != view.shift:
                view = again
                found, light = self._found(picture, view)
        return found, view, light

    def _found(
        self, picture: Image, view: View, place: View | None = None
    ) -> tuple[Foreground, Light]:
        """The foreground of a picture that shows a view, in the picture's own place, or in that of
        another one that shows it.
        """
        place = place or view
        here = view.over_background(picture)
        light = light_of(here, view.background.colour)
        found = self._foreground(here, view.background, light, view.inexact)
        if any(place.shift):
            found = Foreground(
                place.as_in_picture(found.mask), place.as_in_picture(found.weak)
            )
        return found, light

    def _foreground(
        self, picture: Image, background: Background, light: Light, inexact: bool
    ) -> Foreground:
        """The weighted median of the evidence.

        Where picture and background lie over one another to a pixel at best, a pixel differs if it
        does from its neighbours as well: else every edge would.
        """
        behind = light.over(background.colour)
        if inexact:
            low, high = map(light.over, background.around())
            apart = cv2.add(cv2.subtract(low, picture), cv2.subtract(picture, high))
        else:
            apart = cv2.absdiff(picture, behind)
        dy, dr, db = cv2.split(apart)
        chroma = cv2.add(dr, db)
        difference = as_image(cv2.add(dy, cv2.add(chroma, chroma)))
        if background.swaying is not None:
            background.swaying.soften(difference, picture, behind)
        shadow = self._shadows.find(picture, behind, as_image(chroma), background.coloured)
        difference = as_image(cv2.subtract(difference, shadow))
        level = light.level_under(background.level)
        evidence = cv2.min(difference, cv2.add(level, level))
        evidence = cv2.subtract(cv2.add(evidence, self._neutral), level)
        found = foreground_of(as_image(evidence), level, self._window)
        if background.swaying is None:
            return found
        mask = background.swaying.seen_through(found.mask)
        return Foreground(mask, found.weak | mask)


def _nothing(picture: Image) -> Foreground:
    """No foreground in a picture."""
    none = np.zeros(picture.shape[:2], np.uint8)
    return Foreground(none, none)
