"""Which picture a file name means: the one of that name, else the one of that number."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import PurePosixPath

from recorders.names import whole

_RUN = re.compile(r"\d+")
_EXPORT = re.compile(r"(_(jpe?g|png|bmp|webp))?\.rf\.[0-9A-Za-z]+$")
"""What Roboflow's exports put behind a name: ``walk_0012_jpg.rf.4f3a9c``."""
_SUFFIX = re.compile(r"\.(jpe?g|png|bmp|webp|tiff?|txt|json|xml|gif|avif)$", re.IGNORECASE)

SINCE_1970_S = 1e8
"""No recording is as long: a time beyond it is one of the calendar."""
_UNTIL_S = 4_102_444_800.0
"""The year 2100."""
_WORDS_FROM = 1 << 52
"""Identities of words begin here, where no file's own numbers are."""


def since_1970(value: float) -> float | None:
    """Seconds since 1970 of a time in seconds or a smaller unit; None where it is of no such unit.

    >>> since_1970(1_750_000_000_040.0), since_1970(12e12)
    (1750000000.04, None)
    """
    seconds = (value * unit for unit in (1.0, 1e-3, 1e-6, 1e-9))
    return next((s for s in seconds if SINCE_1970_S < s < _UNTIL_S), None)


def stem(name: str) -> str:
    r"""A file's name without folders and suffixes.

    >>> stem("C:\\walk\\0012.jpg"), stem("1750000000.04.txt"), stem("a_7_jpg.rf.4f3a9c.jpg")
    ('0012', '1750000000.04', 'a_7')
    """
    last = PurePosixPath(name.replace("\\", "/")).name
    return _EXPORT.sub("", _SUFFIX.sub("", last))


class FrameNames:
    """Frames by the names of their pictures or by their times, identities by their words.

    Where the pictures are known and most names are theirs, a name stands for its picture alone.
    Else the number in it counts: the last that is not the same in all.

    Args:
        pictures: the number of each picture, from 1, by its name; empty where they are not known.
        fps: frames per second, for rows that give a time.

    Attributes:
        first_frame: what the first frame is called; known once names were learnt.
    """

    def __init__(
        self, pictures: Mapping[str, int] | None = None, fps: float = 25.0
    ) -> None:
        self.fps = fps
        self._began_s: float | None = None
        self._words: dict[str, int] = {}
        self._pictures = {stem(name): n for name, n in (pictures or {}).items()}
        self._matched = False
        self._run = -1
        self.first_frame: int | None = None

    @property
    def are_known(self) -> bool:
        """Whether the pictures are known."""
        return bool(self._pictures)

    @property
    def matched(self) -> bool:
        """Whether names stand for the pictures of that name."""
        return self._matched

    def learn(self, names: Iterable[str]) -> None:
        """Look at names, to know what is a frame in them."""
        stems = list(dict.fromkeys(stem(name) for name in names))
        known = sum(self._picture(one) is not None for one in stems)
        self._matched = 2 * known > len(stems)
        runs = [_RUN.findall(one) for one in stems]
        same = len({_RUN.sub("#", one) for one in stems}) == 1
        if same and len(stems) > 1:
            changing = [
                k
                for k, values in enumerate(zip(*runs, strict=True))
                if len(set(values)) > 1
            ]
            self._run = changing[-1] if changing else -1
        if self._matched:
            self.first_frame = 1
            return
        numbers = [whole(found[self._run]) for found in runs if found]
        self.first_frame = min([1, *(number for number in numbers if number is not None)])

    def _picture(self, one: str) -> int | None:
        found = self._pictures.get(one)
        if found is None and "-" in one:
            # Label Studio puts a word of its own before the names of uploads.
            found = self._pictures.get(one.split("-", 1)[1])
        return found

    def frame_at(self, seconds: float) -> int:
        """The frame of a time: seconds from the first frame on, or from 1970 on, in seconds or in
        smaller units; then the first time that is asked for is the first frame's.

        Raises:
            ValueError: a time before the first frame's, or none.
        """
        if not math.isfinite(seconds):
            raise ValueError(f"time {seconds:g} is not finite")
        if seconds > SINCE_1970_S:
            found = since_1970(seconds)
            if found is None:
                raise ValueError(f"time {seconds:g} is of no unit that is known")
            self._began_s = found if self._began_s is None else self._began_s
            seconds = found - self._began_s
        frame = round(seconds * self.fps)
        if frame < 0:
            raise ValueError(f"a time {-seconds:g} s before the first frame")
        return frame

    def identity(self, word: str) -> int:
        """The number of an identity that is a word: as many as there are, in their order."""
        return self._words.setdefault(word, _WORDS_FROM + len(self._words))

    def frame(self, name: str) -> int:
        """The frame's number.

        Raises:
            ValueError: there is no such picture, or no number in the name.
        """
        one = stem(name)
        if self._matched:
            found = self._picture(one)
            if found is None:
                raise ValueError(f"{name[:60]!r} is none of the pictures")
            return found
        digits = _RUN.findall(one)
        number = whole(digits[self._run]) if digits else None
        if number is None:
            raise ValueError(f"{name[:60]!r} holds no frame number")
        return number
