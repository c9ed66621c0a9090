"""Who covers whom among objects that share their foreground, and who is in front, by owners and colours of pixels."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from replay.trackers.shells.colours import Bins
from replay.trackers.shells.foreground import Bools, Cut
from replay.trackers.shells.membership import Claimants, cells, log_mask
from replay.trackers.shells.objects import GRID

_HALF = math.log(0.5)
_TELLING = 12
"""Pixels in the overlap of two last masks from which on they tell who is in front."""


class Depth:
    """Asked for claimants by row, once their pixels are assigned."""

    def __init__(self, who: Claimants, owner: NDArray[np.uint8], cut: Cut, bins: Bins | None) -> None:
        """Prepare.

        Args:
            who: the N claimants at their places.
            owner: (H, W) uint8, 0 for nobody, k + 1 for claimant k.
            cut: the pixels, (H, W).
            bins: their colour bins, None without pictures.
        """
        self._who = who
        self._owner = owner
        self._cut = cut
        self._bins = bins
        self._n = len(who.boxes)
        self._spans = [self._span(k) for k in range(self._n)]
        self._masks: dict[int, Bools] = {}

    def _span(self, k: int) -> tuple[int, int, int, int]:
        """Rows and columns of the cut within a claimant's box: first and end."""
        x, y, w, h = self._who.boxes[k].tolist()
        rows = cells(y - self._cut.top, h, 0, self._owner.shape[0])
        columns = cells(x - self._cut.left, w, 0, self._owner.shape[1])
        a, b = np.searchsorted(rows, (0, GRID)).tolist()
        c, d = np.searchsorted(columns, (0, GRID)).tolist()
        return a, b, c, d

    def _owners(self, rows: slice, columns: slice) -> NDArray[np.intp]:
        return np.bincount(self._owner[rows, columns].ravel(), minlength=self._n + 1)

    def covering(self, k: int) -> list[tuple[int, float]]:
        """Who else owns pixels within claimant k's box, and their share where both boxes overlap, largest first."""
        a, b, c, d = self._spans[k]
        mine = self._owners(slice(a, b), slice(c, d))
        out = []
        for other in range(self._n):
            if other == k or not mine[other + 1]:
                continue
            p, q, r, s = self._spans[other]
            top, left = max(a, p), max(c, r)
            split = self._owners(slice(top, max(top, min(b, q))), slice(left, max(left, min(d, s))))
            lost, kept = int(split[other + 1]), int(split[k + 1])
            if lost + kept > 0:
                out.append((other, lost / (lost + kept)))
        return sorted(out, key=lambda r: (-r[1], r[0]))

    def in_front(self, k: int) -> list[tuple[int, float]]:
        """Who else owns pixels within claimant k's last mask, and the share that they have won, largest first.

        Where two last masks overlap the pixels are those of the object in front: whoever's colours win there is. Too
        few such pixels tell nothing: share 0.
        """
        mine = self._silhouette(k)
        owners = np.bincount(self._owner[mine], minlength=self._n + 1)
        out = []
        for other in range(self._n):
            if other == k or not owners[other + 1]:
                continue
            lost, kept = self._won(k, other, mine & self._silhouette(other) & self._cut.own)
            told = lost + kept >= _TELLING
            out.append((other, lost / (lost + kept) if told else 0.0))
        return sorted(out, key=lambda r: (-r[1], -owners[r[0] + 1], r[0]))

    def _won(self, k: int, other: int, both: Bools) -> tuple[int, int]:
        """How many of the pixels that both may own are the other's, and how many are k's."""
        mine, theirs = self._who.tells[k], self._who.tells[other]
        if self._bins is None or mine is None or theirs is None:
            split = np.bincount(self._owner[both], minlength=self._n + 1)
            return int(split[other + 1]), int(split[k + 1])
        bins = self._bins[both]
        ahead = theirs[bins] - mine[bins]
        return int(np.count_nonzero(ahead > 0)), int(np.count_nonzero(ahead < 0))

    def _silhouette(self, k: int) -> Bools:
        """The last mask of a claimant at its place in the cut, (H, W) bool."""
        known = self._masks.get(k)
        if known is None:
            x, y, w, h = self._who.boxes[k].tolist()
            a, b, c, d = self._spans[k]
            i, j = cells(y - self._cut.top, h, a, b), cells(x - self._cut.left, w, c, d)
            known = np.zeros(self._owner.shape, bool)
            known[a:b, c:d] = (log_mask(self._who.masks[k]) > _HALF)[i[:, None], j]
            self._masks[k] = known
        return known
