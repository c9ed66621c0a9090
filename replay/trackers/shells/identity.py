"""Who is who after a JOINT: colours decide where places cannot.

Two objects that were JOINT may have changed places unseen. Once each has a blob of its own again,
both blobs' colours are compared with both histograms over a short time, in which nothing is
learnt; where they say that the two have changed places, the identities follow the colours. This
is how an occluded object reappears under its own id anywhere within its occluder's shell.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from replay.trackers.shells.colours import BINS, against
from replay.trackers.shells.objects import Body

Floats = NDArray[np.float64]
Pair = tuple[int, int]


@dataclass(slots=True)
class _Doubt:
    """Evidence about a pair (a, b) since it separated: sums of what a's and b's blobs said, and
    of how many frames; ``since``: the frame of the JOINT in which they were ``nearest``, pixels.
    """

    frames: int
    first: Floats
    second: Floats
    since: int
    nearest: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """A decided pair: ``evidence`` > 0 speaks for the places as they are, in log likelihood per
    pixel of both blobs; ``since``: if they were exchanged, then in about this frame.
    """

    a: int
    b: int
    evidence: float
    frames: int
    exchanged: bool
    since: int


class Doubts:
    """All pairs whose identities are in doubt."""

    def __init__(self) -> None:
        self._pairs: dict[Pair, _Doubt] = {}

    def __contains__(self, identity: object) -> bool:
        return any(identity in pair for pair in self._pairs)

    def joined(self, a: int, b: int, frame: int, distance: float) -> None:
        """A pair is JOINT, at this distance: what was seen before counts no more."""
        pair = (min(a, b), max(a, b))
        known = self._pairs.get(pair)
        since, nearest = frame, distance
        if known is not None and known.nearest <= distance:
            since, nearest = known.since, known.nearest
        self._pairs[pair] = _Doubt(0, np.zeros(BINS), np.zeros(BINS), since, nearest)

    def restart(self) -> None:
        """What was seen so far is not to be compared with what is seen from now on."""
        for doubt in self._pairs.values():
            doubt.frames, doubt.first, doubt.second = 0, np.zeros(BINS), np.zeros(BINS)

    def keep(self, living: list[int]) -> None:
        """Forget pairs of objects that are gone."""
        self._pairs = {
            p: pair for p, pair in self._pairs.items() if p[0] in living and p[1] in living
        }

    def alone(self) -> list[int]:
        """Ids in doubt, ascending."""
        return sorted({i for pair in self._pairs for i in pair})

    def see(self, looks: Mapping[int, Floats]) -> None:
        """Add the histograms of the blobs that objects have for themselves in this frame."""
        for (a, b), doubt in self._pairs.items():
            if a in looks and b in looks:
                doubt.frames += 1
                doubt.first = doubt.first + looks[a]
                doubt.second = doubt.second + looks[b]

    def decide(
        self, bodies: Mapping[int, Body], apart: set[Pair], frames: int, margin: float
    ) -> list[Verdict]:
        """Decide pairs seen often enough, or already INDEPENDENT, those with the clearest
        evidence first.

        At most one exchange of each object in one frame; a pair whose partner has just been
        exchanged waits.
        """
        due: list[tuple[float, Pair]] = []
        for pair in sorted(self._pairs):
            doubt = self._pairs[pair]
            if doubt.frames >= frames or (pair in apart and doubt.frames):
                due.append((_evidence(bodies[pair[0]], bodies[pair[1]], doubt), pair))
            elif pair in apart:
                del self._pairs[pair]
        verdicts: list[Verdict] = []
        moved: set[int] = set()
        for evidence, (a, b) in sorted(due):
            if a in moved or b in moved:
                continue
            exchanged = evidence < -margin
            doubt = self._pairs[a, b]
            verdicts.append(Verdict(a, b, evidence, doubt.frames, exchanged, doubt.since))
            del self._pairs[a, b]
            if exchanged:
                moved |= {a, b}
                self._exchange(a, b)
        return verdicts

    def _exchange(self, a: int, b: int) -> None:
        """What was seen of the two belongs to the other one now."""
        for (c, d), doubt in self._pairs.items():
            if {c, d} & {a, b}:
                doubt.frames, doubt.first, doubt.second = 0, np.zeros(BINS), np.zeros(BINS)

    def state(self) -> list[Any]:
        """Plain data for a checkpoint."""
        return [
            [
                a,
                b,
                pair.frames,
                pair.first.copy(),
                pair.second.copy(),
                pair.since,
                pair.nearest,
            ]
            for (a, b), pair in self._pairs.items()
        ]

    def restore(self, state: list[Any]) -> None:
        """Continue from what `state` gave."""
        self._pairs = {
            (a, b): _Doubt(
                n, np.array(first, np.float64), np.array(second, np.float64), since, nearest
            )
            for a, b, n, first, second, since, nearest in state
        }


def _evidence(a: Body, b: Body, doubt: _Doubt) -> float:
    if a.colours is None or b.colours is None or not doubt.frames:
        return 0.0
    n = doubt.frames
    return against(a.colours, b.colours, doubt.first / n) + against(
        b.colours, a.colours, doubt.second / n
    )
