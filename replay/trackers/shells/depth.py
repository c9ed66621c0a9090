"""Who covers whom among objects that share their foreground, and who is in front, by the owners
of pixels.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from replay.trackers.shells.foreground import Bools, Cut
from replay.trackers.shells.membership import Claimants, cells, log_mask
from replay.trackers.shells.objects import GRID

_HALF = math.log(0.5)
_AREA = 0.5
"""Weight of the visible areas against the pixels lost; measured on generated fish and people."""
_MOST = 1.2
"""An object that shows more than its usual area shows no more than it."""


class Depth:
    """Asked for claimants by row, once their pixels are assigned."""

    def __init__(self, who: Claimants, owner: NDArray[np.uint16], cut: Cut) -> None:
        """Prepare.

        Args:
            who: the N claimants at their places.
            owner: (H, W) uint16, 0 for nobody, k + 1 for claimant k.
            cut: the pixels, (H, W).
        """
        self._who = who
        self._owner = owner
        self._cut = cut
        self._n = len(who.boxes)
        self._spans = [self._span(k) for k in range(self._n)] if self._n > 1 else []
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
        """Who else owns pixels within claimant k's box, and their share where both boxes overlap,
        largest first.
        """
        if self._n == 1:
            return []
        a, b, c, d = self._spans[k]
        mine = self._owners(slice(a, b), slice(c, d))
        out = []
        for other in range(self._n):
            if other == k or not mine[other + 1]:
                continue
            p, q, r, s = self._spans[other]
            top, left = max(a, p), max(c, r)
            split = self._owners(
                slice(top, max(top, min(b, q))), slice(left, max(left, min(d, s)))
            )
            lost, kept = int(split[other + 1]), int(split[k + 1])
            if lost + kept > 0:
                out.append((other, lost / (lost + kept)))
        return sorted(out, key=lambda rival: (-rival[1], rival[0]))

    def lead(self, j: int, k: int, visible: Sequence[float]) -> float | None:
        """Evidence that claimant j lies in front of k, negative if behind; None where they do not
        overlap.

        What lies behind has lost pixels within its last mask to the one in front, and a part of
        its usual area; what lies in front has not. Who shrinks because it turns loses area alone,
        so area counts half.

        Args:
            j: the one claimant.
            k: the other.
            visible: every claimant's share of its usual area that is its own in this frame.
        """
        if not self._meet(j, k):
            return None
        area = min(visible[j], _MOST) - min(visible[k], _MOST)
        return float(self._lost(k, j) - self._lost(j, k) + _AREA * area)

    def _meet(self, j: int, k: int) -> bool:
        a, b, c, d = self._spans[j]
        p, q, r, s = self._spans[k]
        return max(a, p) < min(b, q) and max(c, r) < min(d, s)

    def _lost(self, k: int, to: int) -> float:
        """Share of a claimant's last mask that is somebody else's."""
        a, b, c, d = self._spans[k]
        mine = self._silhouette(k)[a:b, c:d]
        owners = self._owner[a:b, c:d]
        return int(np.count_nonzero(owners[mine] == to + 1)) / (
            int(np.count_nonzero(mine)) + 1
        )

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
