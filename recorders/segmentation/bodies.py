"""From blobs to detections: by the size of bodies where it can be learnt, else blob by blob."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from recorders.messages import NO_BLOB, Blob, Box, Detections, Ellipse
from recorders.pictures import Image
from recorders.segmentation.blobs import Labels, components, ellipse_of, numbered, outlines
from recorders.segmentation.companies import Companies
from recorders.segmentation.evidence import Foreground
from recorders.segmentation.explain import Explainer, Floats
from recorders.segmentation.pieces import bodies_of, without_thin
from recorders.segmentation.sizes import MIN_BLOBS, SizeModel, learn, regrouped
from recorders.segmentation.touching import pixels_of, single_areas, within
from recorders.segmentation.usual import MAX_AREA_SPREAD, Sightings, UsualSize

MAX_BLOBS = 4096
LONE_SCORE = 0.5
"""Score of a blob that is a detection for want of anything that is known of bodies' sizes."""

REST_SCORE = 0.3
"""Score of a blob that is left when bodies of the learnt size have explained what they can."""
REST_AREA = 0.25
"""Such a blob is a detection from this share of the area of a body's box on."""

FITS_SIZE, FITS_AREA = (0.6, 1.25), (0.4, 1.35)
"""A blob is one body if its height, width and area are within these of the usual ones: it needs no
explanation."""
MIN_AGREEING_AREA = 0.6
"""A size model holds if blobs of this share of all area agree with it: of upright people on a
plane .85 or more do, of cyclists who come near .37 to .46.
"""
AGREES = 0.2


