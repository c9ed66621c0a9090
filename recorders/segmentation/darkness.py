"""How dark bodies are, where there are no colours: what takes far less of the light is a shadow.

In a recording without colours a shadow looks like grey clothes, and what a wall or a floor reflects
of a body like a part of it. Where nearly all bodies are much darker than what is behind them, what
takes less than half of what they take, counted in logarithms as light is absorbed, is none of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from recorders.messages import Blob
from recorders.pictures import Image
from recorders.segmentation.blobs import Labels
from recorders.segmentation.touching import pixels_of, within
from recorders.segmentation.usual import quantile

FEWEST = 20
"""Fewer bodies say nothing."""
NEARLY_ALL = 0.9
"""Bodies of this share of all area are at least so dark: a few may wear lighter clothes."""


@dataclass
class Darkness:
    """What was seen of how dark bodies are."""

    _left: list[float] = field(default_factory=list)
    _areas: list[float] = field(default_factory=list)

    def observe(
        self, brightness: Image, behind: Image, labels: Labels, blobs: Sequence[Blob]
    ) -> None:
        """Take in the bodies of one picture.

        Args:
            brightness: (H, W) uint8, the picture's.
            behind: the same of the background, in the picture's light.
            labels: (H, W) int32, the bodies, from 1.
            blobs: blob k - 1 is label k.
        """
        for blob in blobs:
            own = pixels_of(blob, labels) > 0
            here = within(blob, brightness)[own].astype(np.float64)
            there = within(blob, behind)[own].astype(np.float64)
            self._left.append(float(np.median(here / np.maximum(there, 1.0))))
            self._areas.append(float(blob.area))

    def shadow_keeps(self) -> float:
        """The share of the background's brightness that a shadow keeps at least; 1 where bodies are
        not darker, or too few were seen.
        """
        if len(self._left) < FEWEST:
            return 1.0
        left: NDArray[np.float64] = np.array(self._left)
        return min(1.0, float(np.sqrt(quantile(left, np.array(self._areas), NEARLY_ALL))))
