"""Watches a camera's view, frame by frame: which view a picture shows, shifted by how much, or that
it shows none.
"""

from __future__ import annotations

from dataclasses import dataclass

from recorders.pictures import Image
from recorders.segmentation.change.landmarks import (
    NEAR,
    NO_SIGHT,
    LandmarkSight,
    Reference,
    Shift,
)
from recorders.segmentation.change.light import coloured_share, one_colour_share
from recorders.segmentation.change.views import (
    FEWEST_PICTURES,
    CameraPlace,
    ColourMode,
    find,
    one_colour_from,
    reference_of,
    shows,
)

LOOK_EVERY = 5
"""A camera that has not moved is looked at every so many frames, and where foreground jumps up."""
STEADY_S = 2.0
"""A camera has not moved if it was still for so long."""
SEARCH_S, REST_S = 0.25, 1.0
"""A camera that has shown the same for so long may rest on a known view; and at last on a new one."""


@dataclass(frozen=True)
class Look:
    """What a picture was found to show.

    Attributes:
        place: the place's number, None where it shows none that is known.
        shift: against the place's reference, px right and down.
        coloured: it has colours.
        colours: the share of it that has, as last looked at.
        share: of the place's landmarks, as last looked at.
        one_colour: the name of the colour that fills it, "" where none does.
        one_colour_share: the share of it that it fills, as last looked at.
        new: a place that was not known before: the camera has come to rest on it.
        whole: the shift is so to a fraction of a pixel.
        turned: by how much the picture lies further than the one before, px right and down, that
            showed no place that is known; 0 where it cannot be told.
    """

    place: int | None
    shift: Shift = (0, 0)
    coloured: bool = True
    colours: float = 1.0
    share: float = 1.0
    one_colour: str = ""
    one_colour_share: float = 0.0
    new: bool = False
    whole: bool = True
    turned: Shift = (0, 0)

    def further_than(self, before: Look) -> list[int]:
        """By how many pixels right and down the picture lies further than the one before; empty
        where it does not, or it is not known.
        """
        by = self.turned
        if self.place is not None and self.place == before.place:
            by = self.shift[0] - before.shift[0], self.shift[1] - before.shift[1]
        return list(by) if any(by) else []


