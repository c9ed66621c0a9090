"""Whether the masks hold in a recording: whom the detector is sure of, they have as well.

Trackers do more with masks that miss nobody than with any boxes: they know which bodies share a
blob, and follow who is hidden in it. Then a detector tells which of the masks' bodies are none.
Where the masks miss bodies, or run them together, boxes of both say better where bodies are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from recorders.detectors.suppression import overlaps
from recorders.fusion.hypotheses import SCORE_STEPS, corners_of
from recorders.messages import Box, Detections

SURE = SCORE_STEPS[2]
"""Boxes of the detector that are asked for, by their scores."""
THERE = 0.2
"""From this intersection over union on a box has a body in the masks."""
HOLD = 0.9
"""Masks hold that have this share. Of ten recordings and their variants those whose masks do better
alone than with boxes had .97 and more, the others at most .84.
"""
FEWEST = 20
"""Fewer sure boxes than this tell nothing."""
BLIND = 0.1
"""A detector that finds fewer boxes, for each body in the masks, knows nothing."""


def masks_hold(masked: Mapping[int, list[Box]], detected: Sequence[Detections]) -> bool:
    """Whether the masks hold.

    Args:
        masked: bodies in the masks of sampled pictures, by the picture's number.
        detected: what the detector finds in each sampled picture.
    """
    asked = there = found_ones = bodies = 0
    for number, boxes in sorted(masked.items()):
        if number >= len(detected):
            continue
        found = detected[number]
        scores = found.scores or [1.0] * len(found.boxes)
        found_ones += sum(score >= SCORE_STEPS[0] for score in scores)
        bodies += len(boxes)
        sure = [b for b, score in zip(found.boxes, scores, strict=True) if score >= SURE]
        asked += len(sure)
        if sure and boxes:
            shares = overlaps(corners_of(sure), corners_of(boxes))
            there += int(np.count_nonzero((shares >= THERE).any(axis=1)))
    blind = found_ones < BLIND * bodies
    return blind or (asked >= FEWEST and there >= HOLD * asked)
