"""What targets look like: colours of upper and lower body, and how tall, from the pictures in which
each stands most by itself.

Few pictures are looked at: at most `SAMPLES` a target, and those that several targets share count
once. Each picture's pixels make shares of shades; a target's are the mean of its pictures', and
its colour is the one that has the largest share, if that is enough to speak of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recorders.limits import Limits
from recorders.looks import COLOURS, SHADES, Counts, body_shades
from recorders.messages import Box
from recorders.scene import Frame, SceneLog

SAMPLES = 9
LEAST_SHARE = 0.34
"""A colour that covers less of a body is not told as its colour."""
_COVERED = 0.15
_GRID_NS = 500_000_000
_THOUSAND = 1000


@dataclass(frozen=True)
class LookSighting:
    """Where a target was in one frame, and which boxes lay over its own."""

    frame: int
    time_ns: int
    box: Box
    others: tuple[Box, ...]


@dataclass(frozen=True)
class Looks:
    """What a target looks like.

    Attributes:
        samples: how many pictures it rests on.
        upper, lower: shares of each shade in thousandths, (20,).
        frame, box: where it is seen best.
    """

    samples: int
    upper: list[int]
    lower: list[int]
    frame: int
    box: Box

    @property
    def upper_colour(self) -> str | None:
        """The colour of the upper body, None where none covers enough."""
        return colour_of(self.upper)

    @property
    def lower_colour(self) -> str | None:
        """The colour of the lower body."""
        return colour_of(self.lower)


def colour_of(shares: Sequence[int]) -> str | None:
    """The colour of the largest share, in thousandths; of equal ones the first of `COLOURS`."""
    by_name = dict.fromkeys(COLOURS, 0)
    for (_, name), share in zip(SHADES, shares, strict=True):
        by_name[name] += share
    best = max(by_name, key=lambda name: by_name[name])
    return best if by_name[best] >= LEAST_SHARE * _THOUSAND else None


def sightings(
    frames: NDArray[np.int64],
    times_ns: Sequence[int],
    boxes: NDArray[np.float64],
    seen: NDArray[np.bool_],
    others: Mapping[int, Sequence[tuple[int, Box]]],
    own: int,
) -> list[LookSighting]:
    """The frames that are worth looking at: seen, covered by nobody for the most part; of many,
    some at half seconds, spread evenly.
    """
    found = []
    for k in np.flatnonzero(seen).tolist():
        box: Box = tuple(boxes[k].tolist())
        over = tuple(
            other for i, other in others.get(int(frames[k]), ()) if i != own and _meet(box, other)
        )  # fmt: skip
        if sum(_shared(box, other) for other in over) <= _COVERED * box[2] * box[3]:
            found.append((k, LookSighting(int(frames[k]), times_ns[k], box, over)))
    on_grid = [
        s
        for k, s in found
        if k == 0 or times_ns[k] // _GRID_NS != times_ns[k - 1] // _GRID_NS
    ]
    chosen = on_grid if len(on_grid) >= 3 else [s for _, s in found]
    if len(chosen) <= SAMPLES:
        return chosen
    return [chosen[round(k * (len(chosen) - 1) / (SAMPLES - 1))] for k in range(SAMPLES)]


def _meet(a: Box, b: Box) -> bool:
    return a[0] < b[0] + b[2] and b[0] < a[0] + a[2] and a[1] < b[1] + b[3] and b[1] < a[1] + a[3]  # fmt: skip


def _shared(a: Box, b: Box) -> float:
    w = min(a[0] + a[2], b[0] + b[2]) - max(a[0], b[0])
    h = min(a[1] + a[3], b[1] + b[3]) - max(a[1], b[1])
    return w * h


def look(
    path: Path, camera: str, limits: Limits, wanted: Mapping[int, Sequence[LookSighting]]
) -> dict[int, Looks]:
    """Look at the pictures of a log; answers with the looks of those of whom enough was seen.

    Raises:
        RecordingError: the log is damaged.
    """
    at: dict[int, list[tuple[int, LookSighting]]] = {}
    for track in sorted(wanted):
        for s in wanted[track]:
            at.setdefault(s.time_ns, []).append((track, s))
    if not at:
        return {}
    seen: dict[int, list[tuple[LookSighting, Counts, Counts]]] = {}
    last = max(at)
    with SceneLog(path, camera, limits) as scene:
        for frame in scene.frames(again=True):
            for track, s in at.get(frame.time_ns, ()):
                found = _looked(frame, s)
                if found is not None:
                    seen.setdefault(track, []).append((s, *found))
            if frame.time_ns >= last:
                break
    return {track: _looks(found) for track, found in sorted(seen.items())}


def _looked(frame: Frame, s: LookSighting) -> tuple[Counts, Counts] | None:
    image = frame.image
    return None if image is None else body_shades(image, frame.mask, s.box, s.others)


def _looks(found: Sequence[tuple[LookSighting, Counts, Counts]]) -> Looks:
    best = max(found, key=lambda f: (f[0].box[2] * f[0].box[3], -f[0].frame))[0]
    upper = _mean([_share(counts) for _, counts, _ in found])
    lower = _mean([_share(counts) for _, _, counts in found])
    return Looks(len(found), upper, lower, best.frame, best.box)


def _share(counts: Counts) -> Counts:
    return counts * 10**6 // int(counts.sum())


def _mean(shares: Sequence[Counts]) -> list[int]:
    total = np.stack(shares).sum(axis=0) // (len(shares) * _THOUSAND)
    return [int(v) for v in total]