class Watch:
    """Looks at pictures in their order; a function of the pictures so far, alone.

    Args:
        places: those that are known; without any, the first picture shows one.
        fps: frames a second.
        one_colour: the share of the picture that has one colour, usually.
        steady: the camera is thought not to move.
        colours: whether pictures have colours, as the first one is expected to; None: there are
            none in the whole recording.
        noise: see `noise_of`.
    """

    def __init__(
        self,
        places: list[CameraPlace],
        fps: float,
        one_colour: float = 0.0,
        *,
        steady: bool = False,
        colours: ColourMode | None = None,
        noise: float = 0.0,
    ) -> None:
        self._noise = noise
        self.places = places
        self._fps = fps
        self._one_colour = one_colour_from(one_colour)
        self._last = Look(None)
        self._colours = colours
        self._home: tuple[CameraPlace, Shift] | None = None
        self._frames = 0
        self._next_look = 0
        self._looked_at = -1
        self._moved_at = -round(STEADY_S * fps) if steady else 0
        self._rest: _Rest | None = None
        self._turned: Shift = (0, 0)

    @property
    def looked(self) -> bool:
        """The last picture was looked at."""
        return self._looked_at == self._frames

    def due(self) -> bool:
        """Whether the next picture is looked at in any case."""
        return self._last.place is None or self._frames >= self._next_look

    def look(self, picture: Image, *, jumped: bool = False) -> Look:
        """Look at the next picture, (H, W, 3) uint8 in Y, Cr, Cb; at the last one again where
        ``jumped`` says that its foreground jumped up.
        """
        if jumped:
            self._frames -= 1
        if self.due() or jumped:
            self._last = self._looked(picture, self._last)
            steady = self._frames - self._moved_at >= STEADY_S * self._fps
            self._next_look = self._frames + (LOOK_EVERY if steady else 1)
            self._looked_at = self._frames + 1
        self._frames += 1
        return self._last

    def _looked(self, picture: Image, last: Look) -> Look:
        colours = round(coloured_share(picture), 3)
        coloured = self._colours is not None and bool(self._colours.coloured)
        share, name = 0.0, ""
        self._turned = (0, 0)
        if self._home is None and not self.places:
            # Nothing is known of what is usual: this is.
            self._one_colour = one_colour_from(one_colour_share(picture)[0])
        known = self._home is not None and self._home[0].reference.known
        if not known:
            share, name = one_colour_share(picture)
        if known or share < self._one_colour:
            place, shift, sight = self._placed(picture, last)
            if place is not None:
                if self._colours is not None:
                    coloured = self._colours.step(colours)
                new = place not in self.places
                self.places += [place] if new else []
                if self._frames and (place.number, shift) != (last.place, last.shift):
                    self._moved_at = self._frames
                self._home, self._rest = (place, shift), None
                share = 1.0 if sight is NO_SIGHT else sight.share
                return Look(
                    place.number,
                    shift,
                    coloured,
                    colours,
                    share,
                    new=new,
                    whole=sight.whole,
                    turned=self._turned,
                )
            share, name = one_colour_share(picture)
        if share >= self._one_colour:
            self._rest = None
            return Look(None, (0, 0), coloured, colours, 0.0, name, share)
        if self._home is not None and self._home[0].reference.agrees(picture):
            place, shift = self._home
            return Look(place.number, shift, coloured, colours)
        return Look(None, (0, 0), coloured, colours, 0.0, "", share, turned=self._turned)

    def _placed(
        self, picture: Image, last: Look
    ) -> tuple[CameraPlace | None, Shift, LandmarkSight]:
        """The place that a picture shows, and its shift: the last one as long as it may be."""
        if self._home is None:
            return self._first(picture)
        place, shift = self._home
        if not place.reference.known:
            return place, shift, NO_SIGHT
        if last.place is None:
            sight = place.reference.sight(picture, shift)
            if shows(sight):
                return place, shift, sight
            return self._at_rest(picture)
        shift, sight = find(picture, place, shift)
        if sight.share >= place.least and sight.even and sight.near:
            return place, shift, sight
        return self._anywhere(picture)

    def _next_number(self) -> int:
        return 1 + max((place.number for place in self.places), default=-1)

    def _first(self, picture: Image) -> tuple[CameraPlace | None, Shift, LandmarkSight]:
        found = self._anywhere(picture)
        if found[0] is not None:
            return found
        if self.places:
            # Pictures of it were seen, though this one shows it badly.
            return self.places[0], (0, 0), NO_SIGHT
        return CameraPlace(0, reference_of(picture, self._noise)), (0, 0), NO_SIGHT

    def _anywhere(self, picture: Image) -> tuple[CameraPlace | None, Shift, LandmarkSight]:
        known = [place for place in self.places if place.reference.known]
        for search in (find_at_rest, find_anywhere):
            for place in known:
                shift, sight = search(picture, place)
                if shows(sight):
                    return place, shift, sight
        return None, (0, 0), NO_SIGHT

    def _at_rest(self, picture: Image) -> tuple[CameraPlace | None, Shift, LandmarkSight]:
        """The place that a camera has come to rest on: a known one, or in the end a new one."""
        rest = self._rest
        if rest is not None and rest.reference.known:
            shift, sight = find(picture, CameraPlace(-1, rest.reference), (0, 0))
            if shows(sight):
                self._turned = shift[0] - rest.shift[0], shift[1] - rest.shift[1]
                rest.shift = shift
            if shows(sight) and max(map(abs, shift)) <= NEAR:
                rested = self._frames - rest.since
                if rested >= max(FEWEST_PICTURES, REST_S * self._fps):
                    return (
                        CameraPlace(
                            self._next_number(), reference_of(picture, self._noise)
                        ),
                        (0, 0),
                        NO_SIGHT,
                    )
                if rested >= SEARCH_S * self._fps and not rest.searched:
                    rest.searched = True
                    return self._anywhere(picture)
                return None, (0, 0), NO_SIGHT
        self._rest = _Rest(reference_of(picture, self._noise), self._frames)
        return None, (0, 0), NO_SIGHT


@dataclass
class _Rest:
    """What a camera shows that may have come to rest, since when, how the last picture was shifted
    against it, and whether it was looked for among the known places.
    """

    reference: Reference
    since: int
    shift: Shift = (0, 0)
    searched: bool = False


def find_at_rest(picture: Image, place: CameraPlace) -> tuple[Shift, LandmarkSight]:
    """Where a place lies if the picture shows it nearly unmoved."""
    return find(picture, place, (0, 0))


def find_anywhere(picture: Image, place: CameraPlace) -> tuple[Shift, LandmarkSight]:
    """Where a place lies if the picture shows a part of it."""
    return place.reference.anywhere(picture)