class FoundBodies:
    """The bodies of one recording: learns their size from blobs, and finds them in masks."""

    def __init__(self, use_size: bool, width: int, height: int, fps: float) -> None:
        self._use_size = use_size
        self._width, self._height = width, height
        self._seen: list[Box] = []
        self._regrouped: list[tuple[float, ...]] = []
        self._single_areas: list[int] = []
        self._body_area = 0.0
        self._due = 2 * MIN_BLOBS
        self._sightings = Sightings(width, height)
        self._companies = Companies(fps)
        self.usual: UsualSize | None = None
        self.guessed = False
        self.model: SizeModel | None = None
        self._explainer: Explainer | None = None

    def observe(self, blobs: list[Blob]) -> None:
        """Take in the blobs of one frame; the oldest of very many are forgotten."""
        if self._use_size:
            self._seen += [blob.box for blob in blobs]
            self._regrouped += map(
                tuple,
                regrouped(
                    np.array([blob.box for blob in blobs], np.float64).reshape(-1, 4)
                ).tolist(),
            )
            self._single_areas += single_areas(blobs)
            del (
                self._seen[:-MAX_BLOBS],
                self._regrouped[:-MAX_BLOBS],
                self._single_areas[:-MAX_BLOBS],
            )

    def learn(self) -> None:
        """Fit the size model to the blobs so far."""
        if not self._seen:
            return
        self.model = learn(np.array(self._seen, np.float64), self._width, self._height)
        if self.model is None:
            self.model = learn(
                np.array(self._regrouped, np.float64), self._width, self._height
            )
        if self.model is not None and not self._holds(self.model):
            self.model = None
        if self.model is not None and self.usual is not None:
            self.usual = self._sightings.learn(upright=self.model) or self.usual
        self._explainer = (
            None if self.model is None else Explainer(self.model, self._width, self._height)
        )
        areas = sorted(self._single_areas)
        n = len(areas)
        alike = n >= MIN_BLOBS and areas[3 * n // 4] <= MAX_AREA_SPREAD * areas[n // 4]
        self._body_area = float(areas[n // 2]) if alike else 0.0

    def _holds(self, model: SizeModel) -> bool:
        """Whether the model is one of the bodies, and not one of specks."""
        b = np.array(self._seen, np.float64)
        area = b[:, 2] * b[:, 3]
        heights = model.heights(b[:, 1] + b[:, 3])
        agrees = np.abs(b[:, 3] - heights) <= AGREES * heights
        return float(area[agrees].sum()) >= MIN_AGREEING_AREA * float(area.sum())

    def _whole(self, blobs: list[Blob]) -> list[Blob]:
        """The blobs that are as large as one body."""
        if self.usual is None or not blobs:
            return []
        b = np.array([(*blob.box, blob.area) for blob in blobs], np.float64)
        w, h, area = self.usual.at(b[:, 1] + b[:, 3])
        fits = np.ones(len(b), bool)
        for value, usual, (low, high) in (
            (b[:, 2], w, FITS_SIZE),
            (b[:, 3], h, FITS_SIZE),
            (b[:, 4], area, FITS_AREA),
        ):
            fits &= (value >= low * usual) & (value <= high * usual)
        return [blob for blob, fit in zip(blobs, fits.tolist(), strict=True) if fit]

    def look_twice(self, now: Image, later: Image) -> None:
        """Take in the masks of two pictures, `recorders.segmentation.usual.MOMENT_S` apart."""
        self._sightings.observe(numbered(now)[3], numbered(later)[3])

    def learn_usual(self, least: float) -> None:
        """How large bodies usually are, of what was looked at twice so far; where they are not seen
        clean, what most of the foreground belongs to, if that is no smaller than ``least`` px^2.
        """
        self.usual = self._sightings.learn()
        self.guessed = self.usual is None
        if self.guessed:
            guess = self._sightings.guess()
            self.usual = guess if guess is not None and guess.least_area >= least else None

    @property
    def torn(self) -> bool:
        """Bodies are seen in pieces that go together."""
        return self._sightings.torn

    @property
    def sightings(self) -> int:
        """How many bodies were seen clean."""
        return self._sightings.count

    def learn_usual_of(
        self, pairs: list[tuple[Foreground, Foreground]], least: float
    ) -> None:
        """The same of pairs of masks, and of nothing before; what is thin against the bodies so
        learnt is taken off, and they are looked at again.

        Args:
            pairs: of two pictures each.
            least: a size that is only guessed counts from this area on, px^2.
        """
        masks = [(now.mask, later.mask) for now, later in pairs]
        self._learn_usual_anew(masks, least)
        rough = self.usual
        if rough is None:
            return
        thick = ((without_thin(a, rough), without_thin(b, rough)) for a, b in masks)
        self._learn_usual_anew(thick, least)
        self.usual = self.usual or rough

    def _learn_usual_anew(self, masks: Iterable[tuple[Image, Image]], least: float) -> None:
        self._sightings = Sightings(self._width, self._height)
        for now, later in masks:
            self.look_twice(now, later)
        self.learn_usual(least)

    def found_in(
        self,
        mask: Image,
        min_area: float,
        before: Image | None = None,
        weak: Image | None = None,
    ) -> tuple[Image, Labels, list[Blob]]:
        """The components that may be bodies: whole ones, where it is known how large they are."""
        if self.usual is None:
            return components(mask, min_area, before)
        upright = self.model is not None
        weak = None if self.guessed else weak
        return bodies_of(mask, self.usual, before, upright, weak)

    def measured_in(self, found: Foreground, min_area: float) -> list[Blob]:
        """The blobs that may be bodies as their sizes are learnt from: without thin parts."""
        mask = found.mask
        if self.usual is not None:
            mask = without_thin(mask, self.usual)
        return self.found_in(mask, min_area, None, found.weak)[2]

    def learn_when_due(self) -> None:
        """`learn` whenever the number of blobs has grown by half."""
        if len(self._seen) >= self._due:
            self._due += self._due // 2
            self.learn()

    def detect(
        self, index: int, mask: Image, labels: Labels, blobs: list[Blob]
    ) -> Detections:
        """The detections of one frame.

        Args:
            index: the frame's number.
            mask: (H, W) uint8, 0 or 255.
            labels: (H, W) int32, the mask's components from 1.
            blobs: blob k - 1 is label k.
        """
        if self._explainer is None or not blobs:
            boxes, scores, ellipses, ids = self._by_area(labels, blobs)
        else:
            whole = self._whole(blobs)
            left = mask.copy() if whole else mask
            for one in whole:
                within(one, left)[pixels_of(one, labels) > 0] = 0
            found = self._explainer.explain(left)
            boxes = [one.box for one in whole]
            boxes += [_clipped(box, self._width, self._height) for box in found.boxes]
            scores = [1.0] * len(whole) + [float(score) for score in found.scores]
            for box in self._unexplained(found.rest):
                boxes.append(box)
                scores.append(REST_SCORE)
            ids, ellipses = [], []
            for box in boxes:
                blob, ellipse = _blob_in(box, labels, blobs)
                ids.append(blob)
                ellipses.append(ellipse)
        return Detections(
            frame=index,
            width=self._width,
            height=self._height,
            boxes=boxes,
            scores=scores,
            labels=["object"] * len(boxes),
            ellipses=ellipses,
            blobs=ids,
            components=blobs,
            size_model=self.model.as_list() if self.model is not None else [],
        )

    def _by_area(
        self, labels: Labels, blobs: list[Blob]
    ) -> tuple[list[Box], list[float], list[Ellipse | None], list[int]]:
        """Bodies of any pose: each blob is divided into as many ellipses as its area and outline
        ask for.
        """
        areas = [self._body_area] * len(blobs)
        if self.usual is not None and blobs:
            feet = np.array([b.box[1] + b.box[3] for b in blobs])
            areas = self.usual.body_areas(feet).tolist()
        bodies = self._companies.bodies(blobs, labels, areas)
        scores = [LONE_SCORE if b.among == 1 else REST_SCORE for b in bodies]
        return (
            [body.box for body in bodies],
            scores,
            [body.ellipse for body in bodies],
            [body.blob for body in bodies],
        )

    def _unexplained(self, rest: Image) -> list[Box]:
        """Boxes around what no body explains, if large enough to be a body in an unusual pose or
        half hidden.
        """
        assert self.model is not None
        found = outlines(rest, REST_AREA * self.model.aspect * (0.5 * self.model.low) ** 2)
        boxes = np.array([box for box, _ in found], np.float64).reshape(-1, 4)
        least = (
            REST_AREA
            * self.model.aspect
            * self.model.heights(boxes[:, 1] + boxes[:, 3]) ** 2
        )
        return [
            box for (box, area), enough in zip(found, least, strict=True) if area >= enough
        ]


def _clipped(box: Floats, width: int, height: int) -> Box:
    """The part of a box that lies in the picture."""
    x, y, w, h = (float(v) for v in box)
    left, top, right, bottom = (
        max(0.0, x),
        max(0.0, y),
        min(float(width), x + w),
        min(float(height), y + h),
    )
    return (left, top, right - left, bottom - top)


def _blob_in(box: Box, labels: Labels, blobs: list[Blob]) -> tuple[int, Ellipse | None]:
    """The blob with the most pixels in the box (the lowest id of equals), and the ellipse of
    those pixels.
    """
    x1, y1 = round(box[0]), round(box[1])
    inside = labels[y1 : round(box[1] + box[3]), x1 : round(box[0] + box[2])]
    counts = np.bincount(inside.ravel(), minlength=2)
    blob = int(np.argmax(counts[1:])) + 1
    if not counts[blob]:
        return NO_BLOB, None
    if counts[blob] == blobs[blob - 1].area:
        return blob, blobs[blob - 1].ellipse
    return blob, ellipse_of((inside == blob).view(np.uint8), x1, y1)
