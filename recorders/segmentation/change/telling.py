"""What is told of a change: once it lasts, with what was measured and what it was held against."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from statistics import median
from typing import Any, Generic, TypeVar

from recorders.messages import SceneChange
from recorders.segmentation.change.landmarks import Shift
from recorders.segmentation.change.light import Light
from recorders.segmentation.change.standstill import FROZEN_S
from recorders.segmentation.change.views import (
    KNOWN_AGAIN,
    ONE_COLOUR,
    TURNS_GREY,
)
from recorders.segmentation.change.watch import Look

LASTS_S = 0.5
"""A change is told when it has lasted for so long, and three frames."""
WITHIN_S, SUDDEN_S, SUDDEN = 1.0, 0.3, 0.6
"""The light is switched where most of its change within a second, this share, lies within less,"""
SWITCHED = 0.1
"""where it changes by at least this share,"""
STEADY = 0.03
"""from one level to another, each of which changes by less than this."""
DRIFTED = 0.3
"""It has changed slowly where by this share."""
TINTED, TINT_STEADY = 6.0, 3.0
"""The light's colour has changed where red or blue (Cr or Cb) did by so many levels, to where it
then stays within so many.
"""
MOVED_PX = 2
"""A camera was moved if its picture lies this much aside, px, and lies still by no more than this,"""
MOVED_S, MOVED_FRAMES = 1.0, 12
"""for so long, and so many frames."""


T = TypeVar("T")


class Teller:
    """Turns looks at one frame after the other into changes."""

    def __init__(self, fps: float) -> None:
        self._fps = fps
        self._lasts = max(3, round(LASTS_S * fps))
        self._signal = _Lasting("", self._lasts)
        self._place = _Lasting[int | None](None, self._lasts)
        self._coloured = _Lasting(True, self._lasts)
        self._shift: Shift = (0, 0)
        self._rests = max(MOVED_FRAMES, round(MOVED_S * fps))
        self._shifts: deque[Shift] = deque(maxlen=self._rests)
        self._shift_known = False
        self._gap = max(1, round(WITHIN_S * fps))
        self._sudden = max(1, round(SUDDEN_S * fps))
        self._levels: deque[float] = deque(maxlen=2 * self._lasts + self._gap)
        self._level = 1.0
        self._tints: deque[tuple[float, float]] = deque(maxlen=self._lasts)
        self._tint = (0.0, 0.0)
        self._ground: tuple[int, bool] | None = None
        self._began = False
        self._still = 0

    def step(
        self, frame: int, look: Look, light: Light, still: int = 0
    ) -> list[SceneChange]:
        """What is to be told with a frame.

        Args:
            frame: its number.
            look: what it shows.
            light: against its view's background, where it shows one.
            still: for so many frames the picture has stood still, since something moved.
        """
        if not self._began:
            self._begin(look)
        found = [*self._stood_still(frame, still), *self._seen(frame, look)]
        if look.place is None:
            self._shifts.clear()
            return found
        ground = (look.place, look.coloured)
        if ground != self._ground:
            self._ground = ground
            self._levels.clear()
            self._level = max(light.level, 0.01) if light.known else 1.0
            self._tints.clear()
            self._tint = light.tint
        if light.known:
            self._levels.append(light.level)
            self._tints.append(light.tint)
        lit = [*self._lit(frame)]
        lit += self._tinted(frame, told=bool(lit))
        return [*found, *self._moved(frame, look), *lit]

    def _begin(self, look: Look) -> None:
        self._began = True
        self._signal.value, self._place.value = look.one_colour, look.place
        self._coloured.value = look.coloured

    def _seconds(self, frames: int) -> float:
        return round(frames / self._fps, 3)

    def _stood_still(self, frame: int, still: int) -> Iterator[SceneChange]:
        before, self._still = self._still, still
        least = max(3, round(FROZEN_S * self._fps))
        if still == least:
            evidence = {
                "still_s": self._seconds(still),
                "still_s_at_least": self._seconds(least),
                "since_frame": frame - still,
            }
            text = "The picture is frozen: what moved stands still at once, and nothing changes."
            yield SceneChange(frame, "frozen", evidence, text)
        elif not still and before >= least:
            lost = self._seconds(before)
            evidence = {"lost_s": lost, "since_frame": frame}
            text = f"The picture moves again after {lost:g} s."
            yield SceneChange(frame, "signal_back", evidence, text)

    def _seen(self, frame: int, look: Look) -> Iterator[SceneChange]:
        """Signal, colours and place."""
        ended = self._signal.step(frame, look.one_colour)
        if ended is not None:
            yield self._signal_told(frame, look, ended)
        if look.one_colour:
            return
        if look.place is not None and self._coloured.step(frame, look.coloured) is not None:
            yield self._colours_told(frame, look)
        before = self._place.value
        if self._place.step(frame, look.place) is not None:
            if look.place is not None:
                self._shift_known = False
                self._shifts.clear()
            yield self._place_told(frame, look, before)

    def _signal_told(self, frame: int, look: Look, ended: int) -> SceneChange:
        evidence: dict[str, Any] = {"since_frame": self._signal.since}
        if look.one_colour:
            why = "no signal, or no light" if look.one_colour == "black" else "no signal"
            return SceneChange(
                frame,
                "signal_lost",
                {
                    "one_colour_share": round(look.one_colour_share, 3),
                    "one_colour_share_at_least": ONE_COLOUR,
                    "colour": look.one_colour,
                    **evidence,
                },
                f"The picture is {look.one_colour} all over: {why}.",
            )
        lost = self._seconds(self._signal.since - ended)
        return SceneChange(
            frame,
            "signal_back",
            {"lost_s": lost, **evidence},
            f"The picture is back after {lost:g} s.",
        )

    def _colours_told(self, frame: int, look: Look) -> SceneChange:
        evidence = {"since_frame": self._coloured.since, "coloured_share": look.colours}
        if look.coloured:
            return SceneChange(
                frame,
                "colour",
                {**evidence, "coloured_share_over": TURNS_GREY},
                "The picture has colours again.",
            )
        return SceneChange(
            frame,
            "infrared",
            {**evidence, "coloured_share_at_most": TURNS_GREY},
            "The picture turned grey (infrared, or no colours any more).",
        )

    def _place_told(self, frame: int, look: Look, before: int | None) -> SceneChange:
        evidence: dict[str, Any] = {
            "landmarks_share": round(look.share, 3),
            "since_frame": self._place.since,
            "view": look.place,
            "view_before": before,
        }
        if look.place is None:
            evidence["landmarks_share_under"] = KNOWN_AGAIN
        else:
            evidence["landmarks_share_at_least"] = KNOWN_AGAIN
        if look.place is None:
            text = "The camera turns away, or its view is covered: nothing of it is seen."
        elif look.place == self._place.last_known:
            text = "The camera shows its view again."
        else:
            text = "The camera was turned: it shows another view."
        if look.place is not None:
            self._place.last_known = look.place
        return SceneChange(frame, "panned", evidence, text)

    def _moved(self, frame: int, look: Look) -> Iterator[SceneChange]:
        self._shifts.append(look.shift)
        full = len(self._shifts) == self._shifts.maxlen
        if not full or (self._shift_known and look.shift == self._shift):
            return
        right, down = zip(*self._shifts, strict=True)
        if max(max(right) - min(right), max(down) - min(down)) > MOVED_PX:
            return
        rest = int(median(right)), int(median(down))
        if not self._shift_known:
            self._shift_known, self._shift = True, rest
        by = rest[0] - self._shift[0], rest[1] - self._shift[1]
        if max(map(abs, by)) < MOVED_PX:
            return
        self._shift = rest
        yield SceneChange(
            frame,
            "moved",
            {
                "moved_px": max(map(abs, by)),
                "moved_px_at_least": MOVED_PX,
                "right_px": by[0],
                "down_px": by[1],
                "since_frame": frame - self._rests + 1,
            },
            f"The camera was moved: its picture lies {_way(by)}.",
        )

    def _lit(self, frame: int) -> Iterator[SceneChange]:
        if not self._levels or abs(self._levels[-1] / self._level - 1) < SWITCHED / 2:
            return
        levels = list(self._levels)
        now = levels[-self._lasts :]
        if len(now) < self._lasts or not _steady(now):
            return
        level = median(now)
        change = abs(level / self._level - 1)
        before = levels[: self._lasts]
        sudden = (
            len(levels) == self._levels.maxlen
            and _steady(before)
            and abs(level / max(median(before), 0.01) - 1) >= SWITCHED
            and self._at_once(levels, abs(level - median(before)))
        )
        limit = SWITCHED if sudden else DRIFTED
        if change < limit:
            return
        way = "fell" if level < self._level else "rose"
        told = SceneChange(
            frame,
            "light",
            {
                "light_change": round(change, 3),
                "light_change_at_least": limit,
                "light": round(level, 3),
                "light_before": round(self._level, 3),
                "since_frame": frame - self._lasts + 1,
            },
            f"The light {way} {'' if sudden else 'slowly '}to {level:.0%} of what is usual"
            " here.",
        )
        self._level = max(level, 0.01)
        yield told

    def _tinted(self, frame: int, *, told: bool) -> list[SceneChange]:
        """Another colour of the light; nothing where with this frame its change was ``told``."""
        if len(self._tints) < self._lasts:
            return []
        red, blue = zip(*self._tints, strict=True)
        if max(max(red) - min(red), max(blue) - min(blue)) > TINT_STEADY:
            return []
        now = median(red), median(blue)
        by = now[0] - self._tint[0], now[1] - self._tint[1]
        change = max(map(abs, by))
        if told:
            self._tint = now
        if told or change < TINTED:
            return []
        self._tint = now
        return [
            SceneChange(
                frame,
                "light",
                {
                    "tint_change": round(change, 1),
                    "tint_change_at_least": TINTED,
                    "red": round(by[0], 1),
                    "blue": round(by[1], 1),
                    "since_frame": frame - self._lasts + 1,
                },
                f"The light's colour changed: the picture is {_hue(by)}.",
            )
        ]

    def _at_once(self, levels: list[float], change: float) -> bool:
        """Whether most of a change of the light lies between frames that are close together."""
        apart = zip(levels, levels[self._sudden :], strict=False)
        return max(abs(b - a) for a, b in apart) >= SUDDEN * change


class _Lasting(Generic[T]):
    """A value that is taken over once it lasts.

    Attributes:
        value: as taken over.
        since: the frame from which on it held.
        last_known: the last value that was not None.
    """

    def __init__(self, value: T, frames: int) -> None:
        self.value = value
        self.since = 0
        self.last_known = value
        self._frames = frames
        self._next: tuple[T, int] | None = None

    def step(self, frame: int, value: T) -> int | None:
        """A frame's value: the frame since which the value before held, when another is taken
        over.
        """
        if value == self.value:
            self._next = None
            return None
        if self._next is None or self._next[0] != value:
            self._next = value, frame
        if frame - self._next[1] + 1 < self._frames:
            return None
        before, self.since = self.since, self._next[1]
        if self.value is not None:
            self.last_known = self.value
        self.value, self._next = value, None
        return before


def _steady(levels: list[float]) -> bool:
    return max(levels) - min(levels) <= STEADY * max(levels)


def _hue(by: tuple[float, float]) -> str:
    """A change of red and blue in words.

    >>> _hue((-2.0, 7.0)), _hue((9.0, 1.0))
    ('bluer', 'redder')
    """
    red, blue = by
    if abs(blue) >= abs(red):
        return "bluer" if blue > 0 else "yellower"
    return "redder" if red > 0 else "greener"


def _way(by: Shift) -> str:
    """A shift in words.

    >>> _way((4, -1)), _way((0, 2))
    ('4 pixels further right and 1 pixel further up', '2 pixels further down')
    """
    ways = [
        f"{abs(v)} pixel{'' if abs(v) == 1 else 's'} further {plus if v > 0 else minus}"
        for v, plus, minus in ((by[0], "right", "left"), (by[1], "down", "up"))
        if v
    ]
    return " and ".join(ways)
