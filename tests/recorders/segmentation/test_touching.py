"""Touching bodies told apart: as many as the area asks for, every pixel once, bounded whatever
the size.
"""

from __future__ import annotations

import numpy as np
import pytest

from recorders.segmentation.blobs import components
from recorders.segmentation.touching import MOST_BODIES, bodies_in, split


def disks(
    *centres: tuple[int, int], radius: int = 10, size: tuple[int, int] = (120, 120)
) -> np.ndarray:
    yy, xx = np.mgrid[0 : size[0], 0 : size[1]] + 0.5
    mask = np.zeros(size, np.uint8)
    for x, y in centres:
        mask[(xx - x) ** 2 + (yy - y) ** 2 <= radius**2] = 255
    return mask


@pytest.mark.parametrize(
    "centres", [[(40, 60)], [(40, 60), (57, 60)], [(40, 60), (57, 60), (48, 75)]]
)
def test_disks_that_overlap_are_told_apart(centres: list[tuple[int, int]]) -> None:
    mask = disks(*centres)
    area = int(np.count_nonzero(disks((60, 60))))
    parts = split(mask, mask, area)
    assert len(parts) == len(centres)
    assert np.array_equal(sum(p.astype(int) for p in parts), mask.astype(int))
    found = sorted(tuple(np.argwhere(p).mean(axis=0)[::-1] + 0.5) for p in parts)
    for got, wanted in zip(found, sorted(centres), strict=True):
        assert got == pytest.approx(wanted, abs=3.0)


def test_what_is_as_large_as_a_crowd_is_one_thing() -> None:
    everything = np.full((300, 400), 255, np.uint8)
    blob = components(everything, 1.0)[2][0]
    assert bodies_in(blob, blob.area / (MOST_BODIES - 0.5)) > 1
    assert bodies_in(blob, blob.area / (MOST_BODIES + 1)) == 1
    assert len(split(everything, everything, 30.0)) == 1
