"""Detectors of one's own: what they may answer."""

from __future__ import annotations

from typing import Any

import pytest

from recorders.detectors import Sighting, as_detections
from recorders.errors import SceneTraceError
from recorders.limits import DEFAULT_LIMITS
from recorders.message_checks import check_detections


def test_boxes_are_cut_to_the_picture_and_sorted_by_score() -> None:
    found: list[Any] = [
        Sighting((-5, 10, 20, 30), 0.3, "cat"),
        ((300, 230, 50, 50), 0.9),
        ((400, 10, 20, 20), 1.0, "outside"),
    ]
    made = as_detections("d", 7, 320, 240, found)
    assert made.boxes == [(300, 230, 20, 10), (0, 10, 15, 30)]
    assert (made.scores, made.labels, made.blobs) == ([0.9, 0.3], ["", "cat"], [-1, -1])
    check_detections(made, DEFAULT_LIMITS)


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (((1, 2, 3), 0.5, "x"), "wanted"),
        (5, "wanted"),
        (((1, 2, 3, float("nan")), 0.5), "finite"),
        (((1, 2, 0, 4), 0.5), "over 0"),
        (((1, 2, 3, 4), 1.5), "a score of 1.5"),
    ],
)
def test_answers_that_are_none_name_detector_and_frame(one: Any, said: str) -> None:
    with pytest.raises(SceneTraceError, match=f"the detector mine:D in frame 7: .*{said}"):
        as_detections("mine:D", 7, 320, 240, [one])
