"""Where objects are placed in foreground that they share, whatever their sizes, and what the
search takes.
"""

from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from replay.trackers.shells.foreground import Cut
from replay.trackers.shells.membership import Claimants
from replay.trackers.shells.objects import GRID
from replay.trackers.shells.parameters import ShellsParameters
from replay.trackers.shells.placing import place

SMALL = 22


def shared(width: int, height: int) -> Cut:
    """A body of a size at (200, 60) with a small one at its upper left corner, in one blob."""
    own = np.zeros((480, 640), bool)
    own[60 : 60 + height, 200 : 200 + width] = True
    own[100 : 100 + SMALL, 200 - SMALL : 200] = True
    return Cut(own, ~own, own.astype(np.uint16), 0, 0)


@pytest.mark.parametrize(("width", "height"), [(30, 40), (60, 120), (120, 240), (200, 380)])
def test_a_large_object_beside_a_small_one_is_placed_in_bounded_memory(
    width: int, height: int
) -> None:
    off = np.array([0.06 * width, -0.04 * height])
    large = [200 + off[0], 60 + off[1], width, height]
    who = Claimants(
        np.array([large, [200.0 - SMALL, 100, SMALL, SMALL]]),
        np.array([250.0, 30.0]),
        [None, None],
        [None, None],
    )
    tracemalloc.start()
    found = place(
        who, np.array([10.0, 5.0]), [0, 1], shared(width, height), None, ShellsParameters()
    )
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert found[:, 2:] == pytest.approx(who.boxes[:, 2:])
    assert abs(found[0, 0] - 200) < 0.5 * abs(off[0])
    assert abs(found[0, 1] - 60) < 0.5 * abs(off[1])
    assert peak < 60e6, f"{peak / 1e6:.0f} MB for {width} x {height}"


def test_a_crowd_in_one_blob_takes_little_more_than_the_picture() -> None:
    rows, columns, size = 12, 16, 20
    own = np.ones((rows * size, columns * size), bool)
    boxes = np.array(
        [[c * size, r * size, size, size] for r in range(rows) for c in range(columns)],
        np.float64,
    )
    n = len(boxes)
    masks = [np.full((GRID, GRID), 255, np.uint8)] * n
    tracemalloc.start()
    place(
        Claimants(boxes, np.full(n, 15.0), [None] * n, masks), np.full(n, 2.0), range(n),
        Cut(own, ~own, own.astype(np.uint16), 0, 0), None, ShellsParameters(),
    )  # fmt: skip
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40e6, f"{peak / 1e6:.0f} MB"
