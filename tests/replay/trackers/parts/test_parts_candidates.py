"""Which observations are candidates as they are, and which a target is hung in (PARTS 3.1)."""

from __future__ import annotations

import numpy as np
import pytest

from recorders.messages import Blob, Detections, Ellipse
from replay.trackers.parts.candidates import Candidates, Expected, Heads, gather, observe
from replay.trackers.parts.heads import Head
from replay.trackers.parts.parameters import PartsParameters

TARGET = (100.0, 60.0, 20.0, 80.0)
"""As it is expected, all by itself."""


def candidates(width: float, height: float, tops: int) -> Candidates:
    """Of `TARGET`, in one blob at its place that holds so many heads side by side."""
    x, y = TARGET[:2]
    box = (x, y, width, height)
    middle = Ellipse(x + width / 2, y + height / 2, height, width, 0.0)
    seen = observe(
        Detections(
            0, 320, 240, boxes=[box], scores=[1.0], ellipses=[middle], blobs=[1],
            components=[Blob(1, box, round(width * height), middle)],
        )
    )  # fmt: skip
    found = [Head(x + 5.0 + 10.0 * k, y, 1.0) for k in range(tops)]
    heads = Heads(lambda *_: found, lambda: None, np.full((240, 320), 255, np.uint8))
    at = Expected(np.array([TARGET]), np.array([0.5]), np.array([40.0]))
    kept, _ = gather(seen, [np.array([0])], at, heads, PartsParameters())
    return kept


@pytest.mark.parametrize(
    ("width", "height", "direct", "hung"),
    [
        (20.0, 80.0, 1, 0),  # of its size
        (29.0, 80.0, 1, 0),  # 45 % wider: not occluded
        (31.0, 80.0, 0, 5),  # 55 % wider: five sizes under the head
        (20.0, 124.0, 0, 5),  # 55 % higher
        (20.0, 44.0, 1, 0),  # 45 % lower: not occluded
        (20.0, 36.0, 0, 1),  # 55 % lower: aligned with the head
    ],
)
def test_a_blob_is_occluded_from_half_the_size_on(
    width: float, height: float, direct: int, hung: int
) -> None:
    found = candidates(width, height, tops=1)
    assert (int(found.direct.sum()), int((~found.direct).sum())) == (direct, hung)


def test_a_smaller_blob_without_a_head_is_dismissed() -> None:
    assert len(candidates(20.0, 36.0, tops=0).rows) == 0


def test_in_a_blob_of_its_size_with_two_heads_a_target_hangs_too() -> None:
    """Ours: two who stand shoulder to shoulder are no half larger than one who strides."""
    found = candidates(29.0, 80.0, tops=2)
    assert (int(found.direct.sum()), int((~found.direct).sum())) == (1, 10)
